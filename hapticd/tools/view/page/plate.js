// Picture of the plate: field, node lines, and true, sampled and predicted fingers.

import { prepared } from "./colours.js";
import { motion } from "./history.js";

const LEAST_UM = 0.02; // a plate that moves less than this has no node lines to show
// The colours of a contact, red, green and blue: with the friction of bare glass, and with that at 1 um.
const [STUCK, SLID] = [[255, 184, 119], [143, 211, 255]];

export class PlatePicture {
  constructor(canvas) {
    this.canvas = canvas;
    this.field = null;
    this.radius_mm = 5; // of the contacts
    this.least_friction = 0; // that at 1 um
  }

  /** Draw a frame; `chosen` is the id of the selected finger, `invitation` a text over all, `surfaces` what draws those of the frame, `drawing` what is being drawn,
   * `effects` those that play and `recent` the frames before this one. */
  draw(frame, { chosen, isLive, invitation, surfaces, drawing, effects, recent }) {
    const { context, width, height } = prepared(this.canvas);
    if (!frame || !this.field) {
      if (invitation) invite(context, invitation, width, height);
      return;
    }
    const { modal_um } = motion(frame);
    const largest_um = this.field.update(modal_um);
    context.globalAlpha = isLive ? 1 : 0.4;
    this.field.draw(context, width, height);
    if (largest_um > LEAST_UM) {
      context.strokeStyle = "rgb(255 255 255 / .5)";
      context.lineWidth = 1;
      context.stroke(this.field.nodes(width, height, modal_um));
    }
    const [w_mm, h_mm] = this.field.size_mm;
    const scale = width / w_mm;
    const to = ([x_mm, y_mm]) => [(x_mm / w_mm + 0.5) * width, (0.5 - y_mm / h_mm) * height];
    surfaces.draw(context, to, scale, frame, drawing.chosen);
    for (const place of this.lonely(frame)) this.ring(context, to(place), this.contact(null, scale), false);
    const labels = []; // where those of this frame are: [left, top, right]
    for (const finger of frame.fingers) {
      if (finger.seen_mm[0] === null) continue;
      this.finger(context, finger, to, scale, finger.id === chosen);
      const centre = to(finger.true_mm ?? finger.seen_mm);
      this.label(context, finger, centre, this.contact(finger, scale).long, width, height, labels);
    }
    effects.draw(context, to, scale, frame, recent);
    drawing.draw(context, to, scale);
    context.globalAlpha = 1;
    if (invitation) invite(context, invitation, width, height);
  }

  /** True fingers that the daemon does not see. */
  lonely(frame) {
    if (!frame.truth) return [];
    const seen = new Set(frame.fingers.map((finger) => finger.true_mm));
    return frame.truth.fingers_mm.filter((place) => !seen.has(place));
  }

  finger(context, finger, to, scale, isChosen) {
    const contact = this.contact(finger, scale);
    const centre = to(finger.true_mm ?? finger.seen_mm);
    const asked = finger.asked_friction;
    if (finger.felt_friction !== null) disc(context, centre, contact, this.colour(finger.felt_friction));
    if (finger.true_mm) this.ring(context, centre, contact, isChosen, asked === null ? "#fff" : this.colour(asked));
    else if (isChosen) this.ring(context, centre, { ...contact, gap: 3 }, true);
    const [x, y] = to(finger.seen_mm);
    outlined(context, () => {
      context.beginPath();
      if (finger.virtual) context.rect(x - 4, y - 4, 8, 8);
      else context.arc(x, y, 3.5, 0, 2 * Math.PI);
    }, "fill");
    if (finger.predicted_mm) {
      const [px, py] = to(finger.predicted_mm);
      outlined(context, () => {
        context.beginPath();
        for (const [dx, dy] of [[6, 0], [0, 6]]) {
          context.moveTo(px - dx, py - dy);
          context.lineTo(px + dx, py + dy);
        }
      }, "stroke");
    }
  }

  /** A finger's contact on the canvas, whose y points down: an ellipse where the pad's are used, else a disc. */
  contact(finger, scale) {
    const major_mm = finger?.contact_major_mm ?? 2 * this.radius_mm;
    const minor_mm = finger?.contact_minor_mm ?? major_mm;
    return { long: major_mm / 2 * scale, short: minor_mm / 2 * scale, turn: -(finger?.contact_angle_rad ?? 0), gap: 0 };
  }

  ring(context, centre, contact, isChosen, colour = "#fff") {
    outlined(context, () => ellipse(context, centre, contact), "stroke", isChosen ? 5 : 3, colour);
  }

  /** Of a friction, from slippery to sticky. */
  colour(friction) {
    const part = Math.min(Math.max((friction - this.least_friction) / (1 - this.least_friction), 0), 1);
    const mixed = STUCK.map((stuck, i) => Math.round(SLID[i] + part * (stuck - SLID[i])));
    return `rgb(${mixed.join(" ")})`;
  }

  /** Write what a finger feels above its contact, or below it where that is off the plate or on another label. */
  label(context, finger, [x, y], radius, width, height, others) {
    const text = `${finger.id}: ${labelOf(finger)}`;
    context.font = "600 13px system-ui, sans-serif";
    context.textBaseline = "middle";
    const room = context.measureText(text).width + 14;
    const left = Math.min(Math.max(x - room / 2, 4), width - room - 4);
    const tops = [y - radius - 26, y + radius + 6, y - radius - 50, y + radius + 30];
    const isFree = (top) => top >= 4 && top + 24 <= height && !others.some(([from, other, to]) =>
      Math.abs(top - other) < 22 && left < to + 2 && from < left + room + 2);
    const top = tops.find(isFree) ?? tops[y < height / 2 ? 1 : 0];
    others.push([left, top, left + room]);
    context.fillStyle = "rgb(12 16 20 / .78)";
    context.beginPath();
    context.roundRect(left, top, room, 20, 5);
    context.fill();
    context.fillStyle = finger.target_um === null ? "#fff" : finger.target_um === 0 ? "#ffb877" : "#8fd3ff";
    context.fillText(text, left + 7, top + 10.5);
  }
}

/** What a finger feels and was asked to: frictions of contacts, amplitudes of points. */
function labelOf(finger) {
  const { gets_um, target_um, felt_friction, asked_friction: asked } = finger;
  if (asked !== null) return `feels ${felt_friction.toFixed(2)}, asked ${asked.toFixed(2)}`;
  const gets = gets_um === null ? "" : `${gets_um.toFixed(2)} µm`;
  const wants = target_um === null ? "" : target_um === 0 ? "sticky" : `of ${target_um.toFixed(2)}`;
  return [gets, wants].filter(Boolean).join(" ");
}

function ellipse(context, [x, y], { long, short, turn, gap }) {
  context.beginPath();
  context.ellipse(x, y, long + gap, short + gap, turn, 0, 2 * Math.PI);
}

function disc(context, centre, contact, colour) {
  context.globalAlpha = 0.75;
  context.fillStyle = colour;
  ellipse(context, centre, contact);
  context.fill();
  context.globalAlpha = 1;
}

function invite(context, text, width, height) {
  context.font = "15px system-ui, sans-serif";
  context.textAlign = "center";
  context.fillStyle = "rgb(255 255 255 / .85)";
  context.fillText(text, width / 2, height / 2);
  context.textAlign = "left";
}

/** Light with a dark edge, legible on every colour of the field. */
function outlined(context, trace, how, lineWidth = 2, colour = "#fff") {
  trace();
  context.strokeStyle = "rgb(12 16 20 / .75)";
  context.lineWidth = lineWidth + 2.5;
  context.stroke();
  trace();
  if (how === "fill") {
    context.fillStyle = colour;
    context.fill();
    return;
  }
  context.strokeStyle = colour;
  context.lineWidth = lineWidth;
  context.stroke();
}
