"use strict";
// The studio inside `root`, a document or a shadow root: draws the states that it is shown, and says what the pointer does,
// one message at a time, of a drag the newest place only. It knows nothing of how messages travel: `send` takes one, and
// `show` is called with every state that comes back. `keys` is what hears the keyboard.

function studio(root, keys, send) {
  const $ = (id) => root.getElementById(id);
  const pictures = { source: $("picture-source"), target: $("picture-target") };
  const frames = {};
  const layers = {};
  let state = null;

  function element(name, parent, attributes = {}) {
    const made = document.createElementNS("http:" + "//www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    parent.append(made);
    return made;
  }

  for (const [name, svg] of Object.entries(pictures)) {
    layers[name] = {};
    for (const layer of ["patches", "iso", "interfaces", "outline", "special", "target", "vertices", "handles", "pairs", "places"])
      layers[name][layer] = element("g", svg, { class: layer });
  }

  // --- what there is to see

  function paths(group, rows, kind) {
    // Elements are kept: only their data change while one drags.
    rows.forEach(([className, data], k) => {
      const path = group.children[k] ?? element("path", group);
      path.setAttribute("class", `${kind} ${className}`);
      path.setAttribute("d", data);
    });
    while (group.children.length > rows.length) group.lastChild.remove();
  }

  function drawModel(into, model) {
    paths(into.patches, model.patches.map(([colour, d]) => [`p${colour}`, d]), "patch");
    paths(into.iso, model.iso.map(([kind, d]) => [`q${kind}`, d]), "iso");
    paths(into.interfaces, model.interfaces.map(([kind, d]) => [`q${kind}`, d]), "interface");
    paths(into.outline, [["outline", model.outline]], "");
    paths(into.special, [["ring", model.special], ["disc", model.special]], "");
  }

  function drawPairs(name, column) {
    const group = layers[name].pairs;
    paths(group, [], "");
    state.landmarks.forEach((row, k) => {
      const [x, y] = row.slice(column, column + 2);
      const dot = element("path", group, { class: "pair", d: `M${x} ${y}h0`, "data-landmark": k });
      element("title", dot).textContent = `landmark ${k + 1}`;
      element("text", group, { class: "label", x, y }).textContent = k + 1;
    });
  }

  function show(next) {
    // The next map is made while this one is drawn. What was changed elsewhere is shown, too, and answers nothing.
    if (next.done !== undefined || next.refused !== undefined) {
      waiting = false;
      sendNext();
    }
    state = next;
    for (const [name, frame] of [["source", next.source_frame], ["target", next.frame]]) {
      frames[name] = frame;
      pictures[name].setAttribute("viewBox", frame.view_box);
    }
    if (next.source) drawModel(layers.source, next.source);
    if (next.result) drawModel(layers.target, next.result);
    for (const layer of ["patches", "iso", "interfaces", "outline", "special"])
      layers.target[layer].classList.toggle("stale", next.stale);
    paths(layers.target.target, [["target-outline", next.outline]], "");
    const held = grip?.handle;
    paths(layers.target.handles, next.handles.map(([loop, curve, point, x, y]) => [
      `${point ? "" : "joint"}${held && held.join() === [loop, curve, point].join() ? " held" : ""}`, `M${x} ${y}h0`]), "handle");
    const taken = grip?.vertex;
    paths(layers.target.vertices, next.vertices.map(([patch, corner, x, y, moved]) => [
      `${moved ? "moved" : ""}${taken && taken.join() === [patch, corner].join() ? " held" : ""}`, `M${x} ${y}h0`]), "vertex");
    drawPairs("source", 0);
    drawPairs("target", 2);
    paths(layers.target.places, next.places.map(([x, y]) => ["", `M${x} ${y}h0`]), "place");
    pictures.target.classList.toggle("uncertified", !next.ok);
    $("verdict").textContent = next.status;
    $("verdict").className = `verdict ${next.ok ? "good" : "bad"}`;
    $("words").textContent = next.words;
    $("time").textContent = `${next.milliseconds} ms`;
    $("undo").disabled = !next.undo;
    $("redo").disabled = !next.redo;
    $("refused").hidden = !next.refused;
    $("refused").textContent = next.refused ?? "";
  }

  function end(why) {
    waiting = true;
    $("verdict").textContent = why;
    $("verdict").className = "verdict bad";
  }

  let waiting = true; // for an answer, and first of all for what there is
  const queue = [];

  function say(message) {
    // A drag that was not sent yet is overtaken by a newer one.
    const last = queue[queue.length - 1];
    if (message.do === "drag" && last?.do === "drag") queue.pop();
    queue.push(message);
    sendNext();
  }

  function sendNext() {
    if (waiting || !queue.length) return;
    waiting = true;
    send(queue.shift());
  }

  // --- what the pointer does

  let grip = null; // { handle }, { vertex } or { landmark, on }
  let first = null; // the source's point of a pair that is being added

  function place(name, event) {
    const svg = pictures[name];
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    const { left, top, unit } = frames[name];
    return { x: left + point.x * unit, y: top - point.y * unit };
  }

  function pairing(on) {
    first = null;
    $("pair").setAttribute("aria-pressed", on);
    $("pair").textContent = on ? "point of the source …" : "add landmark";
  }

  for (const [name, svg] of Object.entries(pictures)) {
    svg.addEventListener("pointerdown", (event) => {
      if ($("pair").getAttribute("aria-pressed") === "true") {
        const at = place(name, event);
        if (name === "source") {
          first = at;
          $("pair").textContent = "point of the target …";
        } else if (first) {
          say({ do: "add", sx: first.x, sy: first.y, tx: at.x, ty: at.y });
          pairing(false);
        }
        return;
      }
      const mark = event.target;
      if (mark.classList.contains("handle")) {
        const [loop, curve, point] = state.handles[[...mark.parentNode.children].indexOf(mark)];
        grip = { handle: [loop, curve, point] };
        say({ do: "grab", loop, curve, point, reach: Number($("reach").value) });
      } else if (mark.classList.contains("vertex")) {
        const [patch, corner] = state.vertices[[...mark.parentNode.children].indexOf(mark)];
        grip = { vertex: [patch, corner], x: event.clientX, y: event.clientY };
      } else if (mark.classList.contains("pair")) {
        grip = { landmark: Number(mark.dataset.landmark), on: name, x: event.clientX, y: event.clientY };
      } else return;
      event.preventDefault();
      svg.setPointerCapture(event.pointerId);
      keys.focus?.({ preventScroll: true });
    });
    svg.addEventListener("pointermove", (event) => {
      if (name !== "target") return;
      if (grip?.handle) say({ do: "drag", ...place(name, event) });
      if (!grip?.vertex) return;
      // A click, or the first of a double click, moves nothing.
      if (!grip.moved && Math.hypot(event.clientX - grip.x, event.clientY - grip.y) <= 3) return;
      const [patch, corner] = grip.vertex;
      if (!grip.moved) say({ do: "take", patch, corner });
      grip.moved = true;
      say({ do: "drag", ...place(name, event) });
    });
    for (const end of ["pointerup", "pointercancel"])
      svg.addEventListener(end, (event) => {
        if (grip?.handle || grip?.moved) say({ do: "drop" });
        // A click is no move.
        const far = grip?.landmark !== undefined && Math.hypot(event.clientX - grip.x, event.clientY - grip.y) > 3;
        if (far && end === "pointerup")
          say({ do: "move", landmark: grip.landmark, on: grip.on, ...place(grip.on, event) });
        grip = null;
      });
    svg.addEventListener("dblclick", (event) => {
      // The pointer was captured, so that the event names the whole picture.
      const mark = root.elementFromPoint(event.clientX, event.clientY);
      if (mark?.classList.contains("pair")) say({ do: "remove", landmark: Number(mark.dataset.landmark) });
      if (mark?.classList.contains("vertex")) {
        const [patch, corner, , , moved] = state.vertices[[...mark.parentNode.children].indexOf(mark)];
        if (moved) say({ do: "release", patch, corner });
      }
    });
  }

  $("pair").addEventListener("click", () => pairing($("pair").getAttribute("aria-pressed") !== "true"));
  $("undo").addEventListener("click", () => say({ do: "undo" }));
  $("redo").addEventListener("click", () => say({ do: "redo" }));
  keys.addEventListener("keydown", (event) => {
    if (event.key === "Escape") pairing(false);
    if ((event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z") {
      event.preventDefault();
      say({ do: event.shiftKey ? "redo" : "undo" });
    }
  });

  return { show, end };
}
