// WebSockets to the server: one reconnects, and dispatches messages by their kind; by the other the page is a client.

import { Plate } from "./hapticd.js";

const AGAIN_MS = 1000;
const TTL_S = 2; // a page in the background may repeat its targets once a second

export class Link {
  /** `handlers` has a function for each kind of message, and `lost`, which gets the server's reason if there is one. */
  constructor(handlers) {
    this.handlers = handlers;
    this.key = new URLSearchParams(location.search).get("key") ?? "";
    this.name = `view-${Math.random().toString(36).slice(2, 8)}`; // of this page as a client
    this.client = null;
    this.open();
  }

  open() {
    this.socket = new WebSocket(`ws://${location.host}/socket?key=${encodeURIComponent(this.key)}`);
    this.socket.addEventListener("message", (event) => {
      const message = JSON.parse(event.data);
      this.handlers[message.kind]?.(message);
    });
    this.socket.addEventListener("close", (event) => {
      this.handlers.lost(event.reason);
      setTimeout(() => this.open(), AGAIN_MS);
    });
  }

  send(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  /** Have this page's client of the daemon change something; what is refused is shown. */
  async ask(change) {
    try {
      await change(await (this.client ??= this.connected()));
    } catch (error) {
      this.handlers.refused({ sentence: error.message });
    }
  }

  async connected() {
    const address = `ws://${location.host}/client?key=${encodeURIComponent(this.key)}`;
    const client = new Plate(address, { name: this.name, ttlS: TTL_S });
    client.onrefused = (sentence) => this.handlers.refused({ sentence });
    client.onclose = () => (this.client = null);
    try {
      await client.opened();
    } catch (error) {
      this.client = null;
      client.close().catch(() => {});
      throw error;
    }
    client.follow(() => {}); // so that it drops the targets of lifted fingers
    return client;
  }

  /** Fetch the mode shapes of the announced plate. */
  async shapes() {
    return new Float32Array(await this.bytes("/shapes?"));
  }

  async bytes(path) {
    const answer = await fetch(`${path}key=${encodeURIComponent(this.key)}`);
    if (!answer.ok) throw new Error(await answer.text());
    return answer.arrayBuffer();
  }
}
