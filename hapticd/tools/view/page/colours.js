// The field's colours: viridis (van der Walt and Smith, CC0), perceptually uniform, and distinguishable without red and green.

const ANCHORS = ("440154 470d60 48186a 482374 472d7b 453781 424086 3e4989 3b528b 375b8d 33638d " +
  "2f6b8e 2c728e 297a8e 26828e 23898e 21918c 1f988b 1fa088 22a785 28ae80 32b67a " +
  "3fbc73 4ec36b 5ec962 70cf57 84d44b 98d83e addc30 c2df23 d8e219 ece51b fde725").split(" ");

export const LEVELS = 256;

/** LEVELS colours as 32-bit pixels of an ImageData, from none to full. */
export const PIXELS = new Uint32Array(LEVELS);
for (let level = 0; level < LEVELS; level++) {
  const place = (level / (LEVELS - 1)) * (ANCHORS.length - 1);
  const below = Math.min(Math.floor(place), ANCHORS.length - 2);
  const [r, g, b] = [0, 2, 4].map((at) => {
    const [low, high] = [below, below + 1].map((anchor) => parseInt(ANCHORS[anchor].slice(at, at + 2), 16));
    return Math.round(low + (high - low) * (place - below));
  });
  PIXELS[level] = (255 << 24 | b << 16 | g << 8 | r) >>> 0;
}

/** The page's own colours, as the style sheet has them in this light. */
export function theme() {
  const style = getComputedStyle(document.documentElement);
  const names = ["ink", "quiet", "line", "card", "slip", "stick", "alone", "asked", "bad", "bar"];
  return Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
}

/** The canvas's context, its pixels matched to the screen's; drawing is in CSS pixels. */
export function prepared(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height };
}
