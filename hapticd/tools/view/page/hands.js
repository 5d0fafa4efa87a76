// Pointers and keys as fingers on the simulated pad: the mouse is one, shift-click leaves one lying, each touch is one.

const REPEAT_MS = 120; // the rig releases fingers after a timeout
const REACH_MM = 9; // a click nearer than this selects a finger
const STEP_MM = 1;
const LONG_STEP_MM = 6;
const EDGE_MM = 3;
const KEYS = "keys"; // the name of the finger that the keyboard moves
const REST_FRAC = 0.11; // of the pad's highest pressure: a finger that rests
const PRESS_FRAC = 0.6; // one that presses: all while P is held, and a pointer that stays for LONG_PRESS_MS
const PRESS_KEY = "p";
const LONG_PRESS_MS = 600;
const STILL_MM = 1.5;

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class Hands {
  /** `send` sends to the server, `choose` gets each position that is clicked. */
  constructor(canvas, send, choose) {
    this.canvas = canvas;
    this.send = send;
    this.choose = choose;
    this.size_mm = null; // until touching is enabled
    this.held = new Map();
    this.dragged = new Map(); // by pointer: the finger's name, and whether it stays after release
    this.pinned = 0;
    this.changed = false;
    this.pressesAll = false;
    this.pressed = new Set(); // names of pointers' fingers that press
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => this.up(event));
    canvas.addEventListener("keydown", (event) => this.key(event));
    canvas.addEventListener("keyup", (event) => event.key.toLowerCase() === PRESS_KEY && this.pressAll(false));
    canvas.addEventListener("blur", () => this.pressAll(false));
    canvas.addEventListener("contextmenu", (event) => this.size_mm && event.preventDefault());
    setInterval(() => this.held.size > 0 && this.sendFingers(), REPEAT_MS);
  }

  /** Enable touching a plate of this size, or disable it with null; fingers that lie there stay, on the new plate. */
  allow(size_mm) {
    this.size_mm = size_mm;
    this.canvas.classList.toggle("touchable", size_mm !== null);
    if (size_mm) for (const [name, place_mm] of this.held) this.put(name, place_mm);
  }

  /** Called once per picture: send the fingers if they moved. */
  flush() {
    if (this.changed) this.sendFingers();
  }

  /** Whether one of this page's fingers is near. */
  holds(x_mm, y_mm) {
    return this.at(x_mm, y_mm, 2 * REACH_MM) !== undefined;
  }

  liftAll() {
    this.held.clear();
    for (const drag of this.dragged.values()) this.letGo(drag);
    this.dragged.clear();
    this.changed = true;
  }

  sendFingers() {
    this.changed = false;
    const touches = [...this.held].map(([name, place_mm]) => [name, [...place_mm, this.pressure(name)]]);
    this.send({ op: "fingers", fingers: Object.fromEntries(touches) });
  }

  pressure(name) {
    return this.pressesAll || this.pressed.has(name) ? PRESS_FRAC : REST_FRAC;
  }

  pressAll(pressesAll) {
    this.changed ||= this.pressesAll !== pressesAll;
    this.pressesAll = pressesAll;
  }

  /** A pointer's finger presses once it has stayed where it is, until it moves on. */
  watch(drag, place_mm) {
    this.letGo(drag);
    drag.from_mm = place_mm;
    drag.timer = setTimeout(() => {
      this.pressed.add(drag.name);
      this.changed = true;
    }, LONG_PRESS_MS);
  }

  letGo(drag) {
    clearTimeout(drag.timer);
    if (this.pressed.delete(drag.name)) this.changed = true;
  }

  place(event) {
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width - 0.5, 0.5 - (event.clientY - box.top) / box.height];
  }

  put(name, [x_mm, y_mm]) {
    const within = (value, size_mm) => Math.min(Math.max(value, EDGE_MM - size_mm / 2), size_mm / 2 - EDGE_MM);
    this.held.set(name, [within(x_mm, this.size_mm[0]), within(y_mm, this.size_mm[1])]);
    this.changed = true;
  }

  lift(name) {
    this.held.delete(name);
    this.changed = true;
  }

  at(x_mm, y_mm, reach_mm = REACH_MM) {
    return [...this.held.keys()].find((name) => {
      const [there_mm, up_mm] = this.held.get(name);
      return Math.hypot(there_mm - x_mm, up_mm - y_mm) < reach_mm;
    });
  }

  down(event) {
    const part = this.place(event);
    this.choose(part);
    if (!this.size_mm || event.button > 0) return;
    const place_mm = [part[0] * this.size_mm[0], part[1] * this.size_mm[1]];
    const there = this.at(...place_mm);
    if (event.shiftKey && there) {
      this.lift(there);
      return;
    }
    const isTouch = event.pointerType === "touch";
    const name = there ?? (event.shiftKey ? `pin${++this.pinned}` : isTouch ? `touch${event.pointerId}` : "mouse");
    const stays = name.startsWith("pin") || name === KEYS;
    const drag = { name, stays };
    this.dragged.set(event.pointerId, drag);
    this.watch(drag, place_mm);
    this.canvas.setPointerCapture(event.pointerId);
    this.put(name, place_mm);
  }

  move(event) {
    const drag = this.dragged.get(event.pointerId);
    if (!drag || !this.size_mm) return;
    const part = this.place(event);
    const place_mm = [part[0] * this.size_mm[0], part[1] * this.size_mm[1]];
    if (Math.hypot(place_mm[0] - drag.from_mm[0], place_mm[1] - drag.from_mm[1]) > STILL_MM) this.watch(drag, place_mm);
    this.put(drag.name, place_mm);
  }

  up(event) {
    const drag = this.dragged.get(event.pointerId);
    this.dragged.delete(event.pointerId);
    if (!drag) return;
    this.letGo(drag);
    if (!drag.stays) this.lift(drag.name);
  }

  key(event) {
    if (!this.size_mm || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Enter") {
      if (this.held.has(KEYS)) this.lift(KEYS);
      else this.put(KEYS, [0, 0]);
    } else if (event.key.toLowerCase() === PRESS_KEY) {
      this.pressAll(true);
    } else if (event.key === "Escape") {
      this.liftAll();
    } else if (ARROWS[event.key] && this.held.has(KEYS)) {
      const step_mm = event.shiftKey ? LONG_STEP_MM : STEP_MM;
      const [x_mm, y_mm] = this.held.get(KEYS);
      const [right, up] = ARROWS[event.key];
      this.put(KEYS, [x_mm + right * step_mm, y_mm + up * step_mm]);
    } else {
      return;
    }
    event.preventDefault();
  }
}
