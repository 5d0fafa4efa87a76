// Drawing: pointers lay rectangles, circles and polygons on the plate, or drag the layers of this page's client.

const LEAST_MM = 2; // a smaller shape was a click
const CLOSE_MM = 4; // a click as near to the first corner closes a polygon
const MOST_CORNERS = 16;
const SEND_MS = 50; // while a layer is dragged
const Z = 100; // over the layers of most clients

export class Drawing {
  /** `content` returns content and effect of a new layer by its name, or null; `now` the instant shown. */
  constructor(canvas, tool, surfaces, { ask, content, now }) {
    Object.assign(this, { canvas, tool, surfaces, ask, content, now });
    this.size_mm = null;
    this.chosen = null; // the name of a layer of ours
    this.corners = []; // of a polygon that is not closed
    this.pointer_mm = null;
    this.from_mm = null; // where the pointer went down
    this.dragged = null;
    this.drawn = 0;
    this.contents = new Map(); // of the layers that this page drew, by name
    this.t_sent_ms = 0;
    const on = (type, handle) => canvas.addEventListener(type, (event) => this.handle(event, handle), { capture: true });
    on("pointerdown", (event) => this.down(event));
    on("pointermove", (event) => this.move(event));
    on("pointerup", (event) => this.up(event));
    on("pointercancel", () => this.cancel());
    on("keydown", (event) => this.key(event));
    tool.addEventListener("change", () => this.cancel());
  }

  /** Only with a tool; then no finger touches. */
  handle(event, handle) {
    if (this.tool.value === "touch" || !this.size_mm) return;
    if (handle(event) !== false) event.stopImmediatePropagation();
  }

  place(event) {
    const box = this.canvas.getBoundingClientRect();
    const part = [(event.clientX - box.left) / box.width - 0.5, 0.5 - (event.clientY - box.top) / box.height];
    return part.map((share, axis) => share * this.size_mm[axis]);
  }

  down(event) {
    if (event.button > 0) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.focus();
    this.from_mm = this.pointer_mm = this.place(event);
    if (this.tool.value === "move") this.grab();
    if (this.tool.value === "polygon") this.corner(this.from_mm);
  }

  move(event) {
    this.pointer_mm = this.place(event);
    if (this.dragged) this.drag(false);
  }

  up(event) {
    if (!this.from_mm) return;
    this.pointer_mm = this.place(event);
    if (this.dragged) this.drag(true);
    else if (this.tool.value !== "polygon") this.finish(this.preview());
    this.from_mm = this.dragged = null;
  }

  cancel() {
    this.corners = [];
    this.from_mm = this.dragged = this.pointer_mm = null;
  }

  key(event) {
    if (event.key === "Escape") this.cancel();
    else if (event.key === "Enter" && this.corners.length > 2) this.close();
    else if (event.key === "Delete") this.erase();
    else return false;
    event.preventDefault();
    return true;
  }

  // --- layers of ours ---

  grab() {
    const layer = this.surfaces.oursAt(this.from_mm, this.now(), (name) => this.contents.has(name));
    this.chosen = layer?.name ?? null;
    this.dragged = layer ? { layer, from_mm: layer.position_mm } : null;
  }

  drag(isLast) {
    const { layer, from_mm } = this.dragged;
    layer.position_mm = from_mm.map((at, axis) => at + this.pointer_mm[axis] - this.from_mm[axis]);
    const t_ms = performance.now();
    if (!isLast && t_ms - this.t_sent_ms < SEND_MS) return;
    this.t_sent_ms = t_ms;
    this.lay(layer);
  }

  erase() {
    const name = this.chosen;
    if (name !== null) this.ask((client) => client.remove(name));
    this.chosen = null;
  }

  lay({ name, shape, position_mm, z }) {
    const outline = shape.radius_mm ? { circle_mm: shape.radius_mm } : { polygon_mm: shape.corners_mm };
    this.ask((client) => client.surface(name, { ...this.contents.get(name), ...outline, position_mm, z }));
  }

  // --- new ones ---

  corner(place_mm) {
    const [first] = this.corners;
    const isClosed = first && Math.hypot(first[0] - place_mm[0], first[1] - place_mm[1]) < CLOSE_MM;
    if (isClosed && this.corners.length > 2) return this.close();
    this.corners.push(place_mm);
    if (this.corners.length === MOST_CORNERS) this.close();
  }

  close() {
    const corners = this.corners;
    this.corners = [];
    const centre = [0, 1].map((axis) => corners.reduce((sum, corner) => sum + corner[axis], 0) / corners.length);
    this.finish({ position_mm: centre, shape: { corners_mm: corners.map(([x, y]) => [x - centre[0], y - centre[1]]) } });
  }

  /** The shape between where the pointer went down and where it is, or null. */
  preview() {
    if (!this.from_mm || this.dragged || this.tool.value === "move") return null;
    const [dx, dy] = [0, 1].map((axis) => this.pointer_mm[axis] - this.from_mm[axis]);
    if (this.tool.value === "circle") return { position_mm: this.from_mm, shape: { radius_mm: Math.hypot(dx, dy) } };
    const [x, y] = [Math.abs(dx) / 2, Math.abs(dy) / 2];
    const position_mm = [this.from_mm[0] + dx / 2, this.from_mm[1] + dy / 2];
    return { position_mm, shape: { corners_mm: [[-x, -y], [x, -y], [x, y], [-x, y]] } };
  }

  finish(figure) {
    if (!figure) return;
    const { radius_mm, corners_mm } = figure.shape;
    const size_mm = radius_mm ?? Math.min(...[0, 1].map((axis) => spread(corners_mm.map((corner) => corner[axis]))));
    if (size_mm < LEAST_MM) return;
    this.drawn = Math.max(this.drawn, ...this.surfaces.layers.filter(({ isOurs }) => isOurs).map(({ name }) => number(name))) + 1;
    const name = `drawn ${this.drawn}`;
    const made = this.content(name);
    if (!made) return;
    this.chosen = name;
    this.contents.set(name, made.content);
    this.surfaces.effects.set(name, made.about);
    this.lay({ name, z: Z, ...figure });
    if (made.effect) this.ask((client) => client.effect(made.effect.name, made.effect));
  }

  /** Draw what is not laid yet. */
  draw(context, to, scale) {
    const lines = new Path2D();
    const figure = this.tool.value === "polygon" ? null : this.preview();
    if (figure?.shape.radius_mm) lines.arc(...to(figure.position_mm), figure.shape.radius_mm * scale, 0, 2 * Math.PI);
    const ends = figure?.shape.corners_mm?.map(([x, y]) => [x + figure.position_mm[0], y + figure.position_mm[1]]);
    const way = ends ? [...ends, ends[0]] : this.corners.length ? [...this.corners, this.pointer_mm] : [];
    way.map(to).forEach(([x, y], i) => (i ? lines.lineTo(x, y) : lines.moveTo(x, y)));
    context.strokeStyle = "#fff";
    context.lineWidth = 2;
    context.stroke(lines);
  }
}

const spread = (values) => Math.max(...values) - Math.min(...values);
const number = (name) => Number(name.match(/^drawn (\d+)$/)?.[1] ?? 0);
