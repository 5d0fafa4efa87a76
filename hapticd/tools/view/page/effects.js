// Effects as they play: a ring where each event happens, and a dashed one around fingers on which an effect plays.

const RING_S = 0.5; // for so long an event's ring grows and fades
const NEAR_MM = 6;
const FAR_MM = 14;
const TURN_HZ = 1;

export class Effects {
  constructor() {
    this.playing = new Map(); // the event with which it began, by effect and finger
  }

  /** Take the events of a frame, in their order. */
  take(events) {
    for (const event of events) {
      const key = JSON.stringify([event.client, event.effect, event.finger]);
      if (event.kind === "begun") this.playing.set(key, event);
      else if (event.kind === "ended") this.playing.delete(key);
    }
  }

  /** Compare with how many the daemon says play: an end may have been lost. */
  compare(count) {
    if (count === 0) this.playing.clear();
  }

  /** Draw what plays at a frame, and the rings of the frames before it. */
  draw(context, to, scale, frame, recent) {
    for (const { t_s, events } of recent) {
      const part = (frame.t_s - t_s) / RING_S;
      for (const event of events) if (event.x_mm !== null && part <= 1) ring(context, to, scale, event, part);
    }
    context.setLineDash([6, 5]);
    context.lineDashOffset = -11 * TURN_HZ * 4 * frame.t_s;
    context.strokeStyle = "#fff";
    context.lineWidth = 2;
    for (const { finger } of this.playing.values()) {
      const place = frame.fingers.find(({ id }) => id === finger)?.seen_mm;
      if (place && place[0] !== null) circle(context, to(place), scale * NEAR_MM * 1.3);
    }
    context.setLineDash([]);
  }

  /** What plays, one line each. */
  texts() {
    return [...this.playing.values()].map(({ client, effect, finger }) =>
      `${effect} (${client}) plays${finger === null ? "" : ` on finger ${finger}`}`);
  }
}

/** The frames whose rings are seen at an instant. */
export const ringSpan_s = RING_S;

function ring(context, to, scale, { kind, x_mm, y_mm }, part) {
  context.globalAlpha = 1 - part;
  context.strokeStyle = "#fff";
  context.lineWidth = kind === "begun" ? 3 : 1;
  circle(context, to([x_mm, y_mm]), scale * (NEAR_MM + part * (FAR_MM - NEAR_MM)));
  context.globalAlpha = 1;
}

function circle(context, [x, y], radius) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.stroke();
}
