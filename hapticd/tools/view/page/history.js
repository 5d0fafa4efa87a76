// The frames of the last 30 s, and the one shown: the newest, or while paused any.

export const SPAN_S = 30;
const SAME_MM = 12; // largest distance at which a reported finger is the same as a true one
const OVER_S = 2; // window of the leak

export class History {
  constructor() {
    this.frames = [];
    this.paused = false;
    this.back_s = 0;
  }

  /** Add a frame; while paused it is dropped, so that the shown one stays. */
  add(frame) {
    if (this.paused) return;
    const last = this.frames.at(-1);
    if (last && (frame.instance !== last.instance || frame.t_s < last.t_s)) this.frames.length = 0;
    this.frames.push(frame);
    let old = 0;
    while (this.frames[old].t_s < frame.t_s - SPAN_S) old++;
    if (old > 0) this.frames.splice(0, old);
  }

  clear() {
    this.frames.length = 0;
  }

  get newest() {
    return this.frames.at(-1);
  }

  /** The shown frame. */
  get current() {
    if (!this.newest || this.back_s === 0) return this.newest;
    return this.frames[this.index(this.newest.t_s - this.back_s)];
  }

  index(t_s) {
    let [low, high] = [0, this.frames.length - 1];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.frames[middle].t_s < t_s) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** The frames of the last `span_s` before the shown one, and that. */
  recent(span_s) {
    const t_s = this.current?.t_s ?? 0;
    return this.frames.slice(this.index(t_s - span_s)).filter((frame) => frame.t_s <= t_s);
  }

  /** RMS amplitude of the sticky fingers, RMS error of the others, and the share of time in which all fingers feel what
   * was asked, within a just noticeable difference, over the window. */
  leak() {
    const current = this.current;
    if (!current) return { leak_um: null, off_um: null, felt_frac: null };
    const sums = { leak: [0, 0], off: [0, 0], felt: [0, 0] };
    for (let i = this.index(current.t_s - OVER_S); i < this.frames.length && this.frames[i].t_s <= current.t_s; i++) {
      let [judged, wrong] = [0, 0];
      for (const { target_um, gets_um, error_jnd } of this.frames[i].fingers) {
        if (target_um === null || gets_um === null) continue;
        if (error_jnd !== null) {
          judged += 1;
          wrong += Math.abs(error_jnd) > 1;
        }
        const sum = target_um === 0 ? sums.leak : sums.off;
        sum[0] += (gets_um - target_um) ** 2;
        sum[1] += 1;
      }
      sums.felt[0] += judged > 0 && wrong === 0;
      sums.felt[1] += judged > 0;
    }
    const rms = ([squares, count]) => (count > 0 ? Math.sqrt(squares / count) : null);
    const felt_frac = sums.felt[1] > 0 ? sums.felt[0] / sums.felt[1] : null;
    return { leak_um: rms(sums.leak), off_um: rms(sums.off), felt_frac };
  }
}

/** The best known phasors of a frame, and their source. */
export function motion(frame) {
  if (frame.truth) return { modal_um: frame.truth.modal_um, of: "true" };
  if (frame.measured_um.length > 0) return { modal_um: frame.measured_um, of: "measured" };
  return { modal_um: frame.modal_um, of: "asked" };
}

/** Amplitude of each finger: with `has_contacts` the daemon's RMS over the contact, else that of its centre, true on a
 * simulated plate, else computed from the measured modes. */
export function judge(frame, field, curve, { has_contacts }) {
  const { modal_um } = motion(frame);
  const free = frame.truth ? frame.truth.fingers_mm.map((_, i) => i) : [];
  for (const finger of frame.fingers) {
    const [x_mm, y_mm] = finger.seen_mm;
    const near = nearest(free, (i) => Math.hypot(frame.truth.fingers_mm[i][0] - x_mm, frame.truth.fingers_mm[i][1] - y_mm));
    if (near !== null) {
      free.splice(free.indexOf(near), 1);
      finger.true_mm = frame.truth.fingers_mm[near];
      finger.gets_um = Math.hypot(...frame.truth.truth_um[near]);
    } else {
      finger.true_mm = null;
      finger.gets_um = field && x_mm !== null ? field.at(modal_um, x_mm, y_mm) : null;
    }
    if (has_contacts && finger.contact_um !== null) {
      finger.gets_um = finger.contact_um;
      [finger.gets_low, finger.gets_high] = [finger.contact_um_low, finger.contact_um_high];
    }
    finger.asked_friction = curve.asked(finger);
  }
  return frame;
}

function nearest(choices, distance) {
  let [best, best_mm] = [null, SAME_MM];
  for (const choice of choices) {
    const away_mm = distance(choice);
    if (away_mm < best_mm) [best, best_mm] = [choice, away_mm];
  }
  return best;
}
