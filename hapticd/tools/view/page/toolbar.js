// The toolbar: what the pointer does, what is drawn, the Record button and the help.

import { write } from "./fingers.js";

const SIDE = 32; // of a picture on the plate: what a page's message has room for
const SLIPPERY = 0.2; // the friction under a click and a hum
const CLICK = { height_um: 1.5, length_s: 0.02, rise_s: 0.002 };
const AMOUNTS = {
  friction: { min: 0, max: 1, step: 0.05, value: SLIPPERY, name: "Friction, of bare glass's", text: (value) => value.toFixed(2) },
  texture: { min: 2, max: 20, step: 1, value: 6, name: "Distance of the ridges, mm", text: (value) => `${value} mm` },
  picture: { min: 0.2, max: 2, step: 0.1, value: 1.5, name: "Amplitude where it is white, µm", text: (value) => `${value.toFixed(1)} µm` },
  click: { min: 0.5, max: 2, step: 0.1, value: 1.5, name: "Height of the click, µm", text: (value) => `${value.toFixed(1)} µm` },
  hum: { min: 20, max: 200, step: 10, value: 60, name: "Frequency of the hum, Hz", text: (value) => `${value} Hz` },
};

/** What the pointer does: `value` names the tool that is pressed, and "change" follows a choice. */
export class Tools extends EventTarget {
  constructor(box) {
    super();
    this.buttons = [...box.querySelectorAll("[data-tool]")];
    this.value = "touch";
    box.addEventListener("click", (event) => this.choose(event.target.closest("[data-tool]")?.dataset.tool));
    box.addEventListener("keydown", (event) => this.key(event));
    this.show();
  }

  choose(name) {
    if (!name || name === this.value) return;
    this.value = name;
    this.show();
    this.dispatchEvent(new Event("change"));
  }

  key(event) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const at = this.buttons.findIndex((button) => button.dataset.tool === this.value);
    const next = this.buttons.at((at + step) % this.buttons.length);
    this.choose(next.dataset.tool);
    next.focus();
  }

  show() {
    for (const button of this.buttons) {
      const isIt = button.dataset.tool === this.value;
      button.setAttribute("aria-checked", isIt);
      button.tabIndex = isIt ? 0 : -1;
    }
  }
}

/** What a new layer holds: its content as in a `targets` message, and the effect on it. */
export class LayerContent {
  constructor({ kind, amount, text, button, file }, notice) {
    Object.assign(this, { kind, amount, text, button, file, notice });
    this.levels = null; // of the picture, in base64
    kind.addEventListener("change", () => this.change());
    amount.addEventListener("input", () => this.show());
    button.addEventListener("click", () => file.click());
    file.addEventListener("change", () => this.read());
    this.change();
  }

  change() {
    const { min, max, step, value, name } = AMOUNTS[this.kind.value];
    Object.assign(this.amount, { min, max, step, value });
    this.amount.setAttribute("aria-label", name);
    this.amount.title = name;
    this.button.hidden = this.kind.value !== "picture";
    if (this.kind.value === "picture" && !this.levels) this.file.click();
    this.show();
  }

  show() {
    write(this.text, AMOUNTS[this.kind.value].text(Number(this.amount.value)));
  }

  /** Make the chosen picture small and grey. */
  async read() {
    try {
      const image = await createImageBitmap(this.file.files[0]);
      const context = new OffscreenCanvas(SIDE, SIDE).getContext("2d");
      context.drawImage(image, 0, 0, SIDE, SIDE);
      const { data } = context.getImageData(0, 0, SIDE, SIDE);
      const levels = Array.from({ length: SIDE * SIDE }, (_, i) =>
        Math.round(0.3 * data[4 * i] + 0.59 * data[4 * i + 1] + 0.11 * data[4 * i + 2]));
      this.levels = btoa(String.fromCharCode(...levels));
      write(this.button, this.file.files[0].name.slice(0, 14));
    } catch {
      this.notice("That file is no picture which this browser reads: choose a PNG or a JPEG.", 6000);
    }
  }

  /** The content of a layer `name`, or null where none was chosen. */
  of(name) {
    const value = Number(this.amount.value);
    const slippery = { content: { friction: SLIPPERY }, about: `${this.kind.value} ${this.text.textContent}` };
    switch (this.kind.value) {
      case "friction":
        return { content: { friction: value } };
      case "texture":
        return { content: { grating: { period_mm: value, high_um: 1.5 } } };
      case "picture":
        if (!this.levels) this.notice("Choose a picture first: it is laid into the shape that you draw.", 6000);
        return this.levels && { content: { map: { width: SIDE, height: SIDE, levels: this.levels, high_um: value } } };
      case "click":
        return { ...slippery, effect: { name, surface: name, pulse: { ...CLICK, height_um: value }, start: { cause: "entering", surface: name } } };
      default:
        return { ...slippery, effect: { name, surface: name, modulation: { frequency_hz: value }, start: { cause: "entering", surface: name } } };
    }
  }
}

/** Begins and ends a recording of the viewer's, and shows for how long it runs. */
export class RecordButton {
  constructor(button, send, notice) {
    Object.assign(this, { button, send, notice });
    this.t_begun_ms = null;
    button.addEventListener("click", () => send({ op: "record", is_on: this.t_begun_ms === null }));
    setInterval(() => this.show(), 500);
  }

  take({ is_on, file, sentence }) {
    this.t_begun_ms = is_on ? this.t_begun_ms ?? Date.now() : null;
    this.button.title = is_on ? `Recording to ${file}: press to end it` : "Record to a file, for hapticd export and Foxglove";
    if (!is_on) this.notice(sentence, 12000, true);
    this.show();
  }

  show() {
    const s = this.t_begun_ms === null ? null : Math.floor((Date.now() - this.t_begun_ms) / 1000);
    this.button.setAttribute("aria-pressed", s !== null);
    write(this.button.lastElementChild, s === null ? "Record" : `${Math.floor(s / 60)}:${String(s % 60).padStart(2, "0")}`);
  }
}

/** The help, which a press outside closes. */
export function openHelp(button, box) {
  const show = (isOpen) => {
    box.hidden = !isOpen;
    button.setAttribute("aria-expanded", isOpen);
  };
  button.addEventListener("click", () => show(box.hidden));
  document.addEventListener("pointerdown", (event) => {
    if (!box.contains(event.target) && event.target !== button) show(false);
  });
  document.addEventListener("keydown", (event) => event.key === "Escape" && show(false));
}
