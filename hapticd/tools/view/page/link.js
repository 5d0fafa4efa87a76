// The websocket to the server: it is opened again when it is lost, and what the server says is handed on by its kind.

const AGAIN_MS = 1000;

export class Link {
  /** `hear` has a function for each kind of message, and `lost` for when the server is gone, or says why it does not serve. */
  constructor(hear) {
    this.hear = hear;
    this.key = new URLSearchParams(location.search).get("key") ?? "";
    this.open();
  }

  open() {
    this.socket = new WebSocket(`ws://${location.host}/socket?key=${encodeURIComponent(this.key)}`);
    this.socket.addEventListener("message", (event) => {
      const message = JSON.parse(event.data);
      this.hear[message.kind]?.(message);
    });
    this.socket.addEventListener("close", (event) => {
      this.hear.lost(event.reason);
      setTimeout(() => this.open(), AGAIN_MS);
    });
  }

  say(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  /** The mode shapes of the plate that was announced. */
  async shapes() {
    return new Float32Array(await this.bytes("/shapes?"));
  }

  /** A layer's levels, one byte a point; `mover` is the id of the finger it is about, null is one more. */
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
