"""Read a sweep (a base spec, and the values that its fields take) from TOML, and list the resulting variants.

They are all combinations, or a seeded sample that fills the space evenly. A sample is drawn by `scipy.stats.qmc`: Latin
hypercube (McKay 1979), or Sobol's sequence with Owen's scrambling. Variants are numbered before constraints take some
away, so that a changed constraint does not rename the others. Constraints are comparisons and arithmetic on fields of a
spec, and nothing else."""

import ast
import math
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from itertools import chain, pairwise, product
from math import ceil, floor, prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import FileError, PadgenError, SpecError, number, shown
from padgen.core.files import reason
from padgen.core.registry import PAD_FORMATS, USUAL_FORMATS, names_in
from padgen.spec import Spec, find_spec, make_spec
from padgen.spec.fields import build, checked, choice, flag, folder_name, optional_type, quantity, text, unknown_name
from padgen.spec.load import CATALOGUES, as_table, catalogue, laid_over, parse_toml, read_table, read_toml

__all__ = [
    "METHODS",
    "STAGES",
    "Axis",
    "Expression",
    "PointSample",
    "Sweep",
    "Variant",
    "VariantLimits",
    "count_points",
    "load_sweep",
    "parse_expression",
    "parse_sweep",
    "sweep_over",
    "variant_table",
    "variants",
]

LONGEST = 1000
LONGEST_SHOWN = 80
"""Characters of a condition, and of what errors repeat of it."""
NAMES = (ast.Name, ast.Attribute)
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


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": abs,
    "min": min,
    "max": max,
    # To digits as a float: a whole number would be divided by ten to as many as are asked for.
    "round": lambda value, digits=None: round(value) if digits is None else round(float(value), digits),
}


@dataclass(frozen=True)
class Expression:
    """A condition on fields of a spec, parsed; `where` names it in errors."""

    where: str
    tree: ast.expr

    def holds(self, values: Mapping[str, Any], spec: Spec) -> bool:
        """Tell whether the condition holds for a variant: varied fields come from `values`, all others from `spec`.

        Raises
        ------
        SpecError
            It cannot be worked out, as a division by zero.
        """
        try:
            return bool(_value(self.tree, values, spec))
        except (ArithmeticError, LookupError, RecursionError, TypeError, ValueError) as error:
            raise SpecError(f"cannot be worked out for {shown(dict(values))} ({error})", self.where) from error


def parse_expression(text: str, spec: Spec) -> Expression:
    """Read a condition such as ``pad.width_mm >= 2 * pad.border_mm or resolution < 8``.

    Raises
    ------
    SpecError
        It is no expression, or uses a field that a spec does not have, or anything but comparisons,
        arithmetic, ``and``, ``or``, ``not``, abs, min, max and round.
    """
    where = f"constraint {text if len(text) <= LONGEST_SHOWN else text[:LONGEST_SHOWN] + '…'!r}"
    if len(text) > LONGEST:
        raise SpecError(f"has {len(text)} characters, a condition may have {LONGEST}: write several conditions", where)
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        _refuse(tree, spec, where)
    except (RecursionError, MemoryError) as error:
        raise SpecError("is nested too deeply", where) from error
    except (SyntaxError, ValueError) as error:
        raise SpecError("is no condition; an example is 'resolution <= 64 and pad.width_mm >= 50'", where) from error
    return Expression(where, tree)


def _refuse(node: ast.expr, spec: Spec, where: str) -> None:
    """Raise `SpecError` if a condition has more than fields, constants, comparisons, arithmetic, logic, known calls."""
    if isinstance(node, NAMES):
        _field(ast.unparse(node), spec, where)
        return
    operators = [getattr(node, "op", None), *getattr(node, "ops", ())]
    if any(not isinstance(op, (ast.And, ast.Or)) and type(op) not in OPERATORS for op in operators if op):
        raise SpecError(f"uses {ast.unparse(node)!r}, whose operator is not known here", where)
    if isinstance(node, ast.Constant) and not isinstance(node.value, (int, float, str)):
        raise SpecError(f"uses {shown(node.value)}, which is neither number nor text, true or false", where)
    if not isinstance(node, (ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.Constant, ast.Call, ast.Subscript)):
        raise SpecError(f"uses {ast.unparse(node)!r}, which is none of comparison, arithmetic, and, or, not", where)
    if isinstance(node, ast.Call) and (ast.unparse(node.func) not in FUNCTIONS or node.keywords):
        raise SpecError(f"calls {ast.unparse(node.func)!r}, known are {', '.join(FUNCTIONS)}", where)
    for child in node.args if isinstance(node, ast.Call) else ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            _refuse(child, spec, where)


def _value(node: ast.expr, values: Mapping[str, Any], spec: Spec) -> Any:
    """Evaluate a condition's syntax tree for a variant: varied fields from `values`, other fields from `spec`."""

    def of(part: ast.expr) -> Any:
        return _value(part, values, spec)

    match node:
        case ast.Name() | ast.Attribute():
            name = ast.unparse(node)
            # A table stands for what names it, which the variant's spec knows.
            value = values[name] if name in values and not isinstance(values[name], dict) else _field(name, spec, "")
        case ast.Constant():
            value = node.value
        case ast.BoolOp():
            value = (all if isinstance(node.op, ast.And) else any)(map(of, node.values))
        case ast.UnaryOp():
            value = OPERATORS[type(node.op)](of(node.operand))
        case ast.BinOp():
            pair = of(node.left), of(node.right)
            if not all(isinstance(side, (int, float)) for side in pair):
                raise TypeError("arithmetic is of numbers")  # of text it might take all memory
            value = OPERATORS[type(node.op)](*pair)
        case ast.Compare():
            pairs = zip(node.ops, pairwise(map(of, (node.left, *node.comparators))), strict=True)
            value = all(OPERATORS[type(op)](left, right) for op, (left, right) in pairs)
        case ast.Subscript():
            value = of(node.value)[of(node.slice)]
        case ast.Call():
            value = FUNCTIONS[ast.unparse(node.func)](*map(of, node.args))
    return float(value) if isinstance(value, int) and abs(value) > LARGEST_WHOLE else value


def _field(name: str, spec: Spec, where: str) -> Any:
    value: Any = spec
    for part in name.split("."):
        if part not in getattr(type(value), "__dataclass_fields__", ()):
            raise SpecError(f"names {name!r}, which a spec does not have; words stand in quotes", where)
        value = getattr(value, part)
    # A table stands for what names it, as in TOML: material == 'pla', drive == 'tones'.
    words = [word for word in ("name", "scheme", "structure") if is_dataclass(value) and hasattr(value, word)]
    return getattr(value, words[0]) if words else value


STAGES = ("plan", "yield", "build", "study")
METHODS = ("grid", "latin-hypercube", "sobol")
SCALES = ("linear", "log")
MOST_VALUES = 10_000
MOST_AT_ONCE = 100_000
LARGEST = 1e15
"""Above any bound of a field, and small enough that arithmetic on it stays finite."""
DEEPEST = 4
"""Lists and tables within one another that a value may be."""


@dataclass(frozen=True, slots=True)
class Range:
    """A range of a field's values from `low` to `high`; a grid takes `steps` of them, both ends included."""

    low: float = quantity(unit="1", low=-LARGEST, high=LARGEST, doc="of a range")
    high: float = quantity(unit="1", low=-LARGEST, high=LARGEST, doc="of a range")
    steps: int = quantity(0, unit="1", low=0, high=MOST_VALUES, doc="of a grid")
    scale: str = choice("linear", of=SCALES, doc="equal differences or equal ratios")


@dataclass(frozen=True, slots=True)
class Axis:
    """Fields that are varied together, by their dotted names in a spec.

    Either `values` (k, fields), or, of a sample, a `range` of one field; `whole`: it takes whole numbers only.
    """

    fields: tuple[str, ...]
    values: tuple[tuple[Any, ...], ...] = ()
    range: Range | None = None
    whole: bool = False

    def at(self, share: float, even: bool = False) -> tuple[Any, ...]:
        """Return the fields' values at `share` (0 … 1) along the axis; `even` makes whole numbers equally likely."""
        if self.range is None:
            return self.values[min(int(share * len(self.values)), len(self.values) - 1)]
        low, high = self.range.low, self.range.high
        if even and self.whole and self.range.scale == "linear":
            return (min(int(low + share * (high - low + 1)), int(high)),)
        value = low * (high / low) ** share if self.range.scale == "log" else low + (high - low) * share
        return (round(value) if self.whole else float(f"{value:.12g}"),)


@dataclass(frozen=True, slots=True)
class PointSample:
    """Choice of points from the axes: all combinations, or a seeded sample of them."""

    method: str = choice("grid", of=METHODS, doc="grid: all combinations; the others: `count` points, seeded")
    count: int = quantity(0, unit="variants", low=0, high=10_000_000, doc="of a sample")
    seed: int = quantity(0, unit="1", low=0, high=2**32 - 1, doc="of a sample; the same seed, the same points")


@dataclass(frozen=True, slots=True)
class VariantLimits:
    """Limits on run time in s and memory in MB of one variant, beyond which it is stopped and counted as failed."""

    time_s: float = quantity(600.0, unit="s", low=0.1, high=1e6, doc="run time of one variant")
    memory_mb: float = quantity(4000.0, unit="MB", low=100, high=1e7, doc="memory of a worker")


@dataclass(frozen=True, slots=True)
class Settings:
    """Fields at the top level of a sweep's TOML, outside its tables."""

    name: str = folder_name(doc="name of the sweep and of its folder", most=72)
    base: str = text(doc="a spec's file (beside the sweep's) or the name of a template")
    stage: str = choice("plan", of=STAGES, doc="how far each variant is made")
    formats: str = text(",".join(USUAL_FORMATS), doc="of a build, as `padgen build` has them")
    pads: int = quantity(10_000, unit="pads", low=1, high=10_000_000, doc="printed in the computer for the yield")
    folders: bool = flag(True, doc="whether each variant gets a folder of its own; the index has its figures anyway")


@dataclass(frozen=True)
class Sweep:
    """A sweep as read: the base spec (`base` as a table, `spec` checked), varied fields, constraints and limits."""

    settings: Settings
    base: dict[str, Any]
    spec: Spec
    folder: Path
    axes: tuple[Axis, ...]
    constraints: tuple[Expression, ...]
    sample: PointSample = field(default_factory=PointSample)
    limits: VariantLimits = field(default_factory=VariantLimits)

    def name_of(self, number: int) -> str:
        """Return the name of a variant and of its folder."""
        return f"{self.settings.name}-{number:05d}"


TOP_KEYS, RANGE_KEYS = ([f.name for f in fields(kind)] for kind in (Settings, Range))
TABLE_KEYS = ("axes", "sample", "limits")
LIST_KEYS = ("linked", "constraints")
"""Keys of a sweep besides its settings: those that hold a table, and those that hold a list."""


def load_sweep(path: str) -> Sweep:
    """Read a `Sweep` from a file.

    Raises
    ------
    FileError, SpecError
        It cannot be read, or a field of it or of its base is unknown, missing or out of bounds.
    """
    return _sweep(read_toml(Path(path), path or "SWEEP"), Path(path).parent, path)


def parse_sweep(content: str, folder: Path = Path()) -> Sweep:
    """Make a `Sweep` from TOML text; the files that it names lie in `folder`."""
    return _sweep(parse_toml(content, "sweep"), folder, "sweep")


def sweep_over(spec: Spec, axes: dict[str, Any], stage: str = "plan") -> Sweep:
    """Make the `Sweep` of all combinations of fields' values in `axes`, a table like ``[axes]`` of a sweep's TOML.

    Raises
    ------
    SpecError
        A field is unknown, or holds no list of values that it may take.
    """
    table = {"name": spec.name[:72], "base": spec.name, "stage": stage, "folders": stage in ("build", "study")}
    return _sweep(table | {"axes": _plain_lists(axes)}, Path(), "sweep", as_table(spec))


def _plain_lists(axes: Any) -> Any:
    """Turn the tuples, ranges or arrays that a program gives into lists."""
    if isinstance(axes, dict):
        return {name: _plain_lists(values) for name, values in axes.items()}
    if hasattr(axes, "tolist"):
        return axes.tolist()
    return [_plain_lists(value) for value in axes] if isinstance(axes, (list, tuple, range)) else axes


def _sweep(table: dict[str, Any], folder: Path, where: str, base: dict[str, Any] | None = None) -> Sweep:
    try:
        axes, sample_table, limits = (table.pop(key, {}) for key in TABLE_KEYS)
        linked, constraints = (table.pop(key, []) for key in LIST_KEYS)
        formats = table.get("formats")
        if isinstance(formats, list) and all(isinstance(entry, str) for entry in formats):
            table["formats"] = ",".join(formats)
        for key in table:
            if key not in TOP_KEYS:
                raise unknown_name(key, [*TOP_KEYS, *TABLE_KEYS, *LIST_KEYS], "key", "sweep")
        settings: Settings = build(Settings, table, "")
        if base is None:
            name = settings.base
            beside = folder / name
            try:
                path = beside if beside.is_file() else find_spec(name)
            except OSError as error:
                raise FileError(f"cannot be read ({reason(error)})", f"base {name!r}") from error
            base = read_table(path, name)
            folder = path.parent
        try:
            spec = make_spec(base, folder)
        except SpecError as error:
            raise SpecError(f"is no spec by itself: {error}", f"base {settings.base!r}") from error
        sample = _checked_sample(sample_table)
        read_axes = _axes(axes, linked, sample)
        if not isinstance(constraints, list) or not all(isinstance(entry, str) for entry in constraints):
            raise SpecError(f"must be a list of conditions as text, got {shown(constraints)}", "constraints")
        names_in(settings.formats, PAD_FORMATS.names(), "formats")
        conditions = tuple(parse_expression(entry, spec) for entry in constraints)
        return Sweep(
            settings,
            base,
            spec,
            folder.absolute(),
            read_axes,
            conditions,
            sample,
            build(VariantLimits, limits, "limits"),
        )
    except RecursionError as error:
        raise SpecError("cannot be read: its values are nested too deeply", where) from error


def _checked_sample(table: Any) -> PointSample:
    sample: PointSample = build(PointSample, table, "sample")
    if sample.method != "grid" and not sample.count:
        raise SpecError(f"must be at least 1 for method {sample.method!r}", "sample.count")
    if sample.method == "grid" and sample.count:
        raise SpecError("needs a method: latin-hypercube or sobol; a grid has as many as its axes make", "sample.count")
    if sample.method == "latin-hypercube" and sample.count > MOST_AT_ONCE:
        raise SpecError(
            f"must be at most {MOST_AT_ONCE} for a Latin hypercube, which is drawn as a whole, got {sample.count};"
            " sobol goes further",
            "sample.count",
        )
    return sample


def _axes(table: Any, linked: Any, sample: PointSample) -> tuple[Axis, ...]:
    if not isinstance(table, dict) or not isinstance(linked, list):
        raise SpecError("must be a table of fields ([axes]), and [[linked]] tables", "axes")
    axes = [_axis(name, value, sample) for name, value in _flat(table)]
    for entry in linked:
        pairs = _flat(entry) if isinstance(entry, dict) else []
        if not pairs:
            raise SpecError("must be a table of fields with lists of one length", "linked")
        first, wanted = pairs[0]
        for name, values in pairs:
            _checked_values(name, values, f"linked.{name}")
            if len(values) != len(wanted):
                sentence = f"must have {len(wanted)} values as {first} has, got {len(values)}"
                raise SpecError(sentence, f"linked.{name}")
        axes.append(Axis(tuple(name for name, _ in pairs), tuple(zip(*(values for _, values in pairs), strict=True))))
    names = [name for axis in axes for name in axis.fields]
    for name in names:
        if names.count(name) > 1:
            raise SpecError("is varied twice", f"axes.{name}")
    if not axes:
        raise SpecError("is missing; it names the fields that are varied, and their values", "axes")
    return tuple(axes)


def _flat(table: dict[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Return the fields of nested tables as pairs of dotted name, such as ``pad.width_mm``, and value."""
    pairs = []
    for key, value in table.items():
        if not isinstance(value, dict) or set(value) & set(RANGE_KEYS):
            pairs.append((prefix + key, value))
        elif value:
            pairs += _flat(value, f"{prefix}{key}.")
        else:
            raise SpecError("is empty; it would name fields, and their values", f"axes.{prefix}{key}")
    return pairs


def _axis(name: str, value: Any, sample: PointSample) -> Axis:
    where = f"axes.{name}"
    item = _spec_field(name)
    if isinstance(value, list):
        return Axis((name,), tuple((entry,) for entry in _checked_values(name, value, where)))
    if not isinstance(value, dict):
        raise SpecError(f"must be a list of values or a range {{low, high, steps}}, got {shown(value)}", where)
    kind = optional_type(item.type)[0]
    if kind not in (int, float):
        raise SpecError("is no number, so that it has no range; give a list of values", where)
    span: Range = build(Range, value, where)
    low = span.low
    high = span.high
    steps = span.steps
    if not low < high:
        raise SpecError(f"must be above low = {number(low)}, got {number(high)}", f"{where}.high")
    if span.scale == "log" and low <= 0:
        raise SpecError(f"must be above 0 on a log scale, got {number(low)}", f"{where}.low")
    if sample.method == "grid" and steps < 2:
        got = f"got {steps}" if steps else f"as {{ low = {number(low)}, high = {number(high)}, steps = 5 }}"
        raise SpecError(f"must be a whole number, 2 … {MOST_VALUES}, {got}", f"{where}.steps")
    if kind is int:
        if ceil(low) > floor(high):
            raise SpecError(f"holds no whole number, from {number(low)} to {number(high)}", where)
        span = replace(span, low=float(ceil(low)), high=float(floor(high)))
    axis = Axis((name,), range=span, whole=kind is int)
    if sample.method != "grid":
        return axis
    return replace(axis, values=tuple(dict.fromkeys(axis.at(k / (steps - 1)) for k in range(steps))))


def _checked_values(name: str, values: Any, where: str) -> list[Any]:
    """Return the list of values of a varied field; refuse a value that the field can never take."""
    item = _spec_field(name)
    if not isinstance(values, list) or not 1 <= len(values) <= MOST_VALUES:
        raise SpecError(f"must be a list of 1 … {MOST_VALUES} values, got {shown(values)}", where)
    for index, value in enumerate(values):
        here = f"{where}[{index}]"
        if not _is_plain(value):
            raise SpecError(f"must be a number, text, true, false or a list of those, got {shown(value)}", here)
        if name in CATALOGUES and isinstance(value, str):
            if value not in catalogue(name):
                raise unknown_name(value, list(catalogue(name)), name, here)
        elif not is_dataclass(optional_type(item.type)[0]):
            checked(item, value, here)
    return values


def _is_plain(value: Any, depth: int = 0) -> bool:
    """Tell whether a value is plain JSON data, without null, too large numbers or too deep nesting."""
    if isinstance(value, (dict, list)):
        entries = value.values() if isinstance(value, dict) else value
        return depth < DEEPEST and all(_is_plain(entry, depth + 1) for entry in entries)
    return isinstance(value, str) or (isinstance(value, (int, float)) and abs(value) < LARGEST)


def _spec_field(name: str) -> "Field[Any]":
    """Return the dataclass `Field` of the spec's field or table `name`; raise `SpecError` if it cannot be varied."""
    where = f"axes.{name}"
    kind = Spec
    if name in ("name", "padgen"):
        raise SpecError("cannot be varied: each variant is named after the sweep and its number", where)
    for part in name.split("."):
        if not is_dataclass(kind):
            raise SpecError(f"must be a list of values or a range {{low, high, steps}}; it has no {part!r}", where)
        known = {f.name: f for f in fields(kind)}
        if part not in known:
            raise unknown_name(part, list(known), "field", where)
        kind = optional_type(known[part].type)[0]
    return known[part]


MOST_VARIANTS = 10_000_000
BLOCK = 4096


class Variant(NamedTuple):
    """A variant of a sweep: its number, and the values of the varied fields by dotted name."""

    number: int
    values: dict[str, Any]


def count_points(sweep: Sweep) -> int:
    """Return the number of variants of a sweep, before constraints take any away.

    Raises
    ------
    SpecError
        More than ten million.
    """
    points = sweep.sample.count or prod(len(axis.values) for axis in sweep.axes)
    if points > MOST_VARIANTS:
        raise SpecError(f"has {points} combinations, at most {MOST_VARIANTS} will do; take a sample", "axes")
    return points


def variants(sweep: Sweep) -> Iterator[Variant]:
    """Yield the variants of a sweep that meet all its constraints, in the order of their numbers."""
    count_points(sweep)
    points = product(*(axis.values for axis in sweep.axes)) if sweep.sample.method == "grid" else _sample(sweep)
    names = [name for axis in sweep.axes for name in axis.fields]
    for place, chosen in enumerate(points):
        variant = Variant(place, dict(zip(names, chain(*chosen), strict=True)))
        spec = sweep.spec
        with suppress(PadgenError):  # its row will tell what is wrong with it
            # A constraint may ask for what a varied field brings along, as a printer its default material.
            spec = make_spec(variant_table(sweep, variant), sweep.folder) if sweep.constraints else spec
        if all(condition.holds(variant.values, spec) for condition in sweep.constraints):
            yield variant


def variant_table(sweep: Sweep, variant: Variant) -> dict[str, Any]:
    """Return the spec of a variant as a table: the base spec with the varied fields and the variant's name put in."""
    return laid_over(sweep.base, variant.values) | {"name": sweep.name_of(variant.number)}


def _sample(sweep: Sweep) -> Iterator[list[tuple[Any, ...]]]:
    from scipy.stats import qmc

    count = sweep.sample.count
    generator = np.random.default_rng(sweep.sample.seed)
    if sweep.sample.method == "latin-hypercube":
        blocks: Iterable[np.ndarray] = [qmc.LatinHypercube(len(sweep.axes), rng=generator).random(count)]
    else:
        engine = qmc.Sobol(len(sweep.axes), rng=generator)
        # Of a power of two, as the sequence is balanced.
        blocks = (engine.random(BLOCK)[: count - start] for start in range(0, count, BLOCK))
    for block in blocks:
        for shares in block.tolist():
            yield [axis.at(share, True) for axis, share in zip(sweep.axes, shares, strict=True)]
