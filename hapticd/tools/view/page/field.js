// The plate's vibration over its whole face: |W(x, y)| = |sum of W_k phi_k(x, y)|; the shapes are loaded once.

import { LEVELS, PIXELS } from "./colours.js";

/** The part of the colours, 0 to 1, at |W|: its square root, for small amplitudes matter as much as large ones. */
export const brightness = (w_um, full_um) => Math.sqrt(w_um / full_um);

export class Field {
  /** `shapes` holds a grid for each mode, rows from the top (+y) down; `size_mm` is the plate's width and depth.
   * The brightest colour is the largest |W| that the modes' limits `w_limit_um` allow. */
  constructor(shapes, size_mm, w_limit_um) {
    const modes = w_limit_um.length;
    this.modes = modes;
    this.size_mm = size_mm;
    this.full_um = w_limit_um.reduce((sum, limit_um) => sum + limit_um, 0);
    this.side = Math.round(Math.sqrt(shapes.length / modes));
    this.cells = this.side * this.side;
    this.shapes = Array.from({ length: modes }, (_, k) => shapes.subarray(k * this.cells, (k + 1) * this.cells));
    this.real = new Float32Array(this.cells);
    this.imaginary = new Float32Array(this.cells);
    this.inPhase = new Float32Array(this.cells);
    this.image = new ImageData(this.side, this.side);
    this.pixels = new Uint32Array(this.image.data.buffer);
    this.canvas = new OffscreenCanvas(this.side, this.side);
  }

  /** Compute the field of the modes' phasors [[d, q], ..]; returns the largest |W| in um. */
  update(modal_um) {
    const { real, imaginary, cells } = this;
    real.fill(0);
    imaginary.fill(0);
    for (let k = 0; k < Math.min(this.modes, modal_um.length); k++) {
      const shape = this.shapes[k];
      const [d, q] = [modal_um[k][0] ?? 0, modal_um[k][1] ?? 0];
      if (d !== 0) for (let i = 0; i < cells; i++) real[i] += d * shape[i];
      if (q !== 0) for (let i = 0; i < cells; i++) imaginary[i] += q * shape[i];
    }
    let largest = 0;
    for (let i = 0; i < cells; i++) {
      const w_um = Math.sqrt(real[i] * real[i] + imaginary[i] * imaginary[i]); // a tenth of Math.hypot's time
      if (w_um > largest) largest = w_um;
      this.pixels[i] = PIXELS[Math.min(LEVELS - 1, brightness(w_um, this.full_um) * (LEVELS - 1)) | 0];
    }
    this.canvas.getContext("2d").putImageData(this.image, 0, 0);
    return largest;
  }

  /** Draw it into a rectangle, smooth between the grid's points, which lie on the plate's edges. */
  draw(context, width, height) {
    const half = 0.5;
    context.imageSmoothingEnabled = true;
    context.imageSmoothingQuality = "high";
    const last = this.side - 1;
    context.drawImage(this.canvas, half, half, last, last, 0, 0, width, height);
  }

  /** |W| at a place, for any phasors. */
  at(modal_um, x_mm, y_mm) {
    const last = this.side - 1;
    const column = Math.min(Math.max((x_mm / this.size_mm[0] + 0.5) * last, 0), last);
    const row = Math.min(Math.max((0.5 - y_mm / this.size_mm[1]) * last, 0), last);
    const [left, top] = [Math.min(Math.floor(column), last - 1), Math.min(Math.floor(row), last - 1)];
    const [u, v] = [column - left, row - top];
    let [real, imaginary] = [0, 0];
    for (let k = 0; k < Math.min(this.modes, modal_um.length); k++) {
      const shape = this.shapes[k];
      const i = top * this.side + left;
      const upper = shape[i] * (1 - u) + shape[i + 1] * u;
      const lower = shape[i + this.side] * (1 - u) + shape[i + this.side + 1] * u;
      const phi = upper * (1 - v) + lower * v;
      real += (modal_um[k][0] ?? 0) * phi;
      imaginary += (modal_um[k][1] ?? 0) * phi;
    }
    return Math.hypot(real, imaginary);
  }

  /** The node lines as one path in a rectangle: where the motion in phase with the strongest is zero. */
  nodes(width, height, modal_um) {
    const path = new Path2D();
    const strongest = modal_um.reduce((a, b) => (Math.hypot(...b) > Math.hypot(...a) ? b : a), [0, 0]);
    const size = Math.hypot(...strongest);
    if (!(size > 0)) return path;
    const [cos, sin] = [strongest[0] / size, strongest[1] / size];
    const { real, imaginary, side, inPhase } = this;
    for (let i = 0; i < this.cells; i++) inPhase[i] = real[i] * cos + imaginary[i] * sin;
    const [dx, dy] = [width / (side - 1), height / (side - 1)];
    for (let row = 0; row < side - 1; row++) {
      for (let column = 0; column < side - 1; column++) {
        const i = row * side + column;
        const isBelow = inPhase[i] < 0;
        if (inPhase[i + 1] < 0 === isBelow && inPhase[i + side] < 0 === isBelow && inPhase[i + side + 1] < 0 === isBelow) {
          continue; // most cells
        }
        const corners = [inPhase[i], inPhase[i + 1], inPhase[i + side + 1], inPhase[i + side]];
        const crossings = [];
        for (let edge = 0; edge < 4; edge++) {
          const [a, b] = [corners[edge], corners[(edge + 1) % 4]];
          if (a < 0 !== b < 0) crossings.push(crossing(edge, a / (a - b), column, row));
        }
        for (let end = 0; end + 1 < crossings.length; end += 2) {
          path.moveTo(crossings[end][0] * dx, crossings[end][1] * dy);
          path.lineTo(crossings[end + 1][0] * dx, crossings[end + 1][1] * dy);
        }
      }
    }
    return path;
  }
}

function crossing(edge, part, column, row) {
  if (edge === 0) return [column + part, row];
  if (edge === 1) return [column + 1, row + part];
  if (edge === 2) return [column + 1 - part, row + 1];
  return [column, row + 1 - part];
}
