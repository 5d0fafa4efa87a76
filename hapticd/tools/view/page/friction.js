// Friction against amplitude, by the daemon's curve, relative to that of bare glass.

export const WEBER_FRAC = 0.11; // as values.py: least relative change of friction that is felt
const BUILT_IN = [[0, 1], [2, Math.exp(-2 / 0.7)]]; // where an older daemon sends none

export class FrictionCurve {
  /** `knots` are rising amplitudes in um, each with its friction, whose logarithm is straight between them; a finger at `speed_mm_s` needs twice the amplitude. */
  constructor(knots, speed_mm_s) {
    this.knots = knots ?? BUILT_IN;
    this.speed_mm_s = speed_mm_s ?? Infinity;
  }

  at(amplitude_um, sliding_mm_s = 0) {
    const um = amplitude_um / (1 + sliding_mm_s / this.speed_mm_s);
    const right = this.knots.findIndex(([knot_um]) => knot_um >= um);
    if (right === 0) return this.knots[0][1];
    if (right < 0) return this.knots.at(-1)[1];
    const [[from_um, from], [to_um, to]] = [this.knots[right - 1], this.knots[right]];
    return from * (to / from) ** ((um - from_um) / (to_um - from_um));
  }
}

/** How fast a finger slides: from where it was sampled to where it is predicted. */
export function sliding_mm_s({ seen_mm, predicted_mm }, horizon_ms) {
  if (!predicted_mm || seen_mm[0] === null || !(horizon_ms > 0)) return 0;
  return (Math.hypot(predicted_mm[0] - seen_mm[0], predicted_mm[1] - seen_mm[1]) / horizon_ms) * 1000;
}
