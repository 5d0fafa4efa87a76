// List of fingers: what each was asked to feel and feels, its owner, and the controls of this page.

const MOST_UM = 2;
const STEP_UM = 0.05;
export const SLIPPERY = 0.49; // friction beside bare glass: as much as four modes can give

export class FingerList {
  /** `ask` has the page's client do something, `choose` selects the finger that the keys control. */
  constructor(list, untouched, ask, choose) {
    this.list = list;
    this.untouched = untouched;
    this.ask = ask;
    this.choose = choose;
    this.rows = new Map();
  }

  /** Show these fingers; `client` is this page's client name. */
  show(fingers, chosen, client, isLive) {
    const ids = new Set(fingers.map((finger) => finger.id));
    for (const [id, row] of this.rows) {
      if (!ids.has(id)) {
        row.box.remove();
        this.rows.delete(id);
      }
    }
    this.untouched.hidden = fingers.length > 0;
    for (const finger of fingers) {
      if (!this.rows.has(finger.id)) this.rows.set(finger.id, this.row(finger));
      this.fill(this.rows.get(finger.id), finger, finger.id === chosen, client, isLive);
    }
  }

  row(finger) {
    const { id } = finger;
    const box = made("div", "finger");
    const name = made("button", "name", finger.virtual ? `${id} (virtual)` : `Finger ${id}`);
    name.addEventListener("click", () => this.choose(id));
    const amounts = made("span", "amounts");
    const owner = made("span", "owner quiet");
    const slider = made("input");
    Object.assign(slider, { type: "range", min: 0, max: MOST_UM, step: STEP_UM });
    slider.setAttribute("aria-label", `Amplitude for finger ${id}, micrometres`);
    slider.addEventListener("input", () => this.ask((client) => client.set(id, { amplitude_um: Number(slider.value) })));
    const choices = made("span", "choices");
    const sticky = this.choice("Sticky", (client) => client.set(id, { amplitude_um: 0 }));
    const slippery = this.choice("Slippery", (client) => client.set(id, { friction: SLIPPERY }));
    const release = this.choice("Release", (client) => client.release(id));
    choices.append(sticky, slippery, release);
    box.append(name, amounts, slider, choices, owner);
    this.list.append(box);
    return { box, name, amounts, owner, slider, sticky, slippery, release };
  }

  choice(text, change) {
    const button = made("button", "", text);
    button.addEventListener("click", () => this.ask(change));
    return button;
  }

  fill(row, finger, isChosen, client, isLive) {
    const { target_um, gets_um, owner } = finger;
    const isOurs = owner === null || owner === client;
    row.box.classList.toggle("slip", target_um > 0);
    row.box.classList.toggle("stick", target_um === 0);
    row.box.classList.toggle("chosen", isChosen);
    row.name.setAttribute("aria-pressed", isChosen);
    const gets = gets_um === null ? "–" : `${gets_um.toFixed(2)}${intervalText(finger.gets_low, finger.gets_high)}`;
    const amplitude = `${gets} µm ${target_um === null ? "(no target)" : `of ${target_um.toFixed(2)}`}`;
    const friction = frictionText(finger);
    write(row.amounts, friction || amplitude);
    row.amounts.classList.toggle("felt", finger.misses_target ?? Math.abs(finger.error_jnd) > 1);
    const whose = owner === null ? "no owner" : isOurs ? "ours" : `held by '${owner}': only that client can change it`;
    write(row.owner, friction ? [`${amplitude} over the contact`, ...errorsText(finger), whose].join(" · ") : whose);
    for (const control of [row.slider, row.sticky, row.slippery]) control.disabled = !isOurs || !isLive;
    row.release.disabled = owner !== client || !isLive;
    row.sticky.setAttribute("aria-pressed", owner !== null && target_um === 0);
    row.slippery.setAttribute("aria-pressed", target_um > 0);
    if (document.activeElement !== row.slider) row.slider.value = target_um ?? 0;
  }
}

/** What a contact feels and was asked to, and how many just noticeable differences lie between. */
function frictionText(finger) {
  const { felt_friction, felt_friction_low, felt_friction_high, error_jnd, asked_friction: asked } = finger;
  if (felt_friction === null) return "";
  const wanted = asked === null ? "" : `, asked ${asked.toFixed(2)}${noticed(error_jnd)}`;
  return `feels ${felt_friction.toFixed(2)}${intervalText(felt_friction_low, felt_friction_high)}${wanted}`;
}

/** Whether a person notices the difference, which is given in just noticeable ones. */
function noticed(error_jnd) {
  const times = Math.abs(error_jnd);
  return times > 1 ? ` · off by ${times.toFixed(times < 9.95 ? 1 : 0)} × what is noticed` : " ✓";
}

/** How far off a finger's friction was since it had a target, by what the daemon believes of the person. */
function errorsText({ bias_jnd, median_jnd, error_95_jnd, felt_frac, within_two_frac }) {
  if (median_jnd === null) return [];
  const [bias, median, most] = [bias_jnd, median_jnd, error_95_jnd].map((jnd) => jnd.toFixed(1));
  const [one, two] = [felt_frac, within_two_frac].map((share) => Math.round(100 * share));
  return [`off by ${median} JND (95 %: ${most}, bias ${bias}), within one ${one} %, two ${two} % of the time`];
}

/** Where a value lies in nine of ten cases; nothing where it is sure, or of an older daemon. */
function intervalText(low, high) {
  const [from, to] = [low?.toFixed(2), high?.toFixed(2)];
  return from === to ? "" : ` (${from} … ${to})`;
}

/** Write a text only if it differs, which avoids a new layout. */
export function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function made(tag, className = "", text = "") {
  const element = document.createElement(tag);
  if (tag === "button") element.type = "button";
  if (className) element.className = className;
  if (text) element.textContent = text;
  return element;
}
