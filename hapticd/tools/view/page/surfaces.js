// Surfaces in force: where each layer is at an instant, its picture, and which one is at a place.

const BLUE = [31, 119, 180];
const ORANGE = [230, 130, 60];
const FULL_UM = 2;
const OPAQUE = 0.45;
const MOST_LISTED = 6;

export class Surfaces {
  constructor() {
    this.layers = [];
    this.client = null;
    this.effects = new Map(); // texts of what this page lets play, by the layer's name
  }

  /** Take the layers of a message, topmost first; `client` is this page's client name. */
  take(layers, client) {
    this.client = client;
    this.layers = layers.map((layer) => {
      const isOurs = layer.client === client;
      const effect = isOurs && this.effects.get(layer.name);
      return { ...layer, isOurs, about: effect ? `${layer.about}, ${effect}` : layer.about, canvas: canvasOf(layer) };
    });
  }

  /** Draw those of a frame, the lowest first, and what each shape holds. */
  draw(context, to, scale, { layers, t_s }, chosen) {
    for (const layer of layers.toReversed()) {
      const { x_mm, y_mm, angle_rad } = pose(layer, t_s);
      const [x, y] = to([x_mm, y_mm]);
      context.save();
      context.translate(x, y);
      context.rotate(-angle_rad);
      context.scale(scale * layer.scale, -scale * layer.scale);
      const path = pathOf(layer);
      fill(context, layer, path);
      context.restore();
      outline(context, layer, path, new DOMMatrix().translate(x, y).rotate((-angle_rad * 180) / Math.PI)
        .scale(scale * layer.scale, -scale * layer.scale), layer.name === chosen && layer.isOurs);
      if (layer.shape) label(context, layer, x, y);
    }
  }

  /** The topmost layer of this page's client at a place, of those that `isKnown` names, or undefined. */
  oursAt(place_mm, t_s, isKnown) {
    return this.layers.find((layer) =>
      layer.isOurs && layer.shape && isKnown(layer.name) && holds(layer, local(layer, place_mm, t_s)));
  }

  /** One line of text for each layer. */
  texts(layers) {
    const lines = layers.map(({ name, client, about, z, blend }) =>
      `${name} (${client}): ${about}, z ${z}${blend === "replace" ? "" : `, ${blend}`}`);
    const more = lines.length - MOST_LISTED;
    return more > 0 ? [...lines.slice(0, MOST_LISTED), `and ${more} more`] : lines;
  }
}

/** Origin and angle of a layer at an instant. */
export function pose(layer, t_s) {
  const since_s = t_s - layer.t_pose_s;
  const angle_rad = layer.angle_rad + since_s * layer.turning_rad_s;
  const [x_mm, y_mm] = layer.path
    ? along(layer.path, since_s)
    : layer.position_mm.map((at, axis) => at + since_s * layer.velocity_mm_s[axis]);
  return { x_mm, y_mm, angle_rad };
}

/** Where a path is after a time: back and forth if it loops, else it ends at its last point. */
function along({ points_mm, speed_mm_s, loop }, since_s) {
  const lengths = points_mm.slice(1).map(([x, y], i) => Math.hypot(x - points_mm[i][0], y - points_mm[i][1]));
  const whole = lengths.reduce((sum, length) => sum + length, 0);
  let left = Math.max(since_s, 0) * speed_mm_s;
  if (loop && whole > 0) left = whole - Math.abs((left % (2 * whole)) - whole);
  for (let i = 0; i < lengths.length; i++) {
    if (left <= lengths[i]) {
      const part = lengths[i] > 0 ? left / lengths[i] : 0;
      return points_mm[i].map((from, axis) => from + part * (points_mm[i + 1][axis] - from));
    }
    left -= lengths[i];
  }
  return points_mm.at(-1);
}

function local(layer, [place_x, place_y], t_s) {
  const { x_mm, y_mm, angle_rad } = pose(layer, t_s);
  const [dx, dy, cos, sin] = [place_x - x_mm, place_y - y_mm, Math.cos(angle_rad), Math.sin(angle_rad)];
  return [(cos * dx + sin * dy) / layer.scale, (cos * dy - sin * dx) / layer.scale];
}

function holds({ shape }, [u, v]) {
  if (shape.radius_mm) return Math.hypot(u, v) <= shape.radius_mm;
  let inside = false;
  shape.corners_mm.forEach(([to_u, to_v], i) => {
    const [from_u, from_v] = shape.corners_mm.at(i - 1);
    if (from_v > v !== to_v > v && u < from_u + ((v - from_v) * (to_u - from_u)) / (to_v - from_v)) inside = !inside;
  });
  return inside;
}

/** The shape in the layer's frame; without one the layer is everywhere, which is drawn as a wide rectangle. */
function pathOf({ shape, box_mm }) {
  const path = new Path2D();
  if (shape?.radius_mm) path.arc(0, 0, shape.radius_mm, 0, 2 * Math.PI);
  else if (shape) shape.corners_mm.forEach(([x, y], i) => (i ? path.lineTo(x, y) : path.moveTo(x, y)));
  else path.rect(-box_mm[0], -box_mm[1], 2 * box_mm[0], 2 * box_mm[1]);
  path.closePath();
  return path;
}

function fill(context, { canvas, amplitude_um, box_mm }, path) {
  if (!canvas) {
    context.fillStyle = `rgb(${colour(amplitude_um).join(" ")} / ${OPAQUE})`;
    context.fill(path, "evenodd");
    return;
  }
  context.clip(path, "evenodd");
  context.imageSmoothingEnabled = true;
  context.scale(1, -1);
  context.drawImage(canvas, -box_mm[0] / 2, -box_mm[1] / 2, box_mm[0], box_mm[1]);
}

function outline(context, layer, path, matrix, isChosen) {
  if (!layer.shape) return;
  const placed = new Path2D();
  placed.addPath(path, matrix);
  context.strokeStyle = layer.isOurs ? "rgb(255 255 255 / .9)" : "rgb(255 255 255 / .5)";
  context.lineWidth = isChosen ? 3 : 1.25;
  context.setLineDash(layer.isOurs ? [] : [4, 3]);
  context.stroke(placed);
  context.setLineDash([]);
}

/** What a layer holds, in the middle of its shape. */
function label(context, { about }, x, y) {
  context.font = "11.5px system-ui, sans-serif";
  const wide = context.measureText(about).width;
  context.fillStyle = "rgb(12 16 20 / .6)";
  context.fillRect(x - wide / 2 - 4, y - 8, wide + 8, 16);
  context.fillStyle = "#fff";
  context.textBaseline = "middle";
  context.fillText(about, x - wide / 2, y + 0.5);
}

/** From sticky orange to slippery blue. */
function colour(amplitude_um) {
  const part = Math.min(amplitude_um / FULL_UM, 1);
  return ORANGE.map((sticky, i) => Math.round(sticky + part * (BLUE[i] - sticky)));
}

/** The picture of content that varies, or null. */
function canvasOf({ levels, most_um }) {
  if (!levels) return null;
  const bytes = Uint8Array.from(atob(levels), (character) => character.charCodeAt(0));
  const side = Math.round(Math.sqrt(bytes.length));
  const image = new ImageData(side, side);
  bytes.forEach((level, i) => image.data.set([...colour((level / 255) * most_um), OPAQUE * 255], 4 * i));
  const canvas = new OffscreenCanvas(side, side);
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}
