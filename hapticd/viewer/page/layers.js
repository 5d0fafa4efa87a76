// What can be laid over the field: the server computes it while it is chosen. Light is full, dark is empty.

const AGAIN_MS = 500;
const NOTHING = 255; // the level that says nothing
const FULL = 254;
const DENSEST = 190; // of 255: the field stays to be seen

export class LayerMenu {
  /** `fetch` gives the levels of a layer by its name. */
  constructor(box, menu, fetch) {
    this.box = box;
    this.menu = menu;
    this.fetch = fetch;
    this.canvas = null;
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
    if (name === "") {
      this.canvas = null;
      return;
    }
    try {
      const levels = await this.fetch(name);
      if (this.menu.value === name) this.canvas = picture(levels);
    } catch {
      this.canvas = null; // the daemon is away: the page says so elsewhere
    }
  }
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
