"use strict";
// Zoom and pan of pictures, linked highlights, sorted tables. The page is complete without.

function pictureOf(svg) {
  const [x, y, w, h] = svg.getAttribute("viewBox").split(" ").map(Number);
  const whole = { x, y, w, h };
  let view = { ...whole };
  const show = (next) => {
    view = next;
    svg.setAttribute("viewBox", [view.x, view.y, view.w, view.h].map((n) => n.toFixed(1)).join(" "));
  };
  // About a point of the picture, which stays where it is; never out of sight.
  const zoom = (factor, px = view.x + view.w / 2, py = view.y + view.h / 2) => {
    const scale = Math.min(Math.max((view.w * factor) / whole.w, 1 / 400), 1);
    if (scale === 1) return show({ ...whole });
    const f = (scale * whole.w) / view.w;
    show({ x: px - (px - view.x) * f, y: py - (py - view.y) * f, w: view.w * f, h: view.h * f });
  };
  const at = (event) => {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
    return [point.x, point.y];
  };
  const move = (dx, dy) => show({ ...view, x: view.x - dx, y: view.y - dy });
  let grip = null;
  svg.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "touch" && view.w === whole.w) return;
    grip = at(event);
    svg.setPointerCapture(event.pointerId);
    svg.classList.add("grabbed");
  });
  svg.addEventListener("pointermove", (event) => {
    if (!grip) return;
    const [px, py] = at(event);
    move(px - grip[0], py - grip[1]);
  });
  for (const end of ["pointerup", "pointercancel"])
    svg.addEventListener(end, () => { grip = null; svg.classList.remove("grabbed"); });
  svg.addEventListener("wheel", (event) => {
    // A page scrolls as usual: pictures are zoomed when they have the focus, or by Ctrl and the wheel.
    if (document.activeElement !== svg && !event.ctrlKey) return;
    event.preventDefault();
    zoom(Math.exp(event.deltaY / 400), ...at(event));
  }, { passive: false });
  svg.addEventListener("dblclick", (event) => zoom(0.5, ...at(event)));
  svg.addEventListener("keydown", (event) => {
    const step = view.w / 10;
    const keys = {
      "+": () => zoom(0.7), "=": () => zoom(0.7), "-": () => zoom(1.4), "0": () => show({ ...whole }),
      ArrowLeft: () => move(step, 0), ArrowRight: () => move(-step, 0),
      ArrowUp: () => move(0, step), ArrowDown: () => move(0, -step),
    };
    if (!keys[event.key] || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    keys[event.key]();
  });
  const buttons = { in: () => zoom(0.6), out: () => zoom(1 / 0.6), all: () => show({ ...whole }) };
  const bar = svg.parentElement.querySelector(".zoom");
  if (bar) {
    bar.hidden = false;
    for (const button of bar.querySelectorAll("button")) button.addEventListener("click", buttons[button.dataset.zoom]);
  }
  return { lookAt: (px, py) => show({ x: px - whole.w / 16, y: py - whole.h / 16, w: whole.w / 8, h: whole.h / 8 }) };
}

const pictures = new Map();
for (const svg of document.querySelectorAll("svg.picture:not(.small)")) pictures.set(svg, pictureOf(svg));

for (const link of document.querySelectorAll(".places a"))
  link.addEventListener("click", () => {
    const mark = document.querySelector(link.getAttribute("href"));
    const svg = mark.closest("svg");
    pictures.get(svg).lookAt(Number(mark.dataset.x), Number(mark.dataset.y));
    svg.scrollIntoView({ block: "nearest" });
  });

for (const mark of document.querySelectorAll("[data-key]"))
  for (const [event, lit] of [["pointerenter", true], ["pointerleave", false]])
    mark.addEventListener(event, () => {
      for (const other of document.querySelectorAll(`[data-key="${mark.dataset.key}"]`)) other.classList.toggle("lit", lit);
    });

for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      const key = (row) => row.cells[column].dataset.value ?? row.cells[column].textContent;
      const number = head.classList.contains("number");
      const order = (a, b) => (number ? Number(key(a)) - Number(key(b)) : key(a).localeCompare(key(b)));
      const rows = [...table.tBodies[0].rows].sort((a, b) => (down ? order(b, a) : order(a, b)));
      table.tBodies[0].append(...rows);
      for (const other of heads) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
    });
  });
}
