// The time strip: of each finger the friction it feels against what was asked, and its vibration, over the last 30 s.

import { prepared } from "./colours.js";
import { SPAN_S } from "./history.js";

const FULL_UM = 2;
const GAP_S = 0.5; // a finger that was away for longer has another line
const JND = 0.11; // a difference in friction that is just noticed
const [LEFT, RIGHT, FLOOR, GAP] = [34, 18, 18, 16]; // pixels around the lanes, and between them
const LETTERS = 12; // pixels of a line of text
const EVERY_S = 5;
const MARKS = { landed: "▾", lifted: "▴", begun: "◆" };

/** Draw the lanes, and while paused the instant shown. `least_friction` is that of full vibration. */
export function drawStrip(canvas, history, colours) {
  const { context, width, height } = prepared(canvas);
  context.font = "11.5px system-ui, sans-serif";
  const hasFriction = history.frames.some(({ fingers }) => fingers.some(({ felt_friction }) => felt_friction !== null));
  const lanes = lanesOf(hasFriction, height);
  const newest = history.newest;
  const along = (t_s) => LEFT + (1 + (t_s - newest.t_s) / SPAN_S) * (width - LEFT - RIGHT);
  grid(context, lanes, width, height, colours);
  if (!newest) return;
  for (const lane of lanes) lines(context, lane, history.frames, along, colours);
  marks(context, history.frames, along, lanes, colours);
  const x = Math.min(along(newest.t_s - history.back_s), width - 2);
  if (history.paused) {
    context.fillStyle = colours.ink;
    context.fillRect(x - 1, 0, 2, height - FLOOR + 4);
  }
  for (const lane of lanes) names(context, lane, history, x, colours);
}

/** How many seconds before the newest a place of the strip is, from its left. */
export function backAt(x, width) {
  return Math.min(Math.max((1 - (x - LEFT) / (width - LEFT - RIGHT)) * SPAN_S, 0), SPAN_S);
}

function lanesOf(hasFriction, height) {
  const um = { name: "vibration, µm", ticks: [0, 1, 2], full: FULL_UM, value: ({ gets_um }) => gets_um,
    asked: ({ target_um }) => target_um, near: 0 };
  if (!hasFriction) return [{ ...um, top: GAP, bottom: height - FLOOR }];
  const part = Math.round((height - FLOOR) * 0.58);
  const friction = { name: "friction that is felt: 1 sticky, 0 slippery", ticks: [0, 0.5, 1], full: 1.1,
    value: ({ felt_friction }) => felt_friction, asked: ({ asked_friction }) => asked_friction, near: JND };
  return [{ ...friction, top: GAP, bottom: part }, { ...um, top: part + GAP + 12, bottom: height - FLOOR }];
}

/** At the instant shown, which line is which finger's; its value too while paused. */
function names(context, lane, { current, paused }, x, colours) {
  const places = current.fingers
    .filter((finger) => lane.value(finger) !== null && lane.value(finger) !== undefined)
    .map((finger) => ({ finger, value: lane.value(finger), y: up(lane, lane.value(finger)) }))
    .toSorted((one, other) => one.y - other.y);
  context.textBaseline = "middle";
  places.forEach((one, i) => (one.y = Math.max(one.y, i > 0 ? places[i - 1].y + LETTERS : -Infinity)));
  let most = lane.bottom;
  for (const { finger, value, y } of places.toReversed()) {
    const text = paused ? `${finger.id}: ${value.toFixed(2)}` : `${finger.id}`;
    const wide = context.measureText(text).width;
    const [from, at] = [x + 5 + wide > context.canvas.clientWidth ? x - wide - 6 : x + 5, Math.min(y, most)];
    context.fillStyle = colours.card; // legible over lines
    context.fillRect(from - 2, at - LETTERS / 2, wide + 4, LETTERS);
    context.fillStyle = colourOf(finger, colours);
    context.fillText(text, from, at);
    most = at - LETTERS;
  }
  context.textBaseline = "alphabetic";
}

const colourOf = ({ target_um }, { alone, stick, slip }) => (target_um === null ? alone : target_um === 0 ? stick : slip);

const up = ({ top, bottom, full }, value) => bottom - (Math.min(value, full) / full) * (bottom - top);

function grid(context, lanes, width, height, colours) {
  context.textBaseline = "middle";
  for (const lane of lanes) {
    for (const tick of lane.ticks) {
      const y = Math.round(up(lane, tick));
      context.fillStyle = colours.line;
      context.fillRect(LEFT, y, width - LEFT - RIGHT, 1);
      context.fillStyle = colours.quiet;
      context.textAlign = "right";
      context.fillText(`${tick}`, LEFT - 6, y);
    }
    context.textAlign = "left";
    context.fillText(lane.name, LEFT, lane.top - 9);
  }
  context.textAlign = "center";
  for (let s = EVERY_S; s < SPAN_S; s += EVERY_S) {
    const x = Math.round(LEFT + (1 - s / SPAN_S) * (width - LEFT - RIGHT));
    context.fillStyle = colours.line;
    for (const { top, bottom } of lanes) context.fillRect(x, top, 1, bottom - top);
    context.fillStyle = colours.quiet;
    context.fillText(`${-s} s`, x, height - 7);
  }
  context.textAlign = "left";
  context.textBaseline = "alphabetic";
}

function lines(context, lane, frames, along, colours) {
  const open = new Map(); // by finger
  let last_x = -Infinity;
  context.save();
  context.beginPath();
  context.rect(LEFT, lane.top - 2, context.canvas.width, lane.bottom - lane.top + 4);
  context.clip();
  for (const frame of frames) {
    const x = along(frame.t_s);
    if (x - last_x < 0.7 && frame !== frames.at(-1)) continue;
    last_x = x;
    for (const finger of frame.fingers) {
      const [value, asked] = [lane.value(finger), lane.asked(finger)];
      if (value === null) continue;
      const colour = colourOf(finger, colours);
      let line = open.get(finger.id);
      if (line && (line.colour !== colour || frame.t_s - line.t_s > GAP_S)) {
        stroke(context, lane, line);
        line = null;
      }
      line ??= { colour, points: [] };
      line.points.push([x, up(lane, value), asked === null || asked === undefined ? null : asked]);
      line.t_s = frame.t_s;
      line.id = finger.id;
      open.set(finger.id, line);
    }
  }
  for (const line of open.values()) stroke(context, lane, line);
  context.restore();
}

/** A line, what was asked for it (dashed), and the band in which a difference is not noticed. */
function stroke(context, lane, { colour, points }) {
  context.strokeStyle = context.fillStyle = colour;
  context.lineJoin = "round";
  const asked = points.filter(([, , value]) => value !== null);
  if (asked.length > 1 && lane.near > 0) {
    context.globalAlpha = 0.13;
    context.beginPath();
    asked.forEach(([x, , value]) => context.lineTo(x, up(lane, value * (1 + lane.near))));
    asked.toReversed().forEach(([x, , value]) => context.lineTo(x, up(lane, value * (1 - lane.near))));
    context.fill();
    context.globalAlpha = 1;
  }
  const trace = (places, wide, dash) => {
    context.setLineDash(dash);
    context.lineWidth = wide;
    context.beginPath();
    places.forEach(([x, y]) => context.lineTo(x, y));
    context.stroke();
  };
  if (asked.length > 1) trace(asked.map(([x, , value]) => [x, up(lane, value)]), 1, [3, 3]);
  trace(points, 1.75, []);
  context.setLineDash([]);
}

/** Landings, lifts and effects, above the lanes. */
function marks(context, frames, along, lanes, colours) {
  context.fillStyle = colours.quiet;
  context.textAlign = "center";
  const bottom = lanes.at(-1).bottom;
  for (const { t_s, events } of frames) {
    for (const { kind } of events) {
      if (!MARKS[kind]) continue;
      const x = along(t_s);
      context.globalAlpha = 0.25;
      context.fillRect(Math.round(x), lanes[0].top, 1, bottom - lanes[0].top);
      context.globalAlpha = 1;
      if (x > LEFT + 4) context.fillText(MARKS[kind], x, lanes[0].top - 1);
    }
  }
  context.textAlign = "left";
}
