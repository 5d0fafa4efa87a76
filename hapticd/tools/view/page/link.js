// Websocket to the server: it reconnects, and dispatches messages by their kind.

const AGAIN_MS = 1000;

export class Link {
  /** `handlers` has a function for each kind of message, and `lost`, which gets the server's reason if there is one. */
  constructor(handlers) {
    this.handlers = handlers;
    this.key = new URLSearchParams(location.search).get("key") ?? "";
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

  /** Fetch the mode shapes of the announced plate. */
  async shapes() {
    return new Float32Array(await this.bytes("/shapes?"));
  }

  /** Fetch a layer's levels, one byte per point, for the finger `mover` or, with null, for one more. */
  async layer(name, mover) {
    const finger = mover === null ? "" : `finger=${encodeURIComponent(JSON.stringify(mover))}&`;
    return new Uint8Array(await this.bytes(`/layer?name=${encodeURIComponent(name)}&${finger}`));
  }

  async bytes(path) {
    const answer = await fetch(`${path}key=${encodeURIComponent(this.key)}`);
    if (!answer.ok) throw new Error(await answer.text());
    return answer.arrayBuffer();
  }
}
