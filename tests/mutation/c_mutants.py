"""Mutants of C functions, by their text: one comparison, bound, sign, connective or choice changed at a time."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from mutation.python_mutants import Mutant

OPERATORS = {
    "<=": ["<", ">"],
    ">=": [">", "<"],
    "<": ["<=", ">="],
    ">": [">=", "<="],
    "==": ["!="],
    "!=": ["=="],
    "&&": ["||"],
    "||": ["&&"],
    "!": [""],
    "++": ["--"],
    "+": ["-"],
    "-": ["+"],
    "*": ["/"],
    "/": ["*"],
}
WORDS = {
    "fminf": ["fmaxf"],
    "fmaxf": ["fminf"],
    "true": ["false"],
    "false": ["true"],
    "d": ["q"],
    "q": ["d"],
    "HD_LIMIT_UNTOUCHED": ["HD_LIMIT_SCALED"],
    "HD_LIMIT_SCALED": ["HD_LIMIT_UNTOUCHED"],
    "HD_LIMIT_NOT_FINITE": ["HD_LIMIT_UNTOUCHED"],
}
TOKEN = re.compile(
    r"(?P<float>0x1p-?\d+f|\d+(?:\.\d*)?(?:e-?\d+)?f)|(?P<int>\b\d+\b)|(?P<word>\b\w+\b)"
    r"|(?P<space>/\*.*?\*/|->)|(?P<operator><=|>=|==|!=|&&|\|\||\+\+|[<>!+\-*/])",
    re.DOTALL,
)


def mutants(source: str, functions: Sequence[str]) -> Iterator[Mutant]:
    """Every mutant of the bodies of `functions`, and of the `#define`d numbers, in the order of the text."""
    for start, end in sorted([_body(source, name) for name in functions] + _defines(source)):
        for token in TOKEN.finditer(source, start, end):
            for other in _others(token):
                changed = source[: token.start()] + other + source[token.end() :]
                line = source.count("\n", 0, token.start()) + 1
                text = source.splitlines()[line - 1].split("/*")[0].strip()
                column = token.start() - source.rfind("\n", 0, token.start()) - 1
                yield Mutant(text, f"@{column} {token.group()} -> {other or 'nothing'}", changed)


def _body(source: str, name: str) -> tuple[int, int]:
    """From the opening brace of a function at column 0 to its closing one."""
    head = re.search(rf"^[\w ]*\b{name}\([^;{{]*\)\n\{{", source, re.MULTILINE)
    assert head is not None, f"{name} is not defined there"
    return head.end() - 1, source.index("\n}", head.end())


def _defines(source: str) -> list[tuple[int, int]]:
    found = re.finditer(r"^#define \w+ (.*?)(?:/\*.*)?$", source, re.MULTILINE)
    return [found_one.span(1) for found_one in found if re.search(r"\d", found_one.group(1))]


def _others(token: re.Match[str]) -> list[str]:
    text = token.group()
    match token.lastgroup:
        case "float":
            value = float.fromhex(text[:-1]) if text.startswith("0x") else float(text[:-1])
            return [_single(one) for one in _neighbours(value)] + [f"(-{text})" if value else "1.0f"]
        case "int":
            return [str(int(text) + step) if int(text) + step >= 0 else "(-1)" for step in (-1, 1)]
        case "operator":
            return OPERATORS[text]
        case _:
            return WORDS.get(text, [])


def _neighbours(value: float) -> tuple[np.float32, np.float32]:
    single = np.float32(value)
    return np.nextafter(single, np.float32(-np.inf)), np.nextafter(single, np.float32(np.inf))


def _single(value: np.float32) -> str:
    return f"({float(value).hex()}f)"
