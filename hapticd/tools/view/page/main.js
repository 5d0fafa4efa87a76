// The page: messages of the server go into the history, and each picture shows one of its frames.

import { drawLatency, drawModes, drawScale } from "./charts.js";
import { theme } from "./colours.js";
import { Drawing } from "./draw.js";
import { Effects, ringSpan_s } from "./effects.js";
import { Field } from "./field.js";
import { FingerList, SLIPPERY, write } from "./fingers.js";
import { Flags } from "./flags.js";
import { FrictionCurve } from "./friction.js";
import { Hands } from "./hands.js";
import { History, judge, motion } from "./history.js";
import { Link } from "./link.js";
import { PlatePicture } from "./plate.js";
import { backAt, drawStrip } from "./strip.js";
import { Surfaces } from "./surfaces.js";
import { LayerContent, RecordButton, Tools, openHelp } from "./toolbar.js";

const SLOW_MS = 120; // texts change no faster than they can be read
const STEP_UM = 0.2; // of the number keys
const NEAR_MM = 10;
const HINTS = {
  simulated:
    "Drag on the plate to touch it. Shift-click leaves a finger lying there, and lifts it again. A finger held still for 0.6 s " +
    "presses harder. Keys, on the plate: Enter lands and lifts a finger, arrows move it, P presses harder while held, Esc lifts all; " +
    "anywhere: 0 makes the chosen finger sticky, 1 … 9 give it 0.2 … 1.8 µm, R releases it, space pauses. Drag on the strip to look back.",
  real: "Click a finger to choose it. Keys: 0 makes it sticky, 1 … 9 give it 0.2 … 1.8 µm, R releases it, space pauses.",
};
const TOUCH_HINTS = {
  simulated: "Touch the plate with one finger or several: the first becomes slippery, the second sticky. Hold one still and it presses " +
    "harder. The list below has the controls of each while it lies there. Draw along the strip to look back.",
  real: "Tap a finger on the plate, or its name, to choose it; its controls are in the list below. Draw along the strip to look back.",
};
const TIPS = {
  mouse: "Shift-click leaves a finger lying. All keys: press ?",
  touch: "Touch with several fingers at once; ? tells more.",
};
const INVITATION = "Drag here to touch the plate";
const TOUCH_INVITATION = "Touch the plate here";
const isTouch = () => matchMedia("(pointer: coarse)").matches;
const ENDED = "The viewer has ended: start `hapticd view` again, and open the address it prints.";
const FIELDS = {
  true: "as the simulated plate truly moves",
  measured: "as the board measures it",
  asked: "as asked of the board",
};

const $ = (id) => document.getElementById(id);
const history = new History();
const picture = new PlatePicture($("plate"));
const surfaces = new Surfaces();
const effects = new Effects();
let plate = null;
let curve = null;
let status = null;
let chosen = null;
let colours = theme();
let isLive = false;
let starting = ""; // what is being started: no failure
let pictures = 0;
let t_texts_ms = 0;

const link = new Link({
  plate: async (message) => {
    plate = message;
    starting = "";
    chosen = null;
    greeted.clear(); // another daemon counts its fingers from 1
    history.clear();
    lay([]);
    effects.compare(0);
    curve = new FrictionCurve(message.friction_curve);
    drawing.size_mm = message.size_mm;
    const shapes = await link.shapes();
    if (plate !== message) return;
    picture.field = new Field(shapes, message.size_mm, message.w_limit_um);
    const { name, person, modes, has_contacts, contact_radius_mm } = message;
    picture.radius_mm = contact_radius_mm;
    picture.least_friction = curve.at(1);
    const contacts = has_contacts ? `, contacts of ${contact_radius_mm} mm` : "";
    const whose = person ? `, for ${person}` : "";
    write($("what"), `${name.split("/").at(-1)} plate, ${modes} modes${contacts}${whose}`.trim());
    hands.allow(message.simulated ? message.size_mm : null);
    writeHints();
    $("new-box").hidden = !message.simulated;
    if (!$("notice").classList.contains("mild")) notice("");
  },
  frame: (message) => {
    if (!plate) return; // one of before this page knew its plate
    isLive = true;
    effects.take(message.events);
    message.layers = surfaces.layers;
    history.add(judge(message, picture.field, curve, plate));
    giveTargets(message);
  },
  status: (message) => {
    if (message.undriven !== (status?.undriven ?? "")) notice(message.undriven);
    status = message;
    effects.compare(message.effects_playing);
  },
  surfaces: (message) => {
    if (!drawing.dragged) lay(message.surfaces);
  },
  recording: (message) => record.take(message),
  starting: (message) => {
    starting = message.sentence;
    stopped(starting, "");
  },
  gone: (message) => {
    starting = "";
    stopped("No daemon", message.sentence);
  },
  refused: (message) => notice(message.sentence, 6000, true),
  lost: (why) => {
    starting = "";
    stopped("Not connected", why || ENDED);
  },
});
const send = (request) => link.send(request);
const ask = (change) => link.ask(change);
const [tools, record] = [new Tools($("tool")), new RecordButton($("record"), send, notice)];
const content = new LayerContent({ kind: $("content"), amount: $("amount"), text: $("amount-text"), button: $("file"), file: $("file-input") },
  notice);
const drawing = new Drawing($("plate"), tools, surfaces, {
  ask,
  content: (name) => content.of(name),
  now: () => history.newest?.t_s ?? 0,
});
const hands = new Hands($("plate"), send, pointedAt);
const flags = new Flags($("flags"), () => ask((client) => client.request("clear_fault")));
const list = new FingerList($("fingers"), $("untouched"), ask, choose);

function stopped(state, sentence) {
  isLive = false;
  status = null;
  hands.allow(null);
  lay([]);
  write($("state"), state);
  flags.show(history.current, null, false);
  notice(sentence);
}

/** What a person can do here, by whether there is a mouse or a touch screen. */
function writeHints() {
  write($("hint"), (isTouch() ? TOUCH_HINTS : HINTS)[plate?.simulated ? "simulated" : "real"]);
  write($("tip"), plate?.simulated ? TIPS[isTouch() ? "touch" : "mouse"] : "");
}
matchMedia("(pointer: coarse)").addEventListener("change", writeHints);

let t_notice = 0;
/** Show a sentence, for a while or until another; a mild one is no failure. */
function notice(sentence, for_ms = 0, isMild = false) {
  clearTimeout(t_notice);
  write($("notice"), sentence);
  $("notice").hidden = sentence === "";
  $("notice").classList.toggle("mild", isMild);
  if (for_ms > 0) t_notice = setTimeout(() => notice(""), for_ms);
}

// --- fingers ---

function choose(id) {
  chosen = id;
}

/** Select the finger at a clicked position (in fractions of the plate) for the keys. */
function pointedAt([right, up]) {
  const frame = history.current;
  if (!frame || !plate) return;
  const there = frame.fingers.find(({ seen_mm: [x_mm, y_mm] }) =>
    x_mm !== null && Math.hypot(x_mm - right * plate.size_mm[0], y_mm - up * plate.size_mm[1]) < NEAR_MM);
  if (there) choose(there.id);
}

/** Have the client change the selected finger, if it exists and no other client owns it. */
function changeChosen(change) {
  const finger = history.newest?.fingers.find(({ id }) => id === chosen);
  if (!finger) return;
  if (finger.owner !== null && finger.owner !== link.name) {
    notice(`Finger ${finger.id} is held by '${finger.owner}': only that client can change it.`, 6000, true);
    return;
  }
  ask((client) => change(client, finger.id));
}

let wayBefore = ""; // of new fingers, before surfaces lay there
/** Take the surfaces in force. The first of them sets the menu, so that new fingers feel them; the last one back. */
function lay(described) {
  const layBefore = surfaces.layers.length > 0;
  surfaces.take(described, link.name);
  if (layBefore === described.length > 0) return;
  if (!layBefore) wayBefore = $("new").value;
  if (!layBefore || $("new").value === "nothing") $("new").value = layBefore ? wayBefore : "nothing";
}

const greeted = new Set();
/** Set the target of a newly landed finger of this page, by the menu. */
function giveTargets(frame) {
  if (!plate?.simulated || history.paused) return;
  const way = $("new").value;
  let isSlippery = frame.fingers.some(({ owner, target_um }) => owner === link.name && target_um > 0);
  for (const finger of frame.fingers) {
    if (finger.virtual || greeted.has(finger.id) || !hands.holds(...finger.seen_mm)) continue;
    greeted.add(finger.id);
    chosen = finger.id;
    if (finger.owner !== null || way === "nothing") continue;
    const sticks = way === "sticky" || (way === "both" && isSlippery);
    ask((client) => client.set(finger.id, { friction: sticks ? 1 : SLIPPERY }));
    isSlippery ||= !sticks;
  }
}

// --- time ---

function pause(paused) {
  history.paused = paused;
  if (!paused) history.back_s = 0;
  $("pause").setAttribute("aria-pressed", paused);
  $("pause").firstChild.data = paused ? "Go on " : "Pause ";
  $("when").value = -history.back_s;
}

$("erase").addEventListener("click", () => drawing.erase());
$("pause").addEventListener("click", () => pause(!history.paused));
$("when").addEventListener("input", () => {
  if (!history.paused) pause(true);
  history.back_s = -Number($("when").value);
});
/** Dragging along the strip pauses and looks back. */
function lookBack(event) {
  if (event.buttons === 0 || !history.newest) return;
  if (!history.paused) pause(true);
  $("strip").setPointerCapture(event.pointerId);
  history.back_s = backAt(event.offsetX, $("strip").clientWidth);
  $("when").value = -history.back_s;
}
$("strip").addEventListener("pointerdown", lookBack);
$("strip").addEventListener("pointermove", lookBack);
openHelp($("help"), $("help-box"));
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target instanceof HTMLSelectElement) return;
  if (event.key === " " && !(event.target instanceof HTMLButtonElement)) {
    event.preventDefault();
    pause(!history.paused);
  } else if (/^[0-9]$/.test(event.key)) {
    const amplitude_um = Number((event.key * STEP_UM).toFixed(1));
    changeChosen((client, finger) => client.set(finger, { amplitude_um }));
  } else if (event.key.toLowerCase() === "r") {
    changeChosen((client, finger) => client.release(finger));
  }
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => (colours = theme()));

// --- pictures ---

function draw(t_ms) {
  requestAnimationFrame(draw);
  hands.flush();
  const frame = history.current;
  const isUntouched = frame?.fingers.length === 0 && surfaces.layers.length === 0;
  const isInviting = plate?.simulated && isLive && isUntouched && tools.value === "touch";
  const invitation = isInviting ? (isTouch() ? TOUCH_INVITATION : INVITATION) : starting;
  picture.draw(frame, { chosen, isLive, invitation, surfaces, drawing, effects, recent: history.recent(ringSpan_s) });
  if (pictures % 2 === 0) drawStrip($("strip"), history, colours); // it moves by a pixel in 30 ms
  if (plate && frame) {
    const is = motion(frame);
    const modes = [{ phasors: frame.modal_um, colour: colours.asked, wide: 3.5 }];
    if (is.of !== "asked") modes.push({ phasors: is.modal_um, colour: colours.slip, wide: 2 });
    drawModes($("modes"), modes, plate.w_limit_um, colours);
  }
  pictures++;
  if (t_ms - t_texts_ms < SLOW_MS) return;
  document.body.dataset.rate = Math.round(pictures * 1000 / (t_ms - t_texts_ms));
  [t_texts_ms, pictures] = [t_ms, 0];
  writeTexts(frame);
}

/** The texts, for readers and for screen readers. */
function writeTexts(frame) {
  list.show(frame?.fingers ?? [], chosen, link.name, isLive && !history.paused);
  drawLatency($("latency"), status?.latency ?? {}, colours);
  flags.show(frame, status, isLive);
  if (!frame) return;
  const is = motion(frame);
  const fingers = frame.fingers.length;
  const state = `${frame.state.toLowerCase()} · ${fingers === 1 ? "1 finger" : `${fingers} fingers`}`;
  if (isLive) write($("state"), history.paused ? `paused: ${state}` : state);
  write($("field-of"), FIELDS[is.of]);
  if (picture.field) drawScale($("scale"), picture.field.full_um, colours);
  write($("modes-text"), `${drive()} · grey: asked, blue: ${is.of}`);
  const horizon = frame.horizon_ms?.toFixed(1) ?? "–";
  const rate = status?.frames_hz ? `, ${status.frames_hz.toFixed(0)} frames/s` : "";
  write($("latency-text"), `now ${horizon} ms ahead${rate}`);
  const { leak_um, off_um, felt_frac } = history.leak();
  const labelled = (um, what) => (um === null ? "" : `${what} ${um.toFixed(3)} µm`);
  const felt = felt_frac === null ? "" : `as asked ${Math.round(100 * felt_frac)} %`;
  write($("leak"), [felt, labelled(leak_um, "leak"), labelled(off_um, "slippery off by")].filter(Boolean).join(" · ")
    + (leak_um === null && off_um === null ? "" : " (last 2 s)"));
  write($("surfaces"), [...surfaces.texts(frame.layers), ...effects.texts()].join("\n"));
  $("erase").disabled = drawing.chosen === null || !isLive;
  write($("when-text"), history.paused ? `${(-history.back_s).toFixed(2)} s` : "now");
}

/** The board may answer, and follow the plate with its drive, long after the page knows the plate. */
function drive() {
  const drive_hz = status?.board.drive_hz;
  return drive_hz ? `${(drive_hz / 1000).toFixed(3)} kHz` : "the board has not answered";
}

requestAnimationFrame(draw);
