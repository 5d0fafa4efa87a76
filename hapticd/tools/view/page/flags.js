// Flags in the header: always the same ones, so that the layout stays. Each explains itself when pointed at or focused.

import { write } from "./fingers.js";

const FAULT = 4; // its place in the list
const NEW_MS = 5000; // a counter that grew stands out this long
const BUSY = "the computer was too busy: close other programs; on a real plate `hapticd doctor` names what to set";

export class Flags {
  /** `clearFault` requests it of the board. */
  constructor(list, clearFault) {
    this.list = list;
    this.clearFault = clearFault;
    this.counts = new Map();
    this.isFaulty = false;
    this.show(null, null, false);
  }

  /** Show those of a frame and of the daemon's status; none stands out while they are not live. */
  show(frame, status, isLive) {
    const board = status?.board ?? {};
    this.isFaulty = isLive && frame?.state === "FAULT";
    const isSilent = board.ready === false;
    const flags = [
      ["at its limit", frame?.limited && "is",
        "A mode, a way in which the glass vibrates, is at its largest amplitude, so not all targets can be met here: normal at many places; move a finger."],
      ["target missed", frame?.misses_target && "is",
        "Some finger gets less than 0.9 of its target, or feels a difference to it: its line in the list says how much."],
      ["amplifier full", board.saturated === true && "is",
        "An amplifier is at its largest voltage, as in each fast change: normal; if it stays, ask for less amplitude."],
      [isSilent ? "board silent" : "board answers", isSilent && "bad",
        isSilent ? "The board sends no status, and nothing is driven: check its cable and power; `hapticd doctor` tells more."
          : "The board sends its status: nothing to do."],
      [this.isFaulty ? `fault ${board.fault_code ?? ""}` : "no fault", this.isFaulty && "bad",
        this.isFaulty ? "The board has switched its output off: mend the cause, which `hapticd firmware log` names; then press here."
          : "The board has found no fault since it started or was cleared: nothing to do."],
      [...this.count("dead-man", board.deadman_trips, isSilent ? "bad" : "warn"),
        `How often the board got no frame for 50 ms and went to zero, since the start. While it is amber, frames came late, and the board has gone on with the next ones. If it grows, ${BUSY}.`],
      [...this.count("late frames", status?.late_frames, "is"),
        "Frames that took effect over 1 ms late, since the start: normal without real-time priority; a moving finger gets a little less exact vibration."],
      [...this.count("skipped", status?.missed_ticks, "warn"),
        `Passes of the daemon, a thousand a second at most, that came too late and were left out, since the start. If it grows, ${BUSY}.`],
    ];
    flags.forEach(([text, how, sentence], index) => {
      const [flag, tip] = (this.list.children[index] ?? this.made(index)).children;
      write(flag, text);
      write(tip, sentence);
      flag.className = `flag ${(isLive && how) || ""}`.trim();
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

  /** A counter since the daemon's start; it stands out for a while when it grows. */
  count(name, value = 0, how) {
    const known = this.counts.get(name);
    if (!known || value < known.value) this.counts.set(name, { value, grew_ms: -Infinity });
    else if (value > known.value) this.counts.set(name, { value, grew_ms: performance.now() });
    return [`${name} ${value}`, performance.now() - this.counts.get(name).grew_ms < NEW_MS && how];
  }
}
