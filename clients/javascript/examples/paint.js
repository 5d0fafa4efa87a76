/**
 * Paint frictions on the plate; fingers are coloured by what they feel. Run in clients/javascript:
 *
 *   python3 -m http.server 8000 --bind 127.0.0.1
 *   hapticd gateway --origin http://127.0.0.1:8000
 *
 * and open http://127.0.0.1:8000/examples/paint.html# with the printed ws:// address behind the #.
 */
import { connect } from "../hapticd.js";

const MAX_STRIPS = 16; // surfaces of one client
const WIDTH_MM = 8;
const element = (id) => document.getElementById(id);
const canvas = element("plate");
const draw = canvas.getContext("2d");
const strips = []; // { name, friction, from, to }, the newest last
let sizeMm = [137.5, 137.5];
let fingers = [];
let painted = 0;

const say = (text) => (element("said").textContent = text);
const colour = (friction) => `hsl(${30 + 190 * (1 - friction)} 85% 55%)`; // blue slips, orange sticks
const toPixels = ([x, y]) => [(x / sizeMm[0] + 0.5) * canvas.width, (0.5 - y / sizeMm[1]) * canvas.height];

function toMm(event) {
  const box = canvas.getBoundingClientRect();
  const share = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  return [(share[0] - 0.5) * sizeMm[0], (0.5 - share[1]) * sizeMm[1]];
}

function surfaceOf({ friction, from, to }) {
  const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
  return {
    friction,
    rectangle_mm: [Math.hypot(dx, dy) + WIDTH_MM, WIDTH_MM],
    position_mm: [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2],
    angle_rad: Math.atan2(dy, dx),
  };
}

function paint() {
  draw.clearRect(0, 0, canvas.width, canvas.height);
  draw.lineCap = "round";
  draw.lineWidth = (WIDTH_MM / sizeMm[0]) * canvas.width;
  for (const { friction, from, to } of strips) {
    draw.strokeStyle = colour(friction);
    draw.beginPath();
    draw.moveTo(...toPixels(from));
    draw.lineTo(...toPixels(to));
    draw.stroke();
  }
  for (const finger of fingers) {
    const [x, y] = toPixels([finger.x_mm, finger.y_mm]);
    const felt = finger.felt_friction ?? 1;
    draw.fillStyle = colour(felt);
    draw.strokeStyle = "#000";
    draw.lineWidth = 2;
    draw.beginPath();
    draw.arc(x, y, 22, 0, 2 * Math.PI);
    draw.fill();
    draw.stroke();
    draw.fillStyle = "#000";
    draw.fillText(`${finger.id}: ${felt.toFixed(2)}`, x + 28, y);
  }
  requestAnimationFrame(paint);
}

async function lay(plate, strip) {
  strips.push(strip);
  if (strips.length > MAX_STRIPS) await plate.remove(strips.shift().name);
  await plate.surface(strip.name, surfaceOf(strip));
}

function listen(plate) {
  let begun = null;
  canvas.onpointerdown = (event) => {
    canvas.setPointerCapture(event.pointerId);
    begun = toMm(event);
  };
  canvas.onpointerup = (event) => {
    if (begun === null) return;
    const strip = { name: `strip ${++painted}`, friction: Number(element("friction").value), from: begun, to: toMm(event) };
    begun = null;
    lay(plate, strip).then(() => say(`${strips.length} strips`), (error) => say(error.message));
  };
  element("friction").oninput = (event) => (element("chosen").value = Number(event.target.value).toFixed(2));
  element("clear").onclick = () => {
    strips.length = 0;
    plate.release().then(() => say("no strips"), (error) => say(error.message));
  };
}

try {
  const plate = await connect(decodeURIComponent(location.hash.slice(1)), { ttlS: 2, timeoutS: 10 });
  plate.onrefused = say;
  plate.onclose = (error) => say(error.message);
  sizeMm = (await plate.request("plate")).size_mm;
  plate.follow((state) => (fingers = state.fingers));
  listen(plate);
  say("connected: drag over the plate");
  paint();
} catch (error) {
  say(error.message);
}
