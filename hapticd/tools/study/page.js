"use strict";

const LETTERS = { f: "high", j: "low", p: "pause", Enter: "next" };
const NAMES = { high: "F", low: "J", pause: "P", next: "Enter" };
const EVERY_MS = 100;

const heading = document.getElementById("heading");
const text = document.getElementById("text");
const note = document.getElementById("note");
const buttons = document.querySelectorAll("button");
let screen = { number: -1, keys: {} };
let isDone = false;

function draw(next) {
  note.textContent = next.note;
  if (next.number === screen.number) return;
  screen = next;
  heading.textContent = next.heading;
  text.textContent = next.text;
  for (const button of buttons) {
    const what = next.keys[button.dataset.key];
    button.hidden = what === undefined;
    if (button.hidden) continue;
    const key = document.createElement("kbd");
    key.textContent = NAMES[button.dataset.key];
    button.replaceChildren(what, key);
    button.blur();
  }
}

async function look() {
  try {
    draw(await (await fetch("now/screen")).json());
    isDone = heading.textContent === "Thank you";
  } catch {
    note.textContent = isDone ? "" : "hapticd study does not answer: is it still running?";
  }
  setTimeout(look, EVERY_MS);
}

function press(key) {
  if (!(key in screen.keys)) return;
  fetch("press", { method: "POST", body: JSON.stringify({ number: screen.number, key }) }).catch(() => {});
}

for (const button of buttons) button.addEventListener("click", () => press(button.dataset.key));
document.addEventListener("keydown", (event) => {
  const key = LETTERS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (key === undefined || event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  press(key);
});
look();
