// Charts: the modes' phasors, the delays, and the colours.

import { LEVELS, PIXELS, prepared } from "./colours.js";
import { brightness } from "./field.js";

const SPANS = { age: "age of a touch", compute: "computing", link: "way to the board", horizon: "predicted ahead" };
const NARROW = 90; // pixels of a mode's cell
const IN_A_ROW = 5; // modes; more take two rows, with their names left of the rings

/** Draw the colours of the field, which end at `full_um`. */
export function drawScale(canvas, full_um, colours) {
  const { context, width } = prepared(canvas);
  const tall = 10;
  for (let x = 0; x < width; x++) {
    const level = Math.round((x / (width - 1)) * (LEVELS - 1));
    const [r, g, b] = [0, 8, 16].map((shift) => (PIXELS[level] >> shift) & 255);
    context.fillStyle = `rgb(${r} ${g} ${b})`;
    context.fillRect(x, 0, 1, tall);
  }
  const ticks = [0, 0.1, 0.5, 1, 2, 4, 8, 16].filter((um) => um <= full_um).map((um) => [brightness(um, full_um), `${um}`]);
  context.font = "11px system-ui, sans-serif";
  context.fillStyle = colours.quiet;
  let end = 0;
  for (const [part, text] of ticks) {
    const wide = context.measureText(text).width;
    const begin = Math.min(Math.max(part * width - wide / 2, 0), width - wide);
    context.fillRect(Math.min(Math.round(part * width), width - 1), tall, 1, 4);
    if (begin < end) continue; // the one before leaves no room
    context.fillText(text, begin, tall + 15);
    end = begin + wide + 3;
  }
}

/** Draw each mode's phasor against its limit: reference and best known value. */
export function drawModes(canvas, modes, limits_um, colours) {
  const { context, width, height } = prepared(canvas);
  const rows = limits_um.length > IN_A_ROW ? 2 : 1;
  const columns = Math.ceil(limits_um.length / rows);
  const [cell, tall] = [width / columns, height / rows];
  const [margin, above] = rows > 1 ? [16, 4] : [12, cell < NARROW ? 20 : 13]; // of a ring, for its names
  const radius = Math.max(Math.min(cell / 2 - margin, tall / 2 - above), 1); // not laid out yet
  context.font = "12px system-ui, sans-serif";
  for (let mode = 0; mode < limits_um.length; mode++) {
    const [column, row] = [mode % columns, Math.floor(mode / columns)];
    const [x, y] = rows === 1 ? [cell * (column + 0.5), tall / 2 + (cell < NARROW ? 1 : 8)] : [cell * (column + 1) - radius - 4, tall * (row + 0.5)];
    const scale = radius / limits_um[mode];
    context.lineWidth = 1;
    context.strokeStyle = colours.line;
    for (const part of [0.5, 1]) {
      context.beginPath();
      context.arc(x, y, radius * part, 0, 2 * Math.PI);
      context.stroke();
    }
    context.beginPath();
    context.moveTo(x - radius, y);
    context.lineTo(x + radius, y);
    context.moveTo(x, y - radius);
    context.lineTo(x, y + radius);
    context.stroke();
    context.fillStyle = colours.quiet;
    const [name, limit] = [`${mode}`, `${Number(limits_um[mode].toFixed(2))} µm`];
    if (rows > 1) {
      context.textAlign = "left";
      context.fillText(name, cell * column + 2, y - 3);
      context.fillText(limits_um[mode].toFixed(1), cell * column + 2, y + 13);
    } else if (cell < NARROW) {
      context.textAlign = "center";
      context.fillText(name, x, y - radius - 6);
      context.fillText(limit, x, y + radius + 14);
    } else {
      context.textAlign = "left";
      context.fillText(name, cell * column + 4, 12);
      context.textAlign = "right";
      context.fillText(limit, cell * (column + 1) - 4, 12);
    }
    for (const { phasors, colour, wide } of modes) {
      const w_um = phasors[mode];
      if (!w_um) continue;
      const [dx, dy] = [(w_um[0] ?? 0) * scale, -(w_um[1] ?? 0) * scale];
      context.strokeStyle = context.fillStyle = colour;
      context.lineWidth = wide;
      context.beginPath();
      context.moveTo(x, y);
      context.lineTo(x + dx, y + dy);
      context.stroke();
      context.beginPath();
      context.arc(x + dx, y + dy, wide + 1, 0, 2 * Math.PI);
      context.fill();
    }
  }
  context.textAlign = "left";
}

/** Three digits or so: there is no room for more. */
const short = (ms) => ms.toFixed(ms < 99.95 ? 1 : 0);

/** Draw a histogram of each delay, all on one axis in milliseconds. */
export function drawLatency(canvas, histograms, colours) {
  const { context, width, height } = prepared(canvas);
  const names = Object.keys(SPANS).filter((name) => histograms[name]);
  context.font = "12px system-ui, sans-serif";
  if (names.length === 0) {
    context.fillStyle = colours.quiet;
    context.fillText("No frame was sent yet.", 0, 20);
    return;
  }
  const full_ms = Math.max(...names.map((name) => Math.min(1.25 * histograms[name].p99_ms, 3 * histograms[name].p50_ms)));
  const [left, right, row] = [104, 76, (height - 16) / names.length];
  const to = (ms) => left + (Math.min(ms, full_ms) / full_ms) * (width - left - right);
  names.forEach((name, index) => {
    const { buckets, p50_ms, p99_ms } = histograms[name];
    const floor = row * (index + 1) - 3;
    context.fillStyle = colours.quiet;
    context.fillText(SPANS[name], 0, floor - 2);
    context.fillStyle = colours.ink;
    context.fillText(`${short(p50_ms)} / ${short(p99_ms)}`, width - right + 10, floor - 2);
    let below_ms = 0;
    const most = Math.max(...buckets.map(([above, count], i) => count / (above - (buckets[i - 1]?.[0] ?? 0) || 1)));
    context.fillStyle = colours.bar;
    for (const [above_ms, count] of buckets) {
      const dense = count / (above_ms - below_ms || 1) / most;
      const tall = count > 0 ? Math.max(dense * (row - 7), 1) : 0;
      const begin = to(below_ms);
      if (below_ms < full_ms) context.fillRect(begin, floor - tall, Math.max(to(above_ms) - begin - 0.5, 1), tall);
      below_ms = above_ms;
    }
    context.fillStyle = colours.line;
    context.fillRect(left, floor, width - left - right, 1);
  });
  context.fillStyle = colours.quiet;
  context.fillText("0", left, height - 3);
  context.textAlign = "right";
  context.fillText(`${full_ms.toFixed(0)} ms`, width - right, height - 3);
  context.textAlign = "left";
  context.fillText("half / 99 %", width - right + 10, height - 3);
}

