"""The surfaces in force: layers of content on the plate, and what a finger feels among them.

Ownership and time to live are those of targets. Of the layers at a place the one with the larger z is on top, and of
equals the one that came last. Elsewhere the plate is bare glass: 0 um.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Final, NamedTuple

from hapticd_contract.contents import LevelMap
from hapticd_contract.surfaces import Circle, Surface
from hapticd_contract.targets import ClientTargets

from ..trajectory.gate import GRAIN_NS
from .layer import Layer
from .textures import AmplitudeAt, Textures, finest_mm

MAX_SURFACES: Final = 64  # of all clients
MAX_CORNERS: Final = 256  # of all polygons: 64 rectangles; each is looked at wherever a finger is near
MAX_EXPENSIVE: Final = 16  # of noise, on a path or turning
EXPENSIVE: Final = 5  # each of them takes a finger as long as so many others
MAX_EDGES: Final = 8  # of one layer, and corners of its path, that a finger meets in one frame
NEVER_NS: Final = 2**62
MAX_REFINED: Final = 16  # crossings of all fingers whose instant is refined for one frame: it has room for knots at 11

_POSE: Final = ("position_mm", "angle_rad", "scale", "velocity_mm_s", "turning_rad_s", "t_pose_ns", "path")
Predicted = Callable[[int], tuple[float, float]]  # an instant: where the finger will be
_Span = tuple[float, float, float]  # of a crossing, ns: when it is, and from when to when it is the only one


class Crossing(NamedTuple):
    """A finger's crossing of a layer's edge: about when, in ns from the way's beginning, and from when to when it is
    the only one."""

    at_ns: float
    from_ns: float
    to_ns: float
    layer: Layer
    predicted_mm: Predicted


class PathDetail(NamedTuple):
    """Division of a finger's way: into at least so many pieces, and the edges that it crosses."""

    pieces: float
    crossings: list[Crossing]


class SurfaceSet:
    """All layers, topmost first. Instants are arguments in ns on one monotonic axis."""

    def __init__(self, textures: Textures) -> None:
        self.layers: list[Layer] = []
        self.weight = 0  # layers, of which an expensive one counts as EXPENSIVE
        self.version = 0  # counts changes; a refreshed surface is none
        self.t_expires_ns = NEVER_NS  # the next one does
        self._textures: Final = textures
        self._w_limit_um: Final = textures.w_limit_um
        self._born = 0

    # --- requests of clients ---

    def set_surfaces(self, message: ClientTargets, t_ns: int) -> list[str]:
        """Replace all earlier surfaces of the client. Returns one error message per refused surface."""
        if not message.surfaces and not self.layers:
            return []
        self.expire(t_ns)
        before = {layer.name: layer for layer in self.layers if layer.owner == message.client}
        others = [layer for layer in self.layers if layer.owner != message.client]
        mine: list[Layer] = []
        refusals: list[str] = []
        for surface in message.surfaces:
            name, refusal = surface.name, self._textures.refusal(surface.content)
            if not refusal:
                layer = self._layer(message.client, surface, before.get(name), t_ns)
                refusal = _lack_of_room(others + mine, layer)
            if refusal:
                refusals.append(f"surface {name!r} {refusal}")
            else:
                layer.t_expires_ns = t_ns + message.ttl_ns
                mine.append(layer)
        self._stack(others + mine)
        return refusals

    def release_client(self, client: str) -> None:
        """Remove all surfaces of a client."""
        self._stack([layer for layer in self.layers if layer.owner != client])

    def expire(self, t_ns: int) -> None:
        """Remove what has expired by `t_ns`."""
        if t_ns >= self.t_expires_ns:
            self._stack([layer for layer in self.layers if t_ns < layer.t_expires_ns])

    def make_textures(self) -> None:
        """Make all textures again: the friction curve is another."""
        for layer in self.layers:
            layer.texture = self._texture(layer.surface)

    def layer(self, owner: str, name: str) -> Layer | None:
        """Return a client's layer by its name; None if it has none of that name."""
        for layer in self.layers:
            if layer.name == name and layer.owner == owner:
                return layer
        return None

    # --- reading, for the touch path ---

    def amplitude_um(self, x_mm: float, y_mm: float, t_ns: int) -> float:
        """Return what a finger at a place feels: the topmost content, with what is blended into it."""
        below_um = added_um = least_um = 0.0
        for layer in self.layers:
            layer_um = layer.amplitude_um(x_mm, y_mm, t_ns)
            if layer_um < 0.0:
                continue
            if layer.replaces:
                below_um = layer_um
                break
            if layer.adds:
                added_um += layer_um
            elif added_um + layer_um > least_um:
                least_um = added_um + layer_um
        felt_um = max(below_um + added_um, least_um)
        return felt_um if felt_um < self._w_limit_um else self._w_limit_um

    def along(self, predicted_mm: Predicted, t_ns: int, span_ns: int) -> PathDetail:
        """Return what a finger without a target meets on its way over `span_ns` from `t_ns`."""
        x_mm, y_mm = predicted_mm(t_ns)
        end_x_mm, end_y_mm = predicted_mm(t_ns + span_ns)
        way_mm = math.hypot(end_x_mm - x_mm, end_y_mm - y_mm)
        pieces = 1.0
        crossed: list[Crossing] = []
        for layer in self.layers:
            if layer.is_far(x_mm, y_mm, t_ns, way_mm + layer.speed_mm_s * span_ns * 1e-9):
                continue
            u_mm, v_mm = layer.local_mm(x_mm, y_mm, t_ns)
            end_mm = layer.local_mm(end_x_mm, end_y_mm, t_ns + span_ns)
            turns_ns = layer.turns_ns(t_ns, span_ns, MAX_EDGES)
            is_inside = layer.holds(u_mm, v_mm)
            if layer.is_whole and turns_ns:
                met_mm, met = (way_mm + layer.speed_mm_s * span_ns * 1e-9) / layer.scale, list[_Span]()
            else:
                met_mm, met = meeting(layer, (u_mm, v_mm), end_mm, turns_ns, predicted_mm, t_ns, span_ns)
            if not met and not is_inside:
                continue
            pieces = max(pieces, met_mm / layer.finest_mm)
            for at_ns, from_ns, to_ns in met:
                crossed.append(Crossing(at_ns, from_ns, to_ns, layer, predicted_mm))
            if layer.replaces and is_inside and not met:
                break  # it hides what is below
        return PathDetail(pieces, crossed)

    def edges_ns(self, crossed: list[Crossing], t_ns: int, tolerance_um: float) -> list[int]:
        """Return the instants from `t_ns` on just before and just after the crossings of any fingers where what they
        feel steps, the earliest of them."""
        crossed.sort(key=lambda crossing: crossing.at_ns)
        found_ns = set[int]()
        for _, from_ns, to_ns, layer, predicted_mm in crossed[:MAX_REFINED]:
            before_ns = crossing_ns(layer, predicted_mm, t_ns, from_ns, to_ns)
            if before_ns >= 0 and self._steps(predicted_mm, t_ns + before_ns, tolerance_um):
                found_ns.update((before_ns, before_ns + GRAIN_NS))
        return sorted(found_ns)

    def _steps(self, predicted_mm: Predicted, t_ns: int, tolerance_um: float) -> bool:
        """Whether what the finger feels jumps within a grain of time."""
        x_mm, y_mm = predicted_mm(t_ns)
        after_x_mm, after_y_mm = predicted_mm(t_ns + GRAIN_NS)
        before_um = self.amplitude_um(x_mm, y_mm, t_ns)
        return abs(self.amplitude_um(after_x_mm, after_y_mm, t_ns + GRAIN_NS) - before_um) > tolerance_um

    # --- the stack ---

    def _layer(self, owner: str, surface: Surface, before: Layer | None, t_ns: int) -> Layer:
        """Return the surface's layer; what did not change is kept, so that a refreshed one stays where it is."""
        if before is not None and before.surface == surface:
            return before
        t_pose_ns = t_ns if surface.t_pose_ns is None else surface.t_pose_ns
        if before is not None and surface.t_pose_ns is None and _pose(before.surface) == _pose(surface):
            t_pose_ns = before.t_pose_ns
        born = self._born if before is None else before.born
        self._born += before is None
        piece_mm = finest_mm(surface.content, _size_mm(surface, self._textures.plate_size_mm))
        return Layer(owner, surface, self._texture(surface), piece_mm, born, t_pose_ns)

    def _texture(self, surface: Surface) -> AmplitudeAt:
        return self._textures.amplitude(surface.content, _size_mm(surface, self._textures.plate_size_mm))

    def _stack(self, layers: list[Layer]) -> None:
        stacked = sorted(layers, key=lambda layer: (-layer.z, -layer.born))
        if stacked != self.layers:
            self.version += 1
        self.layers = stacked
        self.weight = sum([EXPENSIVE if layer.is_expensive else 1 for layer in layers])
        self.t_expires_ns = min((layer.t_expires_ns for layer in layers), default=NEVER_NS)


def _lack_of_room(others: list[Layer], layer: Layer) -> str:
    """Return why there is no room for another layer; empty if there is."""
    if len(others) >= MAX_SURFACES:
        return f"is one too many: the plate has at most {MAX_SURFACES} surfaces."
    if layer.corners > (corners := MAX_CORNERS - sum([other.corners for other in others])):
        return f"has too many corners: {corners} are left of the plate's {MAX_CORNERS}."
    if layer.is_expensive and sum([other.is_expensive for other in others]) >= MAX_EXPENSIVE:
        return f"is one too many: at most {MAX_EXPENSIVE} surfaces of the plate are noise, turn or follow a path."
    return ""


def _pose(surface: Surface) -> list[object]:
    return [getattr(surface, name) for name in _POSE]


def _size_mm(surface: Surface, plate_size_mm: tuple[float, float]) -> tuple[float, float]:
    """Return over which box around the layer's origin content is spread: the least that holds the shape."""
    shape = surface.shape
    if shape is None or not isinstance(surface.content, LevelMap):
        return plate_size_mm
    if isinstance(shape, Circle):
        return 2.0 * shape.radius_mm, 2.0 * shape.radius_mm
    half_x_mm = max([abs(x_mm) for x_mm, _ in shape.corners_mm])
    half_y_mm = max([abs(y_mm) for _, y_mm in shape.corners_mm])
    return 2.0 * half_x_mm, 2.0 * half_y_mm


def meeting(
    layer: Layer,
    start_mm: tuple[float, float],
    end_mm: tuple[float, float],
    turns_ns: list[int],
    predicted_mm: Predicted,
    t_ns: int,
    span_ns: int,
) -> tuple[float, list[_Span]]:
    """Return how far a finger goes in a layer's frame, straight from turn to turn of its path, and the crossings.

    Each crossing is an instant in ns from `t_ns`, and the two between which it is the only one.
    """
    from_ns, (u_mm, v_mm), way_mm = 0, start_mm, 0.0
    met: list[_Span] = []
    for to_ns in (*turns_ns, span_ns):
        to_u_mm, to_v_mm = end_mm
        if to_ns != span_ns:
            x_mm, y_mm = predicted_mm(t_ns + to_ns)
            to_u_mm, to_v_mm = layer.local_mm(x_mm, y_mm, t_ns + to_ns)
        leg_ns, shares = to_ns - from_ns, layer.crossings(u_mm, v_mm, to_u_mm, to_v_mm)
        for share, from_share, to_share in _spans(shares) if shares else ():
            met.append((from_ns + share * leg_ns, from_ns + from_share * leg_ns, from_ns + to_share * leg_ns))
        way_mm += math.hypot(to_u_mm - u_mm, to_v_mm - v_mm)
        from_ns, u_mm, v_mm = to_ns, to_u_mm, to_v_mm
    return way_mm, met


def _spans(shares: list[float]) -> list[tuple[float, float, float]]:
    """Return each crossing with the shares from .. to between which it is the only one."""
    ends = [0.0, *[0.5 * (before + after) for before, after in pairwise(shares)], 1.0]
    return [(share, ends[index], ends[index + 1]) for index, share in enumerate(shares)]


def crossing_ns(layer: Layer, predicted_mm: Predicted, t_ns: int, from_ns: float, to_ns: float) -> int:
    """Return the last grain of time before the finger crosses a layer's edge; -1 if it does not."""
    first, last = int(from_ns) // GRAIN_NS, int(to_ns) // GRAIN_NS
    was_inside = _is_inside(layer, predicted_mm, t_ns + first * GRAIN_NS)
    if _is_inside(layer, predicted_mm, t_ns + last * GRAIN_NS) == was_inside:
        return -1
    while last - first > 1:
        middle = (first + last) // 2
        if _is_inside(layer, predicted_mm, t_ns + middle * GRAIN_NS) == was_inside:
            first = middle
        else:
            last = middle
    return first * GRAIN_NS


def _is_inside(layer: Layer, predicted_mm: Predicted, t_ns: int) -> bool:
    x_mm, y_mm = predicted_mm(t_ns)
    return layer.covers(x_mm, y_mm, t_ns)
