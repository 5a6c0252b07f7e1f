"""Read a `Plan` back from its JSON; refuse missing entries, entries of another kind, and sizes that no pad has."""

import json
from dataclasses import fields, is_dataclass
from math import isfinite
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin

from padgen.core.errors import FileError, SpecError
from padgen.core.files import read_bounded
from padgen.planner.plan import Beam, Cell, CoilGrid, Plan, Plate, Site, Taxel
from padgen.planner.suspensions import names
from padgen.planner.tile import TURNS
from padgen.spec import Spec, make_spec
from padgen.spec.load import LARGEST_PLAN, without_none

__all__ = ["plan_from_json", "read_plan"]

DRAWN = (CoilGrid, Cell, Plate, Beam, Site, Taxel)
"""Parts with sizes that are drawn. Here every number must be finite; in other parts null stands for an infinite one."""
LARGEST_MM = 1e4
MAY_BE_0 = ("post_diameter_mm", "boss_edge_mm", "fillet_mm")
KINDS: dict[Any, tuple[tuple[type, ...], str]] = {
    str: ((str,), "text"),
    bool: ((bool,), "true or false"),
    int: ((int,), "a whole number"),
    float: ((int, float), "a number"),
    type(None): ((type(None),), "null"),
}


def read_plan(path: Path) -> Plan:
    """Return the plan in a file; raises `FileError` if the file cannot be read or holds no plan."""
    try:
        text = read_bounded(path, LARGEST_PLAN, "a plan").decode()
    except UnicodeDecodeError as error:
        raise FileError("is not a plan (it is not text)", str(path)) from error
    return plan_from_json(text, str(path))


def plan_from_json(text: str, where: str = "plan.json") -> Plan:
    """Read a plan from its JSON text; `where` names the source in errors.

    Raises
    ------
    FileError
        The text is not the JSON of a plan.
    """
    try:
        plan: Plan = _read(Plan, json.loads(text), "the plan")
        _refuse_contradictions(plan)
    except (ValueError, RecursionError) as error:
        raise FileError(f"is not a plan ({error}); padgen plan makes one", where) from error
    except SpecError as error:
        raise FileError(f"is not a plan (its spec: {error}); padgen plan makes one", where) from error
    return plan


def _read(kind: Any, value: Any, where: str, drawn: bool = False) -> Any:
    """Return the `value` of an entry as its `kind`; raises `ValueError` if it is of another kind."""
    if kind is Spec:
        return make_spec(without_none(_table(value, where)))
    if is_dataclass(kind):
        return _read_table(kind, value, where)
    if get_origin(kind) is tuple:
        return _read_list(get_args(kind), value, where, drawn)
    if get_origin(kind) is UnionType:
        kinds = [k for k in get_args(kind) if type(value) in KINDS[k][0]]
        return _read(kinds[0] if kinds else get_args(kind)[0], value, where, drawn)
    if get_origin(kind) is dict:
        return {
            name: _read(get_args(kind)[1], entry, f"{where}.{name}") for name, entry in _table(value, where).items()
        }
    if kind is Any:  # the value of a field of the spec
        return value
    if value is None and kind is float and not drawn:
        return None  # JSON has no infinity: a figure without a finite value is written as null
    allowed, what = KINDS[kind]
    if type(value) not in allowed or (kind is float and not _is_finite(value)):
        raise ValueError(f"{where} must be {what}")
    return value if value is None else kind(value)


def _table(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{where} must be a table")
    return value


def _read_table(kind: Any, value: Any, where: str) -> Any:
    value, entries = _table(value, where), {}
    for item in fields(kind):
        place = item.name if kind is Plan else f"{where}.{item.name}"
        if item.name not in value:
            raise ValueError(f"{place} is missing")
        entries[item.name] = _read(item.type, value[item.name], place, kind in DRAWN)
    return kind(**entries)


def _read_list(kinds: tuple[Any, ...], value: Any, where: str, drawn: bool) -> tuple[Any, ...]:
    endless = kinds[-1] is Ellipsis
    if not isinstance(value, list) or (not endless and len(value) != len(kinds)):
        raise ValueError(f"{where} must be a list" + ("" if endless else f" of {len(kinds)}"))
    each = [kinds[0]] * len(value) if endless else kinds
    return tuple(_read(k, entry, f"{where}[{i}]", drawn) for i, (k, entry) in enumerate(zip(each, value, strict=True)))


def _is_finite(value: float) -> bool:
    """Return whether a float can hold a number; JSON may have whole numbers of any size."""
    try:
        return isfinite(value)
    except OverflowError:
        return False


def _refuse_contradictions(plan: Plan) -> None:
    """Raise `ValueError` for parts that contradict each other or cannot be drawn."""
    if not plan.channels or not plan.taxels:
        raise ValueError("it has no channels or no taxels")
    if not plan.coils.rows > 0 < plan.coils.columns or not 0 < plan.coils.sets <= len(plan.channels):
        raise ValueError("coils must be one or more, with no more sets than channels")
    for index, channel in enumerate(plan.channels):
        if channel.index != index:
            raise ValueError(f"channels[{index}].index must be {index}")
        if channel.beam.topology not in names() or channel.site.along not in TURNS:
            raise ValueError(f"channels[{index}] has a topology or a direction that there is not")
        _refuse_sizes(channel.beam, f"channels[{index}].beam")
        _refuse_sizes(channel.site, f"channels[{index}].site")
    for index, taxel in enumerate(plan.taxels):
        row, column = taxel.coil
        on_grid = 0 <= row < plan.coils.rows and 0 <= column < plan.coils.columns
        if not on_grid or not 0 <= taxel.channel < len(plan.channels):
            raise ValueError(f"taxels[{index}] is of a coil or a channel that there is not")
        _refuse_sizes(taxel, f"taxels[{index}]")
    for part in ("coils", "cell", "plate"):
        _refuse_sizes(getattr(plan, part), part)


def _refuse_sizes(part: Any, where: str) -> None:
    """Raise `ValueError` for a size or place beyond any pad; places may be 0 or negative, sizes not."""
    is_place = isinstance(part, (Site, Taxel))
    for item in fields(part):
        value = getattr(part, item.name)
        for size in value if isinstance(value, tuple) else (value,):
            if not isinstance(size, (int, float)):
                continue
            may_be_0 = is_place or item.name in MAY_BE_0
            if abs(size) > LARGEST_MM or (size < 0 and not is_place) or (size == 0 and not may_be_0):
                raise ValueError(f"{where}.{item.name} must be a size of a pad, at most {LARGEST_MM:g}")
