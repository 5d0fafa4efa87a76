/**
 * Client of hapticd for browsers and Node, over the WebSocket of `hapticd gateway`. No dependencies.
 *
 *   import { connect } from "./hapticd.js";
 *   const plate = await connect("ws://127.0.0.1:8018/client?key=...");
 *   plate.follow((state) => console.log(state.fingers));
 *   await plate.set(3, { friction: 0.2 });
 *
 * Targets hold while the page runs: they are repeated, and end by their time to live when it dies. Messages and their
 * types are those of clients/PROTOCOL.md (hapticd.d.ts). Positions are millimetres, amplitudes micrometres.
 */

export const PROTOCOL_VERSION = 1;
export const DEFAULT_TTL_S = 0.5;
const REFRESHES_PER_TTL = 3;
const MAX_REQUEST_ID = 2 ** 32 - 1;

/** The daemon, or the gateway, refused a message: the text is its sentence. */
export class RefusedError extends Error {
  name = "RefusedError";
}

/** No daemon answers, or the connection is closed. */
export class GoneError extends Error {
  name = "GoneError";
}

/** Connect to a gateway and greet its daemon. */
export async function connect(address, options = {}) {
  const plate = new Plate(address, options);
  await plate.opened();
  return plate;
}

/** Bytes of a reply, such as `shapes` of `plate`, which JSON has as base64. */
export function bytesOf(base64) {
  return Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
}

/** One client of the daemon. */
export class Plate {
  #socket;
  #timeoutMs;
  #ttlS;
  #lastId = 0;
  #lastStamp = 0;
  #waiting = new Map(); // request id -> { resolve, reject, timer }
  #held = { targets: new Map(), virtuals: new Map(), surfaces: new Map(), effects: new Map() };
  #stamp = 0;
  #refresh = null;
  #changes = Promise.resolve(); // one after the other, so that a refused one takes back only itself
  #seen = new Set(); // fingers with a target that were in a state
  #followers = new Map(); // callback -> "newest" or "every"
  #opening;

  constructor(address, { name, ttlS = DEFAULT_TTL_S, timeoutS = 2, WebSocket = globalThis.WebSocket } = {}) {
    if (WebSocket === undefined) {
      throw new TypeError("There is no WebSocket here: Node 20 has one with `node --experimental-websocket`, Node 22 "
        + "without; or give one as an option.");
    }
    this.name = name ?? `web-${Math.random().toString(36).slice(2, 10)}`;
    this.hello = null;
    this.onrefused = (sentence) => console.warn(`hapticd: ${sentence}`);
    this.onclose = () => {};
    this.#ttlS = ttlS;
    this.#timeoutMs = timeoutS * 1000;
    this.#socket = new WebSocket(address);
    this.#socket.onmessage = ({ data }) => this.#take(JSON.parse(data));
    this.#opening = new Promise((resolve, reject) => {
      this.#socket.onopen = resolve;
      this.#socket.onerror = () => reject(new GoneError("No gateway admits this address: run `hapticd gateway`, and "
        + "give it the origin of this page."));
      this.#socket.onclose = ({ reason }) => {
        const error = new GoneError(reason || "The connection to the gateway is closed.");
        reject(error);
        this.#end(error);
      };
    });
  }

  /** Resolve when the daemon has answered. */
  async opened() {
    await this.#opening;
    this.hello = await this.request("hello");
  }

  // --- targets ---

  /** Set the target of a finger (its id, or a virtual one's name): `content` has one field, such as `friction`. */
  set(finger, content) {
    return this.#change("targets", finger, { finger, ...content });
  }

  /** Define a virtual finger: `path` has at least `path_mm`, one point or several. */
  virtual(name, path) {
    return this.#change("virtuals", name, { name, ...path });
  }

  /** Lay content on the plate, in a shape: every finger without a target feels it. */
  surface(name, fields) {
    return this.#change("surfaces", name, { name, ...fields });
  }

  /** Play a form in time. Without a `start` it plays now. */
  effect(name, fields) {
    return this.#change("effects", name, { name, start: { cause: "now", id: this.#nextStamp() }, ...fields });
  }

  /** Release one finger with its effects, or everything. */
  release(finger) {
    return this.#afterOthers(async () => {
      if (finger === undefined) {
        for (const held of Object.values(this.#held)) held.clear();
      } else {
        this.#held.targets.delete(finger);
        this.#held.virtuals.delete(finger);
        for (const [name, effect] of this.#held.effects) if (effect.finger === finger) this.#held.effects.delete(name);
      }
      this.#stamp = this.#nextStamp();
      this.#keepUp();
      const body = { client: this.name, stamp: this.#stamp };
      return (await this.request("release", finger === undefined ? body : { ...body, finger })).released;
    });
  }

  /** Remove a surface, and the effects that name it. */
  remove(surface) {
    return this.#afterOthers(() => {
      this.#held.surfaces.delete(surface);
      for (const [name, effect] of this.#held.effects) {
        if (effect.surface === surface || effect.start?.surface === surface) this.#held.effects.delete(name);
      }
      return this.#send();
    });
  }

  /** End an effect. */
  stop(effect) {
    return this.#afterOthers(() => {
      this.#held.effects.delete(effect);
      return this.#send();
    });
  }

  // --- requests ---

  /** Add a marker to recordings and to the next state; return its instant, `t_ns`. With `pulse` an output rises;
   * `fields` are values by name. */
  async marker(text, { pulse = false, fields = {} } = {}) {
    const more = { ...(pulse ? { pulse } : {}), ...(Object.keys(fields).length ? { fields } : {}) };
    return (await this.request("marker", { client: this.name, text, ...more })).t_ns;
  }

  /** Return the body of the reply to any request of the protocol. Rejects with RefusedError or GoneError. */
  request(op, body) {
    const id = (this.#lastId = (this.#lastId % MAX_REQUEST_ID) + 1);
    return new Promise((resolve, reject) => {
      const late = () => this.#settle(id)?.reject(new GoneError("No hapticd answers: start one."));
      this.#waiting.set(id, { resolve, reject, timer: setTimeout(late, this.#timeoutMs) });
      try {
        this.#write({ id, op, ...(body === undefined ? {} : { body }) });
      } catch (error) {
        this.#settle(id)?.reject(error);
      }
    });
  }

  // --- states ---

  /**
   * Call `take` with states: of a slow page the newest, or with "every" all, as events need it. Return a function
   * that ends it.
   */
  follow(take, states = "newest") {
    this.#followers.set(take, states);
    this.#subscribe();
    return () => {
      this.#followers.delete(take);
      this.#subscribe();
    };
  }

  /** Release everything and disconnect. */
  async close() {
    try {
      await this.release();
    } catch (error) {
      if (!(error instanceof GoneError)) throw error;
    } finally {
      this.#end(new GoneError("This client is closed."));
      this.#socket.close();
    }
  }

  // --- inside ---

  #change(kind, key, fields) {
    return this.#afterOthers(async () => {
      const held = this.#held[kind];
      const before = held.get(key);
      held.set(key, fields);
      try {
        await this.#send();
      } catch (error) {
        if (before === undefined) held.delete(key);
        else held.set(key, before);
        if (error instanceof RefusedError) await this.#send().catch(() => {});
        throw error;
      }
    });
  }

  #afterOthers(step) {
    const done = this.#changes.then(step);
    this.#changes = done.catch(() => {});
    return done;
  }

  async #send() {
    this.#stamp = this.#nextStamp();
    this.#keepUp();
    await this.request("set", this.#message());
  }

  #message() {
    const lists = Object.entries(this.#held).filter(([, held]) => held.size > 0);
    const contents = Object.fromEntries(lists.map(([kind, held]) => [kind, [...held.values()]]));
    return { client: this.name, ttl_s: this.#ttlS, stamp: this.#stamp, ...contents };
  }

  /** Repeat the targets while there are any. */
  #keepUp() {
    clearInterval(this.#refresh);
    this.#refresh = null;
    if (Object.values(this.#held).every((held) => held.size === 0)) return;
    this.#refresh = setInterval(() => this.#write(this.#message()), (this.#ttlS * 1000) / REFRESHES_PER_TTL);
  }

  /** Microseconds since 1970, which a number holds exactly, and always more than before. */
  #nextStamp() {
    this.#lastStamp = Math.max(this.#lastStamp + 1, Math.round(Date.now() * 1000));
    return this.#lastStamp;
  }

  #subscribe() {
    const wanted = [...this.#followers.values()];
    const states = wanted.includes("every") ? "every" : wanted.length > 0 ? "newest" : "none";
    if (this.#socket.readyState === 1) this.#write({ states });
  }

  #write(message) {
    if (this.#socket.readyState !== 1) throw new GoneError("The connection to the gateway is closed.");
    this.#socket.send(JSON.stringify({ v: PROTOCOL_VERSION, ...message }, asBase64));
  }

  #take(message) {
    if ("ok" in message) {
      const waiting = this.#settle(message.id);
      if (waiting === undefined) {
        if (!message.ok) this.onrefused(message.error);
      } else if (message.ok) waiting.resolve(message.body);
      else waiting.reject(new RefusedError(message.error));
    } else if ("seq" in message) {
      this.#dropLifted(message.fingers);
      for (const take of this.#followers.keys()) take(message);
    }
  }

  /** Forget the targets of fingers that were in a state and are in this one no more: ids are never used again. */
  #dropLifted(fingers) {
    const down = new Set(fingers.map((finger) => finger.id));
    for (const key of this.#held.targets.keys()) {
      if (typeof key !== "number") continue;
      if (down.has(key)) this.#seen.add(key);
      else if (this.#seen.delete(key)) this.#held.targets.delete(key);
    }
  }

  #settle(id) {
    const waiting = this.#waiting.get(id);
    if (waiting !== undefined) {
      this.#waiting.delete(id);
      clearTimeout(waiting.timer);
    }
    return waiting;
  }

  #end(error) {
    clearInterval(this.#refresh);
    this.#refresh = null;
    for (const id of [...this.#waiting.keys()]) this.#settle(id).reject(error);
    const told = this.onclose;
    this.onclose = () => {};
    told(error);
  }
}

function asBase64(_, value) {
  if (!(value instanceof Uint8Array)) return value;
  let letters = "";
  for (const byte of value) letters += String.fromCharCode(byte);
  return btoa(letters);
}
