"""Mutants of a Python module: one comparison, bound, sign, connective or choice changed at a time.

Only what runs is mutated: annotations and docstrings are left alone.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

COMPARISONS: dict[type[ast.cmpop], list[type[ast.cmpop]]] = {
    ast.Lt: [ast.LtE, ast.GtE],
    ast.LtE: [ast.Lt, ast.Gt],
    ast.Gt: [ast.GtE, ast.LtE],
    ast.GtE: [ast.Gt, ast.Lt],
    ast.Eq: [ast.NotEq],
    ast.NotEq: [ast.Eq],
    ast.Is: [ast.IsNot],
    ast.IsNot: [ast.Is],
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
}
NAMES = {"min": "max", "max": "min", "all": "any", "any": "all"}
ATTRIBUTES = {"real": "imag", "imag": "real"}


class Mutant(NamedTuple):
    """A changed source: the line's text, what for what, and the whole."""

    text: str
    change: str
    source: str


def mutants(source: str) -> Iterator[Mutant]:
    """Every mutant of `source`, in the order of its nodes."""
    places = list(_mutated(ast.parse(source)))
    for place in range(len(places)):
        for choice in range(len(_changes(places[place]))):
            tree = ast.parse(source)
            node = list(_mutated(tree))[place]
            before = _text(node)
            _changes(node)[choice]()
            ast.fix_missing_locations(tree)
            yield Mutant(
                source.splitlines()[node.lineno - 1].split("#")[0].strip(),
                f"{before} -> {_text(node)}",
                ast.unparse(tree),
            )


Node = ast.expr | ast.stmt


def _mutated(tree: ast.Module) -> Iterator[Node]:
    """The nodes that run, in order."""
    left_alone: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.arg, ast.AnnAssign)):
            for annotation in (getattr(node, "returns", None), getattr(node, "annotation", None)):
                if annotation is not None:
                    left_alone.update(map(id, ast.walk(annotation)))
    for node in ast.walk(tree):
        if isinstance(node, (ast.expr, ast.stmt)) and id(node) not in left_alone:
            yield node


def _changes(node: Node) -> list[Callable[[], None]]:
    """What can be done to one node, each a function that does it in place."""
    match node:
        case ast.Compare(ops=ops):
            return [
                _put_at(ops, place, other()) for place, op in enumerate(ops) for other in COMPARISONS.get(type(op), [])
            ]
        case ast.BoolOp(op=op):
            return [_put(node, "op", ast.Or() if isinstance(op, ast.And) else ast.And())]
        case ast.BinOp(op=op) if type(op) in ARITHMETIC:
            return [_put(node, "op", ARITHMETIC[type(op)]())]
        case ast.AugAssign(op=op) if type(op) in ARITHMETIC:
            return [_put(node, "op", ARITHMETIC[type(op)]())]
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            return [_put(node, "op", ast.UAdd())]  # `+True` is as true as True: a dropped `not`
        case ast.IfExp(test=test) | ast.If(test=test) if not isinstance(test, ast.Constant):
            return [_put(node, "test", ast.Constant(value)) for value in (True, False)]
        case ast.Name(id=name) if name in NAMES:
            return [_put(node, "id", NAMES[name])]
        case ast.Attribute(attr=name) if name in ATTRIBUTES:
            return [_put(node, "attr", ATTRIBUTES[name])]
        case ast.Constant(value=value) if type(value) is int:
            return [_put(node, "value", other) for other in (value - 1, value + 1)]
        case ast.Constant(value=value) if type(value) is float:
            others = (math.nextafter(value, -math.inf), math.nextafter(value, math.inf), -value if value else 1.0)
            return [_put(node, "value", other) for other in others]
        case _:
            return []


def _text(node: Node) -> str:
    return ast.unparse(node.test if isinstance(node, ast.If) else node)


def _put(node: ast.AST, name: str, value: object) -> Callable[[], None]:
    return lambda: setattr(node, name, value)


def _put_at(items: list[ast.cmpop], place: int, value: ast.cmpop) -> Callable[[], None]:
    return lambda: items.__setitem__(place, value)
