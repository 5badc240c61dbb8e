// The studio as a page of its own: messages go through a socket to the server that the page is from.

const token = document.body.dataset.token;
const live = new WebSocket(`ws:${"//"}${location.host}/live?token=${encodeURIComponent(token)}`);
const page = studio(document, document, (message) => live.send(JSON.stringify(message)));
live.addEventListener("message", (event) => page.show(JSON.parse(event.data)));
live.addEventListener("close", () => page.end("the studio has ended"));
