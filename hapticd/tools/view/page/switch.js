// Menus that restart the simulated plate: which one, how many driven modes, and the radius of a contact.

const RADII_MM = [0, 4, 5, 6, 8];

export class SwitchMenu {
  /** `send` sends a request; the menus stay hidden until the server offers plates. */
  constructor(box, plate, modes, radius, send) {
    Object.assign(this, { box, plate, modes, radius, send });
    this.offered = null;
    this.radius_mm = 0;
    plate.addEventListener("change", () => {
      this.radius_mm = this.offered.contact_radius_mm;
      this.select(this.plate.value, this.offered.plates[this.plate.value].own_modes);
      this.request();
    });
    modes.addEventListener("change", () => this.request());
    radius.addEventListener("change", () => {
      this.radius_mm = Number(radius.value);
      this.request();
    });
  }

  /** `offered`: the plates by name, each with its numbers of modes and its own one, and a contact's usual radius. */
  offer(offered) {
    this.offered = offered;
    this.radius_mm = offered.contact_radius_mm;
    this.plate.replaceChildren(...Object.keys(offered.plates).map((name) => new Option(shortName(name), name)));
    this.box.hidden = false;
  }

  /** Select what the service runs on. */
  show({ name, modes, contact_radius_mm, has_contacts }) {
    if (!this.offered?.plates[name]) return;
    if (has_contacts) this.radius_mm = contact_radius_mm;
    this.select(name, modes);
  }

  /** Select a plate and one of its numbers of modes; with few modes amplitudes count at points, whatever the radius. */
  select(name, modes) {
    this.plate.value = name;
    this.modes.replaceChildren(...this.offered.plates[name].modes.map((count) => new Option(count, count)));
    this.modes.value = modes;
    this.radius.disabled = modes < this.offered.least_contact_modes;
    const radii_mm = this.radius.disabled ? [0] : RADII_MM;
    this.radius.replaceChildren(...radii_mm.map((mm) => new Option(mm === 0 ? "points" : `${mm} mm`, mm)));
    this.radius.value = this.radius.disabled ? 0 : this.radius_mm;
  }

  request() {
    const modes = Number(this.modes.value);
    this.send({ op: "switch", plate: this.plate.value, modes, contact_radius_mm: this.radius_mm });
  }
}

/** A plate's name; of one that a file describes, the file's. */
export const shortName = (name) => name.split("/").at(-1);
