"""The circuits as an SVG: nets are lines from left to right, parts stand between theirs.

Only a dot connects: a part's wire that crosses a line without one passes it. So nothing is placed by hand, and what is
drawn is what is simulated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

from netlist import Circuit, Part

COLUMN, ROW, LEFT, TOP = 112, 42, 96, 54
PORT, GROUND = "#0b5394", "#666"
STYLE = "text{font:12px sans-serif}.s{font-size:10px;fill:#444}.h{font-size:16px;font-weight:bold}"


def picture(circuits: Sequence[Circuit]) -> str:
    """Return all circuits, one below the other."""
    body: list[str] = []
    top, width = 10, 0
    for circuit in circuits:
        lines, right, height = _circuit(circuit, top)
        body += lines
        top, width = top + height, max(width, right)
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {top}" width="{width}" height="{top}">'
    return "\n".join(
        [head, f"<style>{STYLE}</style>", f'<rect width="{width}" height="{top}" fill="white"/>', *body, "</svg>\n"]
    )


def _circuit(circuit: Circuit, top: int) -> tuple[list[str], int, int]:
    y = {net: top + TOP + ROW * place for place, net in enumerate(circuit.nets)}
    x = [LEFT + COLUMN // 2 + COLUMN * place for place in range(len(circuit.parts))]
    lines = [_text(12, top + 22, circuit.name, "h")]
    span: dict[str, tuple[int, int]] = {}
    for net, at in y.items():
        on = [place for place, part in zip(x, circuit.parts, strict=True) if net in part.nets]
        is_led_out = net in circuit.ports or net == "0"
        from_box = circuit.parts[x.index(on[0])].pins != ()
        first = LEFT - 10 if is_led_out else on[0]
        span[net] = first, on[-1]
        colour = GROUND if net == "0" else PORT if is_led_out else "black"
        name = "ground" if net == "0" else net
        place = (first - 6, at + 4) if is_led_out else (first + 30, at - 4) if from_box else (first - 8, at - 4)
        anchor = "start" if from_box and not is_led_out else "end"
        lines.append(_line(first, at, on[-1], at, colour))
        lines.append(
            f'<text x="{place[0]}" y="{place[1]}" text-anchor="{anchor}" fill="{colour}">{escape(name)}</text>'
        )
    for place, part in zip(x, circuit.parts, strict=True):
        lines += _box(part, place, y, span) if part.pins else _two_ends(part, place, y)
    return lines, x[-1] + COLUMN, TOP + ROW * len(y) + 14


def _two_ends(part: Part, x: int, y: dict[str, int]) -> Iterator[str]:
    """A part between two nets; its first is drawn where it is, above or below."""
    first, second = (y[net] for net in part.nets)
    middle, sign = min(first, second) + ROW / 2, 1 if second > first else -1
    half = {"R": 13, "C": 3, "D": 7, "V": 0}[part.kind]
    yield _line(x, first, x, middle - sign * half)
    yield _line(x, middle + sign * half, x, second)
    if part.kind == "R":
        yield f'<rect x="{x - 5}" y="{middle - half}" width="10" height="{2 * half}" fill="white" stroke="black"/>'
    elif part.kind == "C":
        yield from (_line(x - 10, middle + end, x + 10, middle + end) for end in (-half, half))
    elif part.kind == "D":
        tail, tip = middle - sign * half, middle + sign * half
        yield f'<path d="M{x - 7} {tail}H{x + 7}L{x} {tip}Z" fill="white" stroke="black"/>'
        yield _line(x - 7, tip, x + 7, tip)
    yield from (_dot(x, y[net]) for net in part.nets)
    yield _text(x + 13, middle, part.name)
    yield _text(x + 13, middle + 12, part.value or part.order, "s")


def _box(part: Part, x: int, y: dict[str, int], span: dict[str, tuple[int, int]]) -> Iterator[str]:
    at = sorted(y[net] for net in part.nets)
    yield (
        f'<rect x="{x - 26}" y="{at[0] - 14}" width="52" height="{at[-1] - at[0] + 28}" '
        f'fill="white" fill-opacity="0.85" stroke="black"/>'
    )
    yield _text(x - 24, at[0] - 18, f"{part.name} {part.value}")
    names: dict[str, list[str]] = {}
    for net, pin in zip(part.nets, part.pins, strict=True):
        names.setdefault(net, []).append(pin)
    for net, pins in names.items():
        yield from (
            _dot(x + side, y[net]) for side, goes_on in ((-26, span[net][0] < x), (26, span[net][1] > x)) if goes_on
        )
        yield _text(x - 19, y[net] + 4, " ".join(filter(None, pins)) or "contact", "s")


def _line(x1: float, y1: float, x2: float, y2: float, colour: str = "black") -> str:
    return f'<path d="M{x1:g} {y1:g}L{x2:g} {y2:g}" stroke="{colour}" fill="none"/>'


def _dot(x: float, y: float) -> str:
    return f'<circle cx="{x:g}" cy="{y:g}" r="3"/>'


def _text(x: float, y: float, text: str, style: str = "") -> str:
    return f'<text x="{x:g}" y="{y:g}"{f" class={chr(34)}{style}{chr(34)}" if style else ""}>{escape(text)}</text>'
