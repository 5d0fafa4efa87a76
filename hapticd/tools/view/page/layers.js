// Layer over the field: the server computes it while it is selected. Light is full, dark is empty.

import { write } from "./fingers.js";

const AGAIN_MS = 250;
const NOTHING = 255; // the level for no value
const FULL = 254;
const DENSEST = 225; // of 255: the field shines through

export class LayerMenu {
  /** `fetch` returns the levels of a layer by its name and the id `mover` of a finger, null for one more. */
  constructor(box, menu, text, fetch, mover) {
    this.box = box;
    this.menu = menu;
    this.text = text;
    this.fetch = fetch;
    this.mover = mover;
    this.canvas = null;
    this.isAsking = false;
    setInterval(() => this.refresh(), AGAIN_MS);
    menu.addEventListener("change", () => this.refresh());
  }

  offer(names) {
    this.box.hidden = names.length === 0;
    this.menu.replaceChildren(new Option("none", ""), ...names.map((name) => new Option(name, name)));
    this.canvas = null;
  }

  async refresh() {
    const name = this.menu.value;
    this.text.hidden = name === "";
    if (name === "") {
      this.canvas = null;
      return;
    }
    if (this.isAsking) return;
    this.isAsking = true;
    const mover = this.mover();
    try {
      const levels = await this.fetch(name, mover);
      if (this.menu.value !== name) return;
      this.canvas = picture(levels);
      write(this.text, description(name, mover, levels));
    } catch {
      this.canvas = null; // the daemon is gone, which the state line shows
    } finally {
      this.isAsking = false;
    }
  }
}

/** Text: the meaning of the light area, and its share of the plate. */
function description(name, mover, levels) {
  if (levels.every((level) => level === NOTHING)) return "No finger is slippery: nothing stands in the way.";
  const full = levels.reduce((sum, level) => sum + (level === FULL), 0);
  const who = mover === null ? "one more finger" : `finger ${mover}`;
  return `Light: where ${who} ${name} and all reach their targets, ${Math.round((full / levels.length) * 100)} % of the plate.`;
}

function picture(levels) {
  const side = Math.round(Math.sqrt(levels.length));
  const image = new ImageData(side, side);
  levels.forEach((level, i) => {
    const light = Math.round((level / FULL) * 255);
    image.data.set([light, light, light, level === NOTHING ? 0 : DENSEST], 4 * i);
  });
  const canvas = new OffscreenCanvas(side, side);
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}
