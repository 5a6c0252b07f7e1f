"""`Sweep`: which variants of a base spec are to be made, from TOML. Frozen plain data."""

from dataclasses import Field, asdict, dataclass, field, fields, is_dataclass
from math import ceil, floor
from pathlib import Path
from typing import Any

from padgen.batch.expression import Expression, parse_expression
from padgen.core.errors import FileError, SpecError, number, shown
from padgen.core.files import reason
from padgen.core.registry import USUAL_FORMATS
from padgen.spec import Spec, find_spec, make_spec
from padgen.spec.fields import build, checked, choice, flag, folder_name, optional_type, quantity, text, unknown_name
from padgen.spec.load import CATALOGUES, catalogue, parse_toml, read_table, read_toml, without_none

__all__ = ["METHODS", "STAGES", "Axis", "Limits", "Sample", "Sweep", "load_sweep", "parse_sweep", "sweep_over"]

STAGES = ("plan", "yield", "build", "study")
METHODS = ("grid", "latin-hypercube", "sobol")
SCALES = ("linear", "log")
MOST_VALUES, MOST_AT_ONCE = 10_000, 100_000
LARGEST = 1e15
"""Above any bound of a field, and small enough that arithmetic on it stays finite."""
DEEPEST = 4
"""Lists and tables within one another that a value may be."""
RANGE_KEYS = ("low", "high", "steps", "scale")


@dataclass(frozen=True, slots=True)
class Axis:
    """What is varied together: `fields` are dotted names of a spec.

    Either `values` (k, fields), or a range from `low` to `high` of one field, in `steps` where a grid needs
    them. `whole` tells that the field takes whole numbers only.
    """

    fields: tuple[str, ...]
    values: tuple[tuple[Any, ...], ...] = ()
    low: float = 0.0
    high: float = 0.0
    steps: int = 0
    scale: str = "linear"
    whole: bool = False


@dataclass(frozen=True, slots=True)
class Sample:
    """How the points are chosen."""

    method: str = choice("grid", of=METHODS, doc="grid: all combinations; the others: `count` points, seeded")
    count: int = quantity(0, unit="variants", low=0, high=10_000_000, doc="of a sample")
    seed: int = quantity(0, unit="1", low=0, high=2**32 - 1, doc="of a sample; the same seed, the same points")


@dataclass(frozen=True, slots=True)
class Limits:
    """What one variant may take before it is given up."""

    time_s: float = quantity(600.0, unit="s", low=0.1, high=1e6, doc="run time of one variant")
    memory_mb: float = quantity(4000.0, unit="MB", low=100, high=1e7, doc="memory of a worker")


@dataclass(frozen=True, slots=True)
class Settings:
    """The top level of a sweep's TOML, but its tables."""

    name: str = folder_name(doc="name of the sweep and of its folder", most=72)
    base: str = text(doc="a spec's file (beside the sweep's) or the name of a template")
    stage: str = choice("plan", of=STAGES, doc="how far each variant is made")
    formats: str = text(",".join(USUAL_FORMATS), doc="of a build, as `padgen build` has them")
    pads: int = quantity(10_000, unit="pads", low=1, high=10_000_000, doc="printed in the computer for the yield")
    folders: bool = flag(True, doc="whether each variant gets a folder of its own; the index has its figures anyway")


@dataclass(frozen=True)
class Sweep:
    """The whole sweep. `base` is the table that the variants are laid over, `spec` what it means by itself."""

    settings: Settings
    base: dict[str, Any]
    spec: Spec
    folder: Path
    axes: tuple[Axis, ...]
    constraints: tuple[Expression, ...]
    sample: Sample = field(default_factory=Sample)
    limits: Limits = field(default_factory=Limits)


TOP_KEYS = [f.name for f in fields(Settings)]


def load_sweep(path: str) -> Sweep:
    """Read a `Sweep` from a file.

    Raises
    ------
    FileError, SpecError
        It cannot be read, or a field of it or of its base is unknown, missing or out of bounds.
    """
    return _sweep(read_toml(Path(path), path or "SWEEP"), Path(path).parent, path)


def parse_sweep(content: str, where: str = "sweep", folder: Path = Path()) -> Sweep:
    """Make a `Sweep` from TOML text; the files that it names lie in `folder`."""
    return _sweep(parse_toml(content, where), folder, where)


def sweep_over(spec: Spec, axes: dict[str, Any], stage: str = "plan") -> Sweep:
    """Make the `Sweep` of all combinations of fields' values, as the table ``axes`` of a sweep's TOML has them.

    Raises
    ------
    SpecError
        A field is unknown, or holds no list of values that it may take.
    """
    folders = stage in ("build", "study")
    settings = build(Settings, {"name": spec.name[:72], "base": spec.name, "stage": stage, "folders": folders}, "sweep")
    sample = Sample()
    found = _axes(_plain_lists(axes), [], spec, sample)
    _refuse_values(found)
    return Sweep(settings, without_none(asdict(spec)), spec, Path().absolute(), found, (), sample, Limits())


def _plain_lists(axes: Any) -> Any:
    """Lists where a program gives tuples, ranges or arrays."""
    if isinstance(axes, dict):
        return {name: _plain_lists(values) for name, values in axes.items()}
    if hasattr(axes, "tolist"):
        return axes.tolist()
    return [_plain_lists(value) for value in axes] if isinstance(axes, (list, tuple, range)) else axes


def _sweep(table: dict[str, Any], folder: Path, where: str) -> Sweep:
    try:
        return _of_tables(table, folder)
    except RecursionError as error:
        raise SpecError("cannot be read: its values are nested too deeply", where) from error


def _of_tables(table: dict[str, Any], folder: Path) -> Sweep:
    tables = {key: table.pop(key, {}) for key in ("axes", "sample", "limits")}
    linked, constraints = table.pop("linked", []), table.pop("constraints", [])
    formats = table.get("formats")
    if isinstance(formats, list) and all(isinstance(entry, str) for entry in formats):
        table["formats"] = ",".join(formats)
    for key in table:
        if key not in TOP_KEYS:
            raise unknown_name(key, TOP_KEYS, "key", "sweep")
    settings: Settings = build(Settings, table, "")
    base, base_folder = _base(settings.base, folder)
    try:
        spec = make_spec(base, base_folder)
    except SpecError as error:
        raise SpecError(f"is no spec by itself: {error}", f"base {settings.base!r}") from error
    sample = _sample(tables["sample"])
    axes = _axes(tables["axes"], linked, spec, sample)
    if not isinstance(constraints, list) or not all(isinstance(entry, str) for entry in constraints):
        raise SpecError(f"must be a list of conditions as text, got {shown(constraints)}", "constraints")
    _refuse_formats(settings)
    _refuse_values(axes)
    return Sweep(
        settings,
        base,
        spec,
        base_folder.absolute(),
        axes,
        tuple(parse_expression(entry, spec) for entry in constraints),
        sample,
        build(Limits, tables["limits"], "limits"),
    )


def _sample(table: Any) -> Sample:
    sample: Sample = build(Sample, table, "sample")
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


def _refuse_values(axes: tuple[Axis, ...]) -> None:
    """Refuse a value that a field never takes, whatever the others are: a mistyped name is no variant."""
    for axis in axes:
        for index, row in enumerate(axis.values):
            for name, value in zip(axis.fields, row, strict=True):
                _refuse_value(name, value, f"axes.{name}[{index}]")


def _refuse_value(name: str, value: Any, where: str) -> None:
    if name in CATALOGUES and isinstance(value, str):
        known = list(catalogue(name))
        if value not in known:
            raise unknown_name(value, known, name, where)
        return
    item = _spec_field(name)
    if not is_dataclass(optional_type(item.type)[0]):
        checked(item, value, where)


def _refuse_formats(settings: Settings) -> None:
    from padgen.make.pad import parse_formats

    try:
        parse_formats(settings.formats)
    except SpecError as error:
        raise SpecError(error.message, "formats") from error


def _base(name: str, folder: Path) -> tuple[dict[str, Any], Path]:
    """The base spec's table: a file beside the sweep's, or a template."""
    beside = folder / name
    try:
        path = beside if beside.is_file() else find_spec(name)
    except OSError as error:
        raise FileError(f"cannot be read ({reason(error)})", f"base {name!r}") from error
    return read_table(path, name), path.parent


def _axes(table: Any, linked: Any, spec: Spec, sample: Sample) -> tuple[Axis, ...]:
    if not isinstance(table, dict) or not isinstance(linked, list):
        raise SpecError("must be a table of fields ([axes]), and [[linked]] tables", "axes")
    axes = [_axis(name, value, spec, sample) for name, value in _flat(table)]
    axes += [_linked(entry, spec) for entry in linked]
    names = [name for axis in axes for name in axis.fields]
    for name in names:
        if names.count(name) > 1:
            raise SpecError("is varied twice", f"axes.{name}")
    if not axes:
        raise SpecError("is missing; it names the fields that are varied, and their values", "axes")
    return tuple(axes)


def _flat(table: dict[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Dotted names and values: ``pad.width_mm = …`` is a nested table in TOML."""
    pairs = []
    for key, value in table.items():
        if isinstance(value, dict) and not set(value) & set(RANGE_KEYS):
            if not value:
                raise SpecError("is empty; it would name fields, and their values", f"axes.{prefix}{key}")
            pairs += _flat(value, f"{prefix}{key}.")
        else:
            pairs.append((prefix + key, value))
    return pairs


def _axis(name: str, value: Any, spec: Spec, sample: Sample) -> Axis:
    _refuse_unknown(name, spec)
    if isinstance(value, list):
        return Axis((name,), tuple((entry,) for entry in _filled(value, f"axes.{name}")))
    if not isinstance(value, dict):
        raise SpecError(f"must be a list of values or a range {{low, high, steps}}, got {shown(value)}", f"axes.{name}")
    for key in value:
        if key not in RANGE_KEYS:
            raise unknown_name(key, list(RANGE_KEYS), "key", f"axes.{name}")
    return _range(name, value, spec, sample)


def _range(name: str, value: dict[str, Any], spec: Spec, sample: Sample) -> Axis:
    where = f"axes.{name}"
    kind = optional_type(_spec_field(name).type)[0]
    if kind not in (int, float):
        raise SpecError("is no number, so that it has no range; give a list of values", where)
    low, high = (_finite(value.get(key), f"{where}.{key}") for key in ("low", "high"))
    steps, scale = value.get("steps", 0), value.get("scale", "linear")
    if not low < high:
        raise SpecError(f"must be above low = {number(low)}, got {number(high)}", f"{where}.high")
    if scale not in SCALES:
        raise unknown_name(str(scale), list(SCALES), "scale", f"{where}.scale")
    if scale == "log" and low <= 0:
        raise SpecError(f"must be above 0 on a log scale, got {number(low)}", f"{where}.low")
    fewest = 2 if sample.method == "grid" else 0
    if not isinstance(steps, int) or isinstance(steps, bool) or not fewest <= steps <= MOST_VALUES:
        got = (
            f"got {shown(steps)}"
            if "steps" in value
            else f"as {{ low = {number(low)}, high = {number(high)}, steps = 5 }}"
        )
        raise SpecError(f"must be a whole number, {fewest} … {MOST_VALUES}, {got}", f"{where}.steps")
    if kind is int:
        if ceil(low) > floor(high):
            raise SpecError(f"holds no whole number, from {number(low)} to {number(high)}", where)
        low, high = float(ceil(low)), float(floor(high))
    return Axis((name,), (), low, high, steps, scale, kind is int)


def _finite(value: Any, where: str) -> float:
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not abs(value) < LARGEST:
        raise SpecError(f"must be a number, got {shown(value)}" if value is not None else "is missing", where)
    return float(value)


def _linked(entry: Any, spec: Spec) -> Axis:
    pairs = _flat(entry) if isinstance(entry, dict) else []
    if not pairs:
        raise SpecError("must be a table of fields with lists of one length", "linked")
    for name, values in pairs:
        _refuse_unknown(name, spec)
        _filled(values, f"linked.{name}")
        if len(values) != len(pairs[0][1]):
            raise SpecError(
                f"must have {len(pairs[0][1])} values as {pairs[0][0]} has, got {len(values)}", f"linked.{name}"
            )
    return Axis(tuple(name for name, _ in pairs), tuple(zip(*(values for _, values in pairs), strict=True)))


def _filled(values: Any, where: str) -> list[Any]:
    if not isinstance(values, list) or not 1 <= len(values) <= MOST_VALUES:
        raise SpecError(f"must be a list of 1 … {MOST_VALUES} values, got {shown(values)}", where)
    for index, value in enumerate(values):
        if not _is_plain(value):
            raise SpecError(
                f"must be a number, text, true, false or a list of those, got {shown(value)}", f"{where}[{index}]"
            )
    return values


def _is_plain(value: Any, depth: int = 0) -> bool:
    """Tell whether JSON can hold a value, unlike TOML's dates and times and numbers that no field takes."""
    if isinstance(value, (dict, list)):
        entries = value.values() if isinstance(value, dict) else value
        return depth < DEEPEST and all(_is_plain(entry, depth + 1) for entry in entries)
    return isinstance(value, str) or (isinstance(value, (int, float)) and abs(value) < LARGEST)


def _refuse_unknown(name: str, spec: Spec) -> None:
    if name in ("name", "padgen"):
        raise SpecError("cannot be varied: each variant is named after the sweep and its number", f"axes.{name}")
    where = f"axes.{name}"
    value: Any = spec
    known: list[str] = []
    for part in name.split("."):
        if not is_dataclass(value):
            raise SpecError(f"must be a list of values or a range {{low, high, steps}}; it has no {part!r}", where)
        known = [f.name for f in fields(value)]
        if part not in known:
            raise unknown_name(part, known, "field", where)
        value = getattr(value, part)


def _spec_field(name: str) -> "Field[Any]":
    """A field of a spec, or a whole table, by its dotted name."""
    kind: Any = Spec
    for part in name.split("."):
        item = next(f for f in fields(kind) if f.name == part)
        kind = optional_type(item.type)[0]
    return item
