// Friction against amplitude, by the daemon's curve. On the page it is counted as targets are: 0 is the most slippery, 1
// bare glass.

export class FrictionCurve {
  /** `knots` are rising amplitudes in um, each with its friction relative to bare glass, whose logarithm is straight
   * between them. */
  constructor(knots) {
    this.knots = knots;
    this.floor = this.knots.at(-1)[1];
  }

  at(um) {
    return this.counted(this.relative(um));
  }

  /** The friction that a contact was asked to have; null for points and without a target. */
  asked({ felt_friction, friction_change }) {
    if (felt_friction === null || friction_change === null) return null;
    return this.counted((this.floor + (1 - this.floor) * felt_friction) / (1 + friction_change));
  }

  counted(relative) {
    return Math.max((relative - this.floor) / (1 - this.floor), 0);
  }

  relative(um) {
    const right = this.knots.findIndex(([knot_um]) => knot_um >= um);
    if (right === 0) return this.knots[0][1];
    if (right < 0) return this.knots.at(-1)[1];
    const [[from_um, from], [to_um, to]] = [this.knots[right - 1], this.knots[right]];
    return from * (to / from) ** ((um - from_um) / (to_um - from_um));
  }
}
