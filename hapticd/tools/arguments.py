"""Command-line arguments: a parser whose errors name what was typed, and numbers with bounds.

A wrong value is refused while the arguments are read, before any work, with the option's own name.
"""

from __future__ import annotations

import argparse
import difflib
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from ..errors import UsageError


class Parser(argparse.ArgumentParser):
    """An `ArgumentParser` that reports unknown words as the command's own, with its usage and the nearest valid word.

    A value that an argument refuses raises UsageError in place of the usage. The types `int` and `float` take whole
    numbers and finite ones.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.register("type", int, lambda text: int(_converted(int, text, "a whole number")))
        self.register("type", float, _finite)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        """Parse; unknown words are an error here, where argparse lets the parent command report them."""
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self._refuse(unknown[0])
        return found, []

    def _refuse(self, word: str) -> NoReturn:
        named = word.partition("=")[0]
        hint = suggestion(named, self._option_string_actions) if word.startswith("-") else ""
        self.error(f"unknown argument {word}{hint or f'; see `{self.prog} --help`'}")

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        try:
            return super()._get_value(action, arg_string)
        except argparse.ArgumentError as error:
            raise UsageError(f"{_name(action)}: {error.message}.") from None

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            choices = [str(choice) for choice in action.choices]
            hint = suggestion(str(value), choices) or f": choose from {', '.join(choices)}"
            raise UsageError(f"{_name(action)}: there is no {value!r}{hint}")


def add_command(commands: Any, name: str, summary: str, example: str, description: str = "") -> argparse.ArgumentParser:
    """Add a command to the `add_subparsers` of another, with an example of its arguments; return its parser."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=description or f"{summary[0].upper()}{summary[1:]}.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.epilog = f"example: {parser.prog} {example}".rstrip()
    return parser


def add_endpoint(parser: argparse.ArgumentParser, **options: Any) -> None:
    """Add --endpoint; `options` as `add_argument`."""
    parser.add_argument("--endpoint", metavar="DIR", help="the service's runtime directory (default: found)", **options)


def runtime_directory(text: str) -> str:
    """The type of an --endpoint that must be a directory of this computer."""
    if not Path(text.removeprefix("ipc://")).is_dir():
        raise argparse.ArgumentTypeError(f"{text} is not a directory: give the service's runtime directory")
    return text


def suggestion(word: str, valid: Iterable[str]) -> str:
    """Return the end of a sentence about an unknown word: the nearest valid one, if any is near."""
    close = difflib.get_close_matches(word, list(valid), n=1, cutoff=0.6)
    return f": did you mean {close[0]}?" if close else ""


def number(low: float, high: float = math.inf, *, is_above: bool = False) -> Callable[[str], float]:
    """Return the type of an argument that is a finite number from `low`, or with `is_above` above it, to `high`."""

    def parsed(text: str) -> float:
        return float(_bounded(_converted(float, text, "a number"), low, high, is_above=is_above))

    return parsed


POSITIVE = number(0.0, is_above=True)  # the type of an argument that is a finite number above 0


def whole(low: int, high: float = math.inf) -> Callable[[str], int]:
    """Return the type of an argument that is a whole number from `low` to `high`."""

    def parsed(text: str) -> int:
        return int(_bounded(_converted(int, text, "a whole number"), low, high, is_above=False))

    return parsed


def numbers(low: float, high: float, count: int = 0) -> Callable[[str], tuple[float, ...]]:
    """Return the type of an argument of finite numbers from `low` to `high` with commas between, `count` or any."""

    def parsed(text: str) -> tuple[float, ...]:
        parts = text.split(",")
        if count not in (0, len(parts)):
            raise argparse.ArgumentTypeError(f"{text!r} is not {count} numbers with commas between")
        return tuple(map(number(low, high), parts))

    return parsed


PORT_NUMBER = whole(0, 65535)  # the type of an argument that is a port; 0 is any free one


def _finite(text: str) -> float:
    value = _converted(float, text, "a number")
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a finite number")
    return value


def _converted(kind: Callable[[str], float], text: str, what: str) -> float:
    try:
        return kind(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not {what}") from None


def _bounded(value: float, low: float, high: float, *, is_above: bool) -> float:
    if math.isfinite(value) and low <= value <= high and not (is_above and value == low):
        return value
    if math.isinf(high):
        bounds = f"above {low:g}" if is_above else f"at least {low:g}"
    else:
        bounds = f"above {low:g} and at most {high:g}" if is_above else f"{low:g} .. {high:g}"
    raise argparse.ArgumentTypeError(f"{value:g} is out of bounds, it must be {bounds}")


def _name(action: argparse.Action) -> str:
    names: Sequence[str] = action.option_strings
    return names[-1] if names else str(action.metavar or action.dest)
