"use strict";

const EVERY_MS = 100;

const heading = document.getElementById("heading");
const text = document.getElementById("text");
const note = document.getElementById("note");
const answers = document.getElementById("answers");
const others = document.getElementById("others");
let screen = { number: -1, keys: [] };
let isDone = false;

function button(key) {
  const made = document.createElement("button");
  made.dataset.key = key.name;
  const letter = document.createElement("kbd");
  letter.textContent = key.letter.charAt(0).toUpperCase() + key.letter.slice(1);
  made.append(key.label, letter);
  made.addEventListener("click", () => press(key.name));
  return made;
}

function draw(next) {
  note.textContent = next.note;
  if (next.number === screen.number) return;
  screen = next;
  heading.textContent = next.heading;
  text.textContent = next.text;
  const isOther = (key) => key.name === "next" || key.name === "pause";
  answers.replaceChildren(...next.keys.filter((key) => !isOther(key)).map(button));
  others.replaceChildren(...next.keys.filter(isOther).map(button));
}

async function look() {
  try {
    draw(await (await fetch("screen" + location.search)).json());
    isDone = heading.textContent === "Thank you";
  } catch {
    note.textContent = isDone ? "" : "hapticd study does not answer: is it still running?";
  }
  setTimeout(look, EVERY_MS);
}

function press(key) {
  fetch("press" + location.search, { method: "POST", body: JSON.stringify({ number: screen.number, key }) }).catch(() => {});
}

document.addEventListener("keydown", (event) => {
  const key = screen.keys.find((one) => one.letter === event.key.toLowerCase());
  if (key === undefined || event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  press(key.name);
});
look();
