// The comparisons of `hapticd calibrate person`: two keys, how many are done, and in the end the curve. A page that is
// hidden or gone has no socket: then the server pauses, and the plate is quiet.

const AGAIN_MS = 1000;
const KEYS = { p: "plate", r: "reference" };
const key = new URLSearchParams(location.search).get("key") ?? "";
const element = (name) => document.getElementById(name);
const buttons = Object.values(KEYS).map(element);
let socket = null;
let isOver = false;

function open() {
  if (document.hidden || isOver || socket?.readyState < WebSocket.CLOSING) return;
  socket = new WebSocket(`ws://${location.host}/socket?key=${encodeURIComponent(key)}`);
  socket.addEventListener("message", (event) => show(JSON.parse(event.data)));
  socket.addEventListener("close", (event) => {
    if (isOver) return;
    enable(false);
    element("heading").textContent = event.reason || "Paused: `hapticd calibrate person` does not answer.";
    setTimeout(open, AGAIN_MS);
  });
}

function show({ heading, done, of, is_ready: isReady, full_um, floors }) {
  if (heading === undefined) return;
  element("heading").textContent = heading;
  element("progress").max = of;
  element("progress").value = done;
  enable(isReady);
  if (floors !== undefined) draw(full_um, ...floors);
}

function enable(isReady) {
  for (const button of buttons) button.disabled = !isReady;
}

/** Draw friction that falls exponentially to `floor` at `full_um`, between the lowest and the highest of its interval. */
function draw(full_um, floor, low, high) {
  isOver = true;
  const shares = Array.from({ length: 41 }, (_, index) => index / 40);
  const line = (end) => shares.map((share) => `${200 * share},${100 * (1 - end ** share)}`);
  element("full").textContent = `${full_um} µm`;
  element("middle").setAttribute("points", line(floor).join(" "));
  element("interval").setAttribute("points", [...line(low), ...line(high).reverse()].join(" "));
  element("answers").hidden = true;
  element("result").hidden = false;
  socket.close();
}

function press(name) {
  if (element(name).disabled) return;
  enable(false);
  socket.send(name);
}

for (const button of buttons) button.addEventListener("click", () => press(button.id));
document.addEventListener("keydown", (event) => {
  const name = KEYS[event.key.toLowerCase()];
  if (name !== undefined && !event.repeat && !event.ctrlKey && !event.metaKey && !event.altKey) press(name);
});
document.addEventListener("visibilitychange", () => (document.hidden ? socket?.close() : open()));
open();
