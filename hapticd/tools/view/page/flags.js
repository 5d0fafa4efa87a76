// Flags in the header: those that stand out, or one OK. Each explains itself when pointed at or focused.

import { write } from "./fingers.js";

const FAULT = 4; // its place in the list
const NEW_MS = 5000; // a counter that grew stands out this long
const TOUCHED_MS = 2000; // after a touch: the status with what it caused comes once a second
const BUSY = "the computer was too busy: close other programs; on a real plate `hapticd doctor` names what to set";

export class Flags {
  /** `clearFault` requests it of the board. */
  constructor(list, clearFault) {
    this.list = list;
    this.clearFault = clearFault;
    this.counts = new Map();
    this.isFaulty = false;
    this.t_touched_ms = -Infinity;
  }

  /** Show what stands out in a frame and the daemon's status; nothing while they are not live. */
  show(frame, status, isLive) {
    const board = status?.board ?? {};
    if (frame?.fingers.length > 0) this.t_touched_ms = performance.now();
    this.isFaulty = isLive && frame?.state === "FAULT";
    const isSilent = board.ready === false;
    const flags = [
      ["at its limit", frame?.limited && "is",
        "A mode, a way in which the glass vibrates, is at its largest amplitude, so not all targets can be met here: normal at many places; move a finger."],
      ["target missed", frame?.misses_target && "is",
        "Some finger gets less than 0.9 of its target, or feels a difference to it: its line in the list says how much."],
      ["amplifier full", board.saturated === true && "is",
        "An amplifier is at its largest voltage, as in each fast change: normal; if it stays, ask for less amplitude."],
      ["board silent", isSilent && "bad", `Nothing is driven: ${status?.undriven || "the board sends no status"}.`],
      [`fault ${board.fault_code ?? ""}`, this.isFaulty && "bad",
        "The board has switched its output off: mend the cause, which `hapticd firmware log` names; then press here."],
      ["passes fail", status?.failed_passes > 0 && "bad",
        `${status?.failed_passes} passes of the daemon failed since the start, and the plate was silent in each: its log has the error.`],
      this.count("dead-man", board.deadman_trips, isSilent ? "bad" : "warn",
        `How often the board got no frame for 50 ms and went to zero, since the start; it has gone on with the next ones. If it grows, ${BUSY}.`),
      this.count("late frames", status?.late_frames, "is",
        "Frames that took effect over 1 ms late, since the start: normal without real-time priority; a moving finger gets a little less exact vibration."),
      this.count("skipped", status?.missed_ticks, "warn",
        `Passes of the daemon, a thousand a second at most, that came too late and were left out, since the start. If it grows, ${BUSY}.`),
    ];
    const isOk = isLive && flags.every(([, how]) => !how);
    const counts = [...this.counts].map(([name, { value }]) => `${name} ${value}`).join(", ");
    flags.push(["OK", isOk && "ok", `Nothing stands out. Since the start: ${counts}.`]);
    flags.forEach(([text, how, sentence], index) => {
      const item = this.list.children[index] ?? this.made(index);
      item.hidden = !isLive || !how;
      const [flag, tip] = item.children;
      write(flag, text);
      write(tip, sentence);
      flag.className = `flag ${how || ""}`.trim();
    });
  }

  made(index) {
    const [item, flag, tip] = ["li", "button", "span"].map((tag) => document.createElement(tag));
    flag.type = "button";
    tip.id = `flag-${index}`;
    tip.setAttribute("role", "tooltip");
    flag.setAttribute("aria-describedby", tip.id);
    flag.addEventListener("click", () => index === FAULT && this.isFaulty && this.clearFault());
    item.append(flag, tip);
    return this.list.appendChild(item);
  }

  /** A counter since the daemon's start; it stands out for a while when it grows while somebody touches. */
  count(name, value = 0, how, sentence) {
    const [known, now_ms] = [this.counts.get(name), performance.now()];
    const hasGrown = known && value > known.value && now_ms - this.t_touched_ms < TOUCHED_MS;
    if (value !== known?.value) this.counts.set(name, { value, grew_ms: hasGrown ? now_ms : -Infinity });
    return [`${name} ${value}`, now_ms - this.counts.get(name).grew_ms < NEW_MS && how, sentence];
  }
}
