// Menus that restart the simulated plate: which one, how many driven modes, and the radius of a contact.

const RADII_MM = [0, 4, 5, 6, 8];

export class SwitchMenu {
  /** `send` sends a request; the menus stay hidden until the server offers plates. */
  constructor(box, plate, modes, radius, send) {
    Object.assign(this, { box, plate, modes, radius, send });
    this.plates = {};
    radius.replaceChildren(...RADII_MM.map((mm) => new Option(mm === 0 ? "points" : `${mm} mm`, mm)));
    radius.value = 5;
    plate.addEventListener("change", () => {
      this.offerModes();
      this.request();
    });
    for (const menu of [modes, radius]) menu.addEventListener("change", () => this.request());
  }

  /** `plates`: numbers of modes by name. */
  offer(plates) {
    this.plates = plates;
    this.plate.replaceChildren(...Object.keys(plates).map((name) => new Option(name, name)));
    this.box.hidden = false;
  }

  /** Select what the service runs on. */
  show({ name, modes, contact_radius_mm, has_contacts }) {
    if (!(name in this.plates)) return;
    this.plate.value = name;
    this.offerModes();
    this.modes.value = modes;
    if (has_contacts) this.radius.value = contact_radius_mm;
  }

  /** Offer the plate's numbers of modes; the same stays selected where it can, else four, whole contacts' least. */
  offerModes() {
    const before = Number(this.modes.value);
    const counts = this.plates[this.plate.value] ?? [];
    this.modes.replaceChildren(...counts.map((count) => new Option(count, count)));
    this.modes.value = counts.includes(before) ? before : counts[Math.min(2, counts.length - 1)];
  }

  request() {
    const [modes, contact_radius_mm] = [Number(this.modes.value), Number(this.radius.value)];
    this.send({ op: "switch", plate: this.plate.value, modes, contact_radius_mm });
  }
}
