// First light in the browser: shows the newest document of `hapticd first-light --view`, and sends presses on its buttons.

const ALIVE_EVERY_MS = 500;
const AGAIN_MS = 1000;

const at = (id) => document.getElementById(id);
const key = new URLSearchParams(location.search).get("key") ?? "";
let socket = null;
let shown = { number: 0, place: -1 };

function made(name, text, data = {}) {
  const element = document.createElement(name);
  element.textContent = text;
  Object.assign(element.dataset, data);
  return element;
}

function dedented(drawing) {
  return drawing.replace(/^ {3}/gm, "");
}

function send(press) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(press));
}

function press(button) {
  send({ number: shown.number, button, text: at("reading").value.slice(0, 40) });
}

function drawSteps({ steps, place }) {
  at("steps").replaceChildren(...steps.map((step, number) => {
    const item = made("li", step.title, { number: number + 1 });
    item.classList.toggle("passed", step.passed !== "");
    item.title = step.passed;
    if (number === place) item.setAttribute("aria-current", "step");
    return item;
  }));
  at("steps").children[place].scrollIntoView({ block: "nearest", inline: "center" });
}

function drawResult(result) {
  at("result").hidden = result === null;
  if (result === null) return;
  at("chart").textContent = dedented(result.chart);
  at("figures").replaceChildren(...result.figures.flatMap(([name, value]) => [made("dt", name), made("dd", value)]));
  at("verdict").className = result.passed ? "passed" : "";
  at("verdict").replaceChildren(...result.sentences.map((sentence) => made("li", sentence)));
}

function drawAnswer({ question, isReading, buttons }) {
  at("question").textContent = question;
  at("reading").hidden = !isReading;
  at("reading").value = "";
  at("buttons").replaceChildren(...Object.entries(buttons).map(([name, label]) => {
    const button = made("button", label, { button: name });
    button.type = "button";
    button.addEventListener("click", () => press(name));
    return button;
  }));
  if (isReading) at("reading").focus();
}

function draw(next) {
  if (next.number <= shown.number) return;
  const isNewStep = next.place !== shown.place;
  shown = next;
  at("state").className = "";
  at("state").textContent = next.isOver ? "" : next.isRunning ? "Running" : "Still";
  drawSteps(next);
  at("heading").textContent = next.heading;
  at("todo").textContent = next.todo;
  at("picture").textContent = dedented(next.picture);
  at("notes").replaceChildren(...next.notes.map((note) => made("li", note)));
  drawResult(next.result);
  drawAnswer(next);
  if (isNewStep) scrollTo(0, 0);
}

function lost(reason) {
  at("buttons").replaceChildren();
  at("state").className = "bad";
  at("state").textContent = reason || "hapticd first-light does not answer: is it still running?";
}

function open() {
  socket = new WebSocket(`ws://${location.host}/socket?key=${encodeURIComponent(key)}`);
  socket.addEventListener("open", () => { shown = { number: 0, place: -1 }; });
  socket.addEventListener("message", (event) => draw(JSON.parse(event.data)));
  socket.addEventListener("close", (event) => {
    if (shown.isOver) return;
    lost(event.reason);
    setTimeout(open, AGAIN_MS);
  });
}

at("answer").addEventListener("submit", (event) => {
  event.preventDefault();
  if (shown.isReading) press(at("reading").value.trim() === "" ? "none" : "enter");
});
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") press("stop");
});
setInterval(() => send({}), ALIVE_EVERY_MS);
open();
