"""Conditions on variants: comparisons and arithmetic on fields of a spec, and nothing else."""

import ast
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, is_dataclass
from typing import Any

from padgen.core.errors import SpecError, shown
from padgen.spec import Spec

__all__ = ["Expression", "parse_expression"]

LONGEST, LONGEST_SHOWN = 1000, 80
"""Characters of a condition, and of what errors repeat of it."""
LARGEST_WHOLE = 2**53
"""Whole numbers beyond are taken as floats, whose arithmetic takes no time and no room."""
OPERATORS: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,  # of floats: 9**9**9 ends in an error at once
    ast.Mod: operator.mod,
    ast.FloorDiv: operator.floordiv,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Not: operator.not_,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}


def _round(value: float, digits: int | None = None) -> float:
    """Round to digits as a float: a whole number would be divided by ten to as many as are asked for."""
    return round(value) if digits is None else round(float(value), digits)


FUNCTIONS: dict[str, Callable[..., Any]] = {"abs": abs, "min": min, "max": max, "round": _round}


@dataclass(frozen=True)
class Expression:
    """A condition: as it was written, and parsed."""

    text: str
    tree: ast.expr

    def holds(self, values: Mapping[str, Any], spec: Spec) -> bool:
        """Whether it holds for a variant with these `values` of dotted fields; all others are those of `spec`.

        Raises
        ------
        SpecError
            It cannot be worked out, as a division by zero.
        """
        try:
            return bool(_evaluated(self.tree, values, spec))
        except (ArithmeticError, LookupError, RecursionError, TypeError, ValueError) as error:
            raise SpecError(f"cannot be worked out for {shown(dict(values))} ({error})", _where(self.text)) from error


def parse_expression(text: str, spec: Spec) -> Expression:
    """Read a condition such as ``pad.width_mm >= 2 * pad.border_mm or resolution < 8``.

    Raises
    ------
    SpecError
        It is no expression, or uses a field that a spec does not have, or anything but comparisons,
        arithmetic, ``and``, ``or``, ``not``, abs, min, max and round.
    """
    where = _where(text)
    if len(text) > LONGEST:
        raise SpecError(f"is no condition of at most {LONGEST} characters, it has {len(text)}; write several", where)
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        _refuse(tree, spec, where)
    except (RecursionError, MemoryError) as error:
        raise SpecError("is nested too deeply", where) from error
    except (SyntaxError, ValueError) as error:
        raise SpecError("is no condition; an example is 'resolution <= 64 and pad.width_mm >= 50'", where) from error
    return Expression(text, tree)


def _where(text: str) -> str:
    return f"constraint {text if len(text) <= LONGEST_SHOWN else text[:LONGEST_SHOWN] + '…'!r}"


def _refuse(node: ast.expr, spec: Spec, where: str) -> None:
    """Raise for what is no condition."""
    name = _dotted(node)
    if name is not None:
        _field(name, spec, where)
        return
    operators = [getattr(node, "op", None), *getattr(node, "ops", ())]
    if any(not isinstance(op, (ast.And, ast.Or)) and type(op) not in OPERATORS for op in operators if op):
        raise SpecError(f"uses {ast.unparse(node)!r}, whose operator is not known here", where)
    if isinstance(node, ast.Constant) and not isinstance(node.value, (int, float, str)):
        raise SpecError(f"uses {shown(node.value)}, which is neither number nor text, true or false", where)
    allowed = (ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.Constant, ast.Call, ast.Subscript)
    if not isinstance(node, allowed):
        raise SpecError(f"uses {ast.unparse(node)!r}, which is none of comparison, arithmetic, and, or, not", where)
    if isinstance(node, ast.Call) and (_dotted(node.func) not in FUNCTIONS or node.keywords):
        raise SpecError(f"calls {ast.unparse(node.func)!r}, known are {', '.join(FUNCTIONS)}", where)
    for child in node.args if isinstance(node, ast.Call) else ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            _refuse(child, spec, where)


def _evaluated(node: ast.expr, values: Mapping[str, Any], spec: Spec) -> Any:
    value = _value(node, values, spec)
    return float(value) if isinstance(value, int) and abs(value) > LARGEST_WHOLE else value


def _value(node: ast.expr, values: Mapping[str, Any], spec: Spec) -> Any:
    name = _dotted(node)
    if name is not None:
        # A table stands for what names it, which the variant's spec knows.
        return values[name] if name in values and not isinstance(values[name], dict) else _field(name, spec, "")
    match node:
        case ast.Constant():
            return node.value
        case ast.BoolOp():
            decide = all if isinstance(node.op, ast.And) else any
            return decide(_evaluated(part, values, spec) for part in node.values)
        case ast.UnaryOp():
            return OPERATORS[type(node.op)](_evaluated(node.operand, values, spec))
        case ast.BinOp():
            left, right = _evaluated(node.left, values, spec), _evaluated(node.right, values, spec)
            if not isinstance(left, (int, float)) or not isinstance(right, (int, float)):
                raise TypeError("arithmetic is of numbers")  # of text it might take all memory
            return OPERATORS[type(node.op)](left, right)
        case ast.Compare():
            parts = [_evaluated(part, values, spec) for part in (node.left, *node.comparators)]
            pairs = zip(node.ops, parts, parts[1:], strict=False)
            return all(OPERATORS[type(op)](left, right) for op, left, right in pairs)
        case ast.Subscript():
            return _evaluated(node.value, values, spec)[_evaluated(node.slice, values, spec)]
        case ast.Call():
            return FUNCTIONS[_dotted(node.func) or ""](*(_evaluated(part, values, spec) for part in node.args))
    raise TypeError(ast.unparse(node))


def _dotted(node: ast.expr) -> str | None:
    """``a.b.c`` as text, None for anything else."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        before = _dotted(node.value)
        return None if before is None else f"{before}.{node.attr}"
    return None


def _field(name: str, spec: Spec, where: str) -> Any:
    value: Any = spec
    for part in name.split("."):
        if not hasattr(type(value), "__dataclass_fields__") or part not in type(value).__dataclass_fields__:
            raise SpecError(f"names {name!r}, which a spec does not have; words stand in quotes", where)
        value = getattr(value, part)
    # A table stands for what names it, as in TOML: material == 'pla', drive == 'tones'.
    for word in ("name", "scheme", "structure"):
        if is_dataclass(value) and hasattr(value, word):
            return getattr(value, word)
    return value
