"""Plain code: what no rule of the linter holds, counted over all modules, with the few that are left."""

import ast
from functools import cache
from pathlib import Path

import pytest

MODULES = sorted((Path(__file__).parents[2] / "padgen").rglob("*.py"))
EMPTY_NAMES = {"own", "told", "found"}


@cache
def nodes(path: Path) -> list[ast.AST]:
    """Return all nodes of a module's syntax tree."""
    return list(ast.walk(ast.parse(path.read_text())))


def is_packed(node: ast.AST) -> bool:
    """Return whether values are packed on one line, as ``a, b = x, y`` does; pairs such as x and y may stay."""
    return (
        isinstance(node, ast.Assign)
        and isinstance(node.value, ast.Tuple)
        and any(isinstance(target, ast.Tuple) for target in node.targets)
    )


def is_chained(node: ast.AST) -> bool:
    """Return whether a conditional expression is in another: ``a if p else b if q else c``."""
    return isinstance(node, ast.IfExp) and any(isinstance(part, ast.IfExp) for part in (node.body, node.orelse))


def is_text_times_condition(node: ast.AST) -> bool:
    """Return whether a text is left out by a product, ``" more" * (n > 1)``; ``"-" * width`` is no such thing."""
    if not isinstance(node, ast.BinOp) or not isinstance(node.op, ast.Mult):
        return False
    text = isinstance(node.left, ast.JoinedStr) or (
        isinstance(node.left, ast.Constant) and isinstance(node.left.value, str)
    )
    asks = isinstance(node.right, (ast.Compare, ast.BoolOp)) or (
        isinstance(node.right, ast.Call) and isinstance(node.right.func, ast.Name) and node.right.func.id == "bool"
    )
    return text and asks


COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)


def depth(node: ast.AST) -> int:
    """Return how many comprehensions are within each other in an expression, itself counted."""
    inner = max((depth(child) for child in ast.iter_child_nodes(node)), default=0)
    return inner + isinstance(node, COMPREHENSIONS)


def is_three_deep(node: ast.AST) -> bool:
    """Return whether a comprehension holds others that are two deep."""
    return isinstance(node, COMPREHENSIONS) and depth(node) > 2


KINDS = [(is_packed, 31), (is_chained, 0), (is_text_times_condition, 0), (is_three_deep, 0)]


@pytest.mark.parametrize(("kind", "most"), KINDS)
def test_code_says_one_thing_a_line(kind, most):
    """The number only sinks: a new one is unpacked, or an old one goes."""
    found = [f"{path.name}:{node.lineno}" for path in MODULES for node in nodes(path) if kind(node)]
    assert len(found) <= most, found


def test_locals_say_what_they_hold():
    """``own``, ``told`` and ``found`` say nothing of their values, and stood in 350 functions."""
    empty = [
        f"{path.name}:{node.lineno}"
        for path in MODULES
        for node in nodes(path)
        if (isinstance(node, ast.arg) and node.arg in EMPTY_NAMES)
        or (isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in EMPTY_NAMES)
    ]
    assert not empty


def test_no_two_classes_have_one_name():
    """So that a name in a sentence, a signature or a search means one thing."""
    named: dict[str, list[str]] = {}
    for path in MODULES:
        for node in nodes(path):
            if isinstance(node, ast.ClassDef):
                named.setdefault(node.name, []).append(path.name)
    assert {name: files for name, files in named.items() if len(files) > 1} == {}
