/** Types of hapticd.js. */

/** Base64; a `Uint8Array` is sent as that. */
export type Bytes = Uint8Array | string;

// --- made of the contract by clients/schema/write.py
/** The message of the `targets` socket. */
export interface TargetsMessage {
  /** owner of these fingers; must be unique */
  client: string;
  /** for how long the message holds */
  ttl_s?: number;
  /** increases with each change of targets; see below */
  stamp?: number | null;
  /** of fingers */
  targets?: readonly FingerTarget[];
  /** virtual fingers */
  virtuals?: readonly VirtualFinger[];
  /** content that lies on the plate; see [below](#surfaces) */
  surfaces?: readonly Surface[];
  /** content that depends on time; see [below](#effects) */
  effects?: readonly Effect[];
  v: 1;
}

/** What one finger is to feel, wherever it goes: a finger on the plate by its id, or a virtual one by its name. Where not all fingers can feel what is asked, those with the highest `priority` come first. */
export interface FingerTarget {
  /** the id from telemetry, or the name of one of the message's own virtual fingers */
  finger: number | string;
  /** the highest come first where the plate cannot meet all targets */
  priority?: number;
  /** constant vibration; 0 holds the glass still. Also limited by the plate */
  amplitude_um?: number | null;
  /** 0 is the most slippery that the plate allows, 1 is bare glass; converted by the daemon's friction curve */
  friction?: number | null;
  /** stripes, with a crest through the centre */
  grating?: Grating | null;
  /** an image over the whole plate, edge to edge; bilinear between pixels */
  map?: LevelMap | null;
  /** linear along a direction, with the centre in the middle */
  gradient?: Gradient | null;
  /** a random texture */
  noise?: Noise | null;
}

/** Stripes across `angle_rad` (anticlockwise from +x), with a crest of `high_um` through the centre. A sine between the two amplitudes, or for `duty_frac` above 0 a square wave with that share of the period high. */
export interface Grating {
  /** from crest to crest */
  period_mm: number;
  /** on the crests */
  high_um: number;
  /** between them */
  low_um?: number;
  /** anticlockwise from +x */
  angle_rad?: number;
  /** 0: a sine, else a square wave with that share of the period high */
  duty_frac?: number;
}

/** An image of amplitudes over the whole plate, or the box of a surface, edge to edge: `levels` are width x height bytes by rows from the top (+y) down, 0 is `low_um`, 255 `high_um`; bilinear between pixels. At most 128 x 128 pixels. With `asset`, the SHA-256 of an uploaded asset, the levels are that asset's, and at most 1024 x 1024. With `friction`, those of level 0 and 255, it is an image of frictions, and has no amplitudes. */
export interface LevelMap {
  /** pixels; at most 128 without an asset */
  width: number;
  height: number;
  /** width x height bytes, by rows from the top (+y) down */
  levels?: Bytes;
  /** at level 0 */
  low_um?: number;
  /** at level 255 */
  high_um?: number | null;
  /** instead of `levels`: the SHA-256 of an uploaded asset */
  asset?: Bytes | null;
  /** instead of the amplitudes: the frictions of level 0 and 255 */
  friction?: readonly [number, number] | null;
}

/** An amplitude that changes linearly along `angle_rad` (anticlockwise from +x), from `from_um` to `to_um` over `length_mm` with the centre in the middle; constant beyond. */
export interface Gradient {
  /** over which it changes; constant beyond */
  length_mm: number;
  /** at its end */
  to_um: number;
  /** at its beginning */
  from_um?: number;
  /** anticlockwise from +x */
  angle_rad?: number;
}

/** A random texture, the same for the same `seed`: waves of wavelengths `shortest_mm` .. `longest_mm`, equally many in each octave, in all directions. A wave's height is proportional to its wavelength to the power `exponent`: 0 gives all octaves the same height, 1 looks alike at each scale. `rms_um` is the deviation from `mean_um`, cut at three times as much, and at 0. */
export interface Noise {
  /** shortest wavelength */
  shortest_mm: number;
  /** longest wavelength; equally many waves in each octave */
  longest_mm: number;
  /** deviation from the mean, clipped at three times that, and at 0 */
  rms_um: number;
  /** mean */
  mean_um: number;
  /** a wave's height is proportional to its wavelength to this power */
  exponent?: number;
  /** the same texture for the same seed */
  seed?: number;
}

/** A finger that is on no pad: it walks along a path, and may have a target under its name. */
export interface VirtualFinger {
  /** points on the plate; with one it rests there */
  path_mm: readonly readonly [number, number][];
  /** constant along the path */
  speed_mm_s?: number;
  /** back and forth; else it stops at the last point */
  loop?: boolean;
  /** unique across all clients */
  name: string;
}

/** A layer on the plate: content within a shape, felt by any finger that has no target of its own. Content and shape (without one: everywhere) are in the layer's frame, which is scaled, turned anticlockwise and moved to `position_mm` at `t_pose_ns` (by default when it arrives), and moves on from there with its velocity, or instead along a path, from its first point on. Of two layers the one with the larger `z` is on top. */
export interface Surface {
  /** constant vibration; 0 holds the glass still. Also limited by the plate */
  amplitude_um?: number | null;
  /** 0 is the most slippery that the plate allows, 1 is bare glass; converted by the daemon's friction curve */
  friction?: number | null;
  /** stripes, with a crest through the centre */
  grating?: Grating | null;
  /** an image over the whole plate, edge to edge; bilinear between pixels */
  map?: LevelMap | null;
  /** linear along a direction, with the centre in the middle */
  gradient?: Gradient | null;
  /** a random texture */
  noise?: Noise | null;
  /** unique in its message */
  name: string;
  /** a radius around the origin */
  circle_mm?: number | null;
  /** width and height, centred on the origin */
  rectangle_mm?: readonly [number, number] | null;
  /** corners that enclose 0.01 mm² or more. At most one of the three; without, the whole plate */
  polygon_mm?: readonly readonly [number, number][] | null;
  /** where the origin of the layer lies on the plate */
  position_mm?: readonly [number, number];
  /** of shape and content, anticlockwise around the origin */
  angle_rad?: number;
  /** of shape and content, not of amplitudes */
  scale?: number;
  /** of the origin */
  velocity_mm_s?: readonly [number, number];
  /** path of the origin from `t_pose_ns` on, instead of position and velocity. `hello` lists `surface_path` as `optional` */
  path_mm?: readonly readonly [number, number][] | null;
  /** along the path */
  speed_mm_s?: number;
  /** back and forth along the path */
  loop?: boolean;
  /** angular velocity */
  turning_rad_s?: number;
  /** instant of position and angle, on the axis of telemetry's `t_ns`; default: when the message arrives */
  t_pose_ns?: number | null;
  /** the larger is on top; of equals the last */
  z?: number;
  /** with the amplitude of the layers below; a sum is at most the plate's limit */
  blend?: "add" | "max" | "replace";
}

/** A form in time on a finger, on one of the client's surfaces, or on the whole plate; once, or again and again with `loops`. */
export interface Effect {
  /** unique in its message */
  name: string;
  /** adds a height, with a linear rise and fall */
  pulse?: Pulse | null;
  /** adds a polyline, or multiplies by it */
  envelope?: Envelope | null;
  /** multiplies by a wave */
  modulation?: Modulation | null;
  /** where the effect is: a finger, by its id, */
  finger?: number | null;
  /** or one of the message's own surfaces; default: the whole plate */
  surface?: string | null;
  /** what starts it, see below */
  start?: Now | At | OnLanding | OnLifting | OnEntering | OnLeaving | OnCrossing | OnPressure;
  /** restarts at its end */
  loops?: boolean;
}

/** `height_um` added for `length_s`, with a linear rise and fall of `rise_s` each within it; a negative height is a dip. `rise_s` is at most half of the length, by default 2 ms, or half of the length if that is less. */
export interface Pulse {
  /** added */
  height_um: number;
  length_s: number;
  /** linear rise and fall within the length, at most half of it; default 0.002, if that fits */
  rise_s?: number | null;
}

/** 2 .. 256 points (t_s, value) from 0 s on, for 0.001 s or more, none earlier than the one before it; linear in between, two at one instant are a step. Values are um that are added, or with `is_factor` factors 0 .. 10 of what the finger feels. */
export interface Envelope {
  /** `[t_s, value]` in order of time, the first at 0, the last at 0.001 or later; 1024 in all of a message. Linear in between, two at one instant are a step */
  points: readonly readonly [number, number][];
  /** multiplies by values of 0 .. 10; else adds um */
  is_factor?: boolean;
}

/** What the finger feels, times 1 - depth/2 + depth/2 * wave. The wave begins at 1 and is within -1 .. 1: a cosine, or 1 and -1 for half a period each. Without `length_s` it plays until it is ended. */
export interface Modulation {
  frequency_hz: number;
  /** multiplies by 1 - depth/2 + depth/2 · wave */
  depth?: number;
  /** a cosine, or 1 and -1 for half a period each */
  shape?: "sine" | "square";
  /** default: until it is ended */
  length_s?: number | null;
}

/** When the message arrives; with another `id` once more. */
export interface Now {
  cause: "now";
  /** another one starts it again; an effect with a length starts once per id above 0, also after it expired */
  id?: number;
}

/** At an instant of the daemon's monotonic clock (ns); a late message plays what is left. */
export interface At {
  cause: "at";
  /** on the daemon's monotonic clock */
  t_ns: number;
}

/** Each time a finger lands; that finger feels it. */
export interface OnLanding {
  cause: "landing";
}

/** Each time a finger lifts; the others feel it. */
export interface OnLifting {
  cause: "lifting";
}

/** Each time a finger is predicted to enter one of this client's surfaces; that finger feels it. */
export interface OnEntering {
  cause: "entering";
  /** one of the message's own */
  surface: string;
}

/** Each time a finger is predicted to leave one of this client's surfaces; that finger feels it. */
export interface OnLeaving {
  cause: "leaving";
  /** one of the message's own */
  surface: string;
}

/** Each time a finger is predicted to cross the edge of one of this client's surfaces; that finger feels it. */
export interface OnCrossing {
  cause: "crossing";
  /** one of the message's own */
  surface: string;
}

/** Each time a finger's pressure (0 .. 1) reaches `threshold`, after it was `release` or less; that finger feels it. `release` is by default three quarters of the threshold. */
export interface OnPressure {
  cause: "pressure";
  threshold: number;
  /** below the threshold; default three quarters of it */
  release?: number | null;
}

/** Greets the daemon. */
export interface HelloRequest {
  op: "hello";
  v: 1;
  id: number;
  body?: Nothing;
}

/** No fields. */
export interface Nothing {
}

/** Asks what the daemon knows, and for its bounds. */
export interface CapabilitiesRequest {
  op: "capabilities";
  v: 1;
  id: number;
  body?: Nothing;
}

/** A `targets` message with an answer: an error if anything was refused; the rest is active. */
export interface SetRequest {
  op: "set";
  body: ClientTargets;
  v: 1;
  id: number;
}

/** All present targets, surfaces and effects of one client; they replace that client's earlier ones. They expire `ttl_s` after their arrival. `stamp` grows with each change of what the client requests. Of surfaces with equal `z` the last is on top. */
export interface ClientTargets {
  /** owner of these fingers; must be unique */
  client: string;
  /** for how long the message holds */
  ttl_s?: number;
  /** increases with each change of targets; see below */
  stamp?: number | null;
  /** of fingers */
  targets?: readonly FingerTarget[];
  /** virtual fingers */
  virtuals?: readonly VirtualFinger[];
  /** content that lies on the plate; see [below](#surfaces) */
  surfaces?: readonly Surface[];
  /** content that depends on time; see [below](#effects) */
  effects?: readonly Effect[];
}

/** Releases one finger, or all. */
export interface ReleaseRequest {
  op: "release";
  body: Release;
  v: 1;
  id: number;
}

/** Release one finger (its id, or a virtual finger's name), or without one all fingers, surfaces and effects of the client. `stamp` as in a `targets` message. */
export interface Release {
  client: string;
  /** default: all fingers, surfaces and effects of the client */
  finger?: number | string | null;
  /** as in a `targets` message */
  stamp?: number | null;
}

/** Asks for the daemon's health. */
export interface StatusRequest {
  op: "status";
  v: 1;
  id: number;
  body?: Nothing;
}

/** Asks for what a picture of the plate needs. */
export interface PlateRequest {
  op: "plate";
  v: 1;
  id: number;
  body?: Nothing;
}

/** Clears a latched fault of the board. */
export interface ClearFaultRequest {
  op: "clear_fault";
  v: 1;
  id: number;
  body?: Nothing;
}

/** Adds a marker to recordings and to the next state. */
export interface MarkRequest {
  op: "marker";
  body: MarkerRequest;
  v: 1;
  id: number;
}

/** A label for an instant of an experiment. With `pulse` the board's sync output rises for 5 ms with the next reference that takes effect. */
export interface MarkerRequest {
  /** a name that is free or the user's own */
  client: string;
  text: string;
  /** lets the board's sync output rise for 5 ms as the next reference takes effect, at most every 20 ms */
  pulse?: boolean;
  /** the same as values by name, at most 16: texts of up to 100 printable characters, finite numbers, true, false; `hello` lists it as `marker_fields` */
  fields?: Record<string, boolean | number | number | string>;
}

/** Uploads a part of an asset, or asks how much of it is here. */
export interface AssetRequest {
  op: "asset";
  body: AssetPart;
  v: 1;
  id: number;
}

/** A part of an asset, from `offset` on; without one it only asks how much of it is here. `asset` is the SHA-256 of the whole asset of `size` bytes. */
export interface AssetPart {
  client: string;
  /** SHA-256 of all levels */
  asset: Bytes;
  /** bytes of the whole asset */
  size: number;
  /** where the part begins */
  offset?: number | null;
  /** without one the request only asks */
  part?: Bytes | null;
}

/** Asks for all surfaces in force. */
export interface SurfacesRequest {
  op: "surfaces";
  v: 1;
  id: number;
  body?: Nothing;
}

/** Says who touches the plate. */
export interface PersonRequest {
  op: "person";
  body: PersonQuery;
  v: 1;
  id: number;
}

/** Who touches the plate, by the name of a participant; without one whoever the configuration's curve is of. */
export interface PersonQuery {
  /** of a participant; without one the configuration's friction curve */
  name?: string | null;
}

/** Asks which friction a finger can feel. */
export interface ReachRequest {
  op: "reach";
  body: ReachQuery;
  v: 1;
  id: number;
}

/** Which friction a finger can feel now: its id, a virtual finger's name, or instead one that touched a place. */
export interface ReachQuery {
  /** an id or the name of a virtual finger */
  finger?: number | string | null;
  /** or instead a place on the plate */
  x_mm?: number | null;
  y_mm?: number | null;
}

/** The state of the plate and all fingers at one instant. */
export interface PlateState {
  v: 1;
  /** changes when the daemon restarts */
  instance: number;
  /** counts the states of one instance */
  seq: number;
  /** instant on the host's monotonic clock */
  t_ns: number;
  /** of the daemon: `IDLE` (board or trackpad missing), `ARMED`, `ACTIVE`, `FAULT` (latched), `STOPPED` */
  state: string;
  /** all fingers down and all virtual ones */
  fingers: readonly FingerState[];
  /** real part of each mode's reference phasor */
  modal_um: readonly number[];
  /** a mode reached its limit, so some finger misses its target by calculation */
  limited: boolean;
  /** age of the newest touch sample */
  age_ms: number;
  /** prediction horizon from that sample */
  horizon_ms: number;
  /** markers since the previous state; omitted if empty */
  markers?: readonly Marker[];
  /** imaginary part of each mode's reference phasor: 0 unless several fingers slip */
  modal_q_um?: readonly number[];
  /** the board's last measurement of each mode, `[real, imaginary]`; empty before the first */
  measured_um?: readonly readonly [number, number][] | null;
  /** `misses_target` of any finger */
  misses_target?: boolean | null;
  /** counts changes of the surfaces in force, without refreshes and motion: request `surfaces` when it changes */
  surfaces_version?: number | null;
  /** events since the previous state, in order; omitted if empty */
  events?: readonly PlateEvent[];
  /** delay of the daemon's newest timer tick */
  tick_late_ms?: number | null;
  /** timer ticks skipped since the start */
  missed_ticks?: number | null;
  /** garbage collections above 1 ms since the start */
  pauses?: number | null;
}

/** One finger; nil (None) where nothing was computed, as for a finger without a target. */
export interface FingerState {
  /** as targets name it: a name if `virtual` */
  id: number | string;
  /** its last position */
  x_mm: number;
  y_mm: number;
  /** its position at the end of the prediction horizon */
  predicted_x_mm: number | null;
  predicted_y_mm: number | null;
  /** its target there */
  target_um: number | null;
  /** the expected amplitude there, by the reference's first knot: RMS over its contact, on a plate that is driven for points at its centre */
  achieved_um: number | null;
  /** true for a virtual finger */
  virtual: boolean;
  /** the client that owns it */
  owner: string | null;
  /** its friction over that of its target, both relative to bare glass, minus 1: -0.3 is 30 % more slippery than asked. A target's amplitude stands for the friction of an even vibration */
  friction_change: number | null;
  /** RMS amplitude over its contact */
  contact_um: number | null;
  /** mean friction over its contact, on the scale of targets */
  felt_friction: number | null;
  /** `friction_change` in just noticeable differences of 0.11; nil also on a plate that is driven for points (`contact_radius_mm` of `plate` is 0) */
  error_jnd: number | null;
  /** mean of `friction_change` / 0.11 since the finger had a target and the daemon a subscriber */
  bias_jnd: number | null;
  /** median and 95 % of its size over that time, up to 20 */
  median_jnd: number | null;
  error_95_jnd: number | null;
  /** shares of that time within one and two just noticeable differences */
  felt_frac: number | null;
  within_two_frac: number | null;
  /** intervals of nine in ten cases */
  contact_um_low: number | null;
  contact_um_high: number | null;
  felt_friction_low: number | null;
  felt_friction_high: number | null;
  achieved_um_low: number | null;
  achieved_um_high: number | null;
  error_jnd_low: number | null;
  error_jnd_high: number | null;
  /** it gets less than 0.9 of its target's amplitude, or a friction that is off by more than one just noticeable difference: over its contact, on a plate that is driven for points at its centre */
  misses_target: boolean | null;
  /** whole axes of its contact, an ellipse; nil where the pad's ellipses are not used: then it is a disc */
  contact_major_mm: number | null;
  contact_minor_mm: number | null;
  /** of the longer axis to the plate's x, anticlockwise */
  contact_angle_rad: number | null;
  /** its pressure by the pad's own measure, 0 .. 1: 0 on a pad without one, nil for a virtual finger */
  pressure_frac: number | null;
  /** area of the ellipse that the pad reports, uncalibrated; nil without one */
  area_mm2: number | null;
}

/** A client's label for an instant of its experiment. */
export interface Marker {
  /** its arrival at the daemon */
  t_ns: number;
  client: string;
  text: string;
  /** the same as values by name; omitted if there are none */
  fields?: Record<string, boolean | number | number | string>;
}

/** Event of a finger or an effect; what it does not have is omitted. */
export interface PlateEvent {
  /** number of the event: a gap is a lost one */
  seq: number;
  /** an EventKind; a newer daemon may have more */
  kind: string;
  /** instant of its cause */
  t_ns: number;
  /** the same on the trackpad's own clock; omitted where no finger is the cause */
  t_device_ns?: number | null;
  /** its id */
  finger?: number | null;
  /** its place in the newest report */
  x_mm?: number | null;
  y_mm?: number | null;
  /** owner of the surface or effect */
  client?: string;
  /** its name, of `entered`, `left` and `crossed` */
  surface?: string;
  /** its name, of `pressed`, `released`, `begun` and `ended` */
  effect?: string;
}

/** Which states of the plate to send on this WebSocket from now on; without it none are sent. */
export interface Follow {
  v: 1;
  /** `newest`: a slow reader skips states, and their events; `every`: the newest 256 wait for it */
  states: "every" | "newest" | "none";
}

/** The reply to `hello`. */
export interface Hello {
  protocol: number;
  ops: readonly string[];
  /** fields added within this version: a client sends only those listed here */
  optional: readonly string[];
  targets: readonly string[];
  max_targets: number;
  max_virtuals: number;
  max_priority: number;
  max_path_points: number;
  max_surfaces: number;
  max_polygon_points: number;
  max_map_side: number;
  max_asset_side: number;
  max_asset_bytes: number;
  max_part_bytes: number;
  effects: readonly string[];
  max_effects: number;
  max_envelope_points: number;
  /** of all envelopes */
  max_points: number;
  max_marker_characters: number;
  max_message_bytes: number;
  ttl_s: readonly [number, number];
  /** of the daemon */
  version: string;
  /** changes when the daemon restarts */
  instance: number;
}

/** Everything a client may set, and its bounds. */
export interface Capabilities {
  protocol: number;
  ops: readonly string[];
  /** fields added within this version: a client sends only those listed here */
  optional: readonly string[];
  targets: readonly string[];
  max_targets: number;
  max_virtuals: number;
  max_priority: number;
  max_path_points: number;
  max_surfaces: number;
  max_polygon_points: number;
  max_map_side: number;
  max_asset_side: number;
  max_asset_bytes: number;
  max_part_bytes: number;
  effects: readonly string[];
  max_effects: number;
  max_envelope_points: number;
  /** of all envelopes */
  max_points: number;
  max_marker_characters: number;
  max_message_bytes: number;
  ttl_s: readonly [number, number];
}

/** The reply to `release`. */
export interface Released {
  /** false if the client did not own the finger */
  released: boolean;
}

/** The reply to `asset`. */
export interface Have {
  /** the number of bytes that are here */
  have: number;
}

/** The reply to `marker`. */
export interface Marked {
  /** its arrival */
  t_ns: number;
}

/** The reply to `reach`. */
export interface Reach {
  /** the lowest and the highest friction that this finger, or one that touched there, could feel now, within a just noticeable difference, while the other fingers with their targets feel what they ask for, within one, or as well as without it; nil if there is none. Where it is not one interval, the longest */
  friction: readonly [number, number] | null;
}

/** The reply to `surfaces`. */
export interface Surfaces {
  /** as `surfaces_version` in telemetry */
  version: number;
  /** all in force, topmost first: each with its `client` and the fields of a surface, its pose at its `t_pose_ns`, a rectangle as `polygon_mm`, and of a map 32 pixels per side at most */
  surfaces: readonly Record<string, unknown>[];
}

/** The reply to `plate`: what a picture of the plate needs. */
export interface PlateDescription {
  size_mm: readonly number[];
  /** the largest amplitude of each mode */
  w_limit_um: readonly number[];
  /** the largest reference of each mode */
  reference_limit_um: readonly number[];
  /** of contacts, where the pad's ellipses are not used; 0: points */
  contact_radius_mm: number;
  /** pairs of an amplitude in um and its friction relative to bare glass; its logarithm is linear in between */
  friction_curve: readonly readonly [number, number][];
  /** the sliding speed at which a friction needs twice the amplitude; nil: speed changes nothing */
  friction_speed_mm_s: number | null;
  /** nil until the board answered */
  drive_hz: number | null;
  /** the grid of `shapes` */
  x_mm: readonly number[];
  y_mm: readonly number[];
  modes: number;
  /** the mode map on that grid: float32, little-endian, by mode, then by rows along y */
  shapes: Bytes;
  /** the simulated rig's directory */
  simulated: string | null;
}

// --- end

export type Content = Pick<FingerTarget, "amplitude_um" | "friction" | "grating" | "map" | "gradient" | "noise">;

export declare const PROTOCOL_VERSION: 1;
export declare const DEFAULT_TTL_S: number;

export declare class RefusedError extends Error {}
export declare class GoneError extends Error {}

export interface Options {
  /** 1 .. 32 printable characters; a random one by default */
  name?: string;
  /** for how long targets hold when the page dies or freezes; a hidden page needs more than 1 */
  ttlS?: number;
  timeoutS?: number;
  /** where there is no global one */
  WebSocket?: new (address: string) => unknown;
}

export declare function connect(address: string, options?: Options): Promise<Plate>;
export declare function bytesOf(base64: string): Uint8Array;

export declare class Plate {
  constructor(address: string, options?: Options);
  readonly name: string;
  readonly hello: Hello | null;
  /** called with the sentence where a repeated message was refused */
  onrefused: (sentence: string) => void;
  /** called once when the connection is closed */
  onclose: (error: GoneError) => void;
  opened(): Promise<void>;
  set(finger: number | string, content: Content & { priority?: number }): Promise<void>;
  virtual(name: string, path: Omit<VirtualFinger, "name">): Promise<void>;
  surface(name: string, fields: Omit<Surface, "name">): Promise<void>;
  effect(name: string, fields: Omit<Effect, "name">): Promise<void>;
  release(finger?: number | string): Promise<boolean>;
  remove(surface: string): Promise<void>;
  stop(effect: string): Promise<void>;
  marker(text: string, options?: { pulse?: boolean; fields?: MarkerRequest["fields"] }): Promise<number>;
  request(op: "hello"): Promise<Hello>;
  request(op: "capabilities"): Promise<Capabilities>;
  request(op: "plate"): Promise<Omit<PlateDescription, "shapes"> & { shapes: string }>;
  request(op: "surfaces"): Promise<Surfaces>;
  request(op: "reach", body: ReachQuery): Promise<Reach>;
  request(op: string, body?: unknown): Promise<unknown>;
  follow(take: (state: PlateState) => void, states?: "newest" | "every"): () => void;
  close(): Promise<void>;
}
