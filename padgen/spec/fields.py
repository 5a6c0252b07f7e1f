"""Define and check the fields of a spec, each with its unit, bounds and one line of documentation.

The same metadata checks a TOML file, words the error and makes the JSON schema, so that the three always agree.
"""

import re
import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, field, fields
from typing import Any, Union, get_args, get_origin

from padgen.core.errors import SpecError, number, plain, shown
from padgen.core.registry import unknown_name

__all__ = [
    "build",
    "checked",
    "choice",
    "choices",
    "entry_name",
    "flag",
    "folder_name",
    "numbers",
    "optional_type",
    "quantity",
    "text",
    "unknown_name",
]

LONGEST_TEXT = 1000
"""Most characters of a text."""
MOST_NUMBERS = 10_000
"""Most entries of a list."""


def quantity(
    default: Any = MISSING, *, unit: str, low: float, high: float, doc: str, words: tuple[str, ...] = ()
) -> Any:
    """Return a dataclass field for a number in `unit`, from `low` to `high`, or for one of `words` instead."""
    return field(default=default, metadata={"unit": unit, "low": low, "high": high, "doc": doc, "words": words})


def numbers(
    default: Any = MISSING,
    *,
    unit: str,
    low: float,
    high: float,
    doc: str,
    count: int | None = None,
    single: bool = False,
) -> Any:
    """Return a dataclass field for a list of numbers in `unit`, each from `low` to `high`: `count` of them if given.

    Where it may be `single`, a number stands for a list of one.
    """
    bounds = {"unit": unit, "low": low, "high": high}
    return field(default=default, metadata={**bounds, "doc": doc, "count": count, "single": single})


def choice(
    default: Any = MISSING, *, of: tuple[str, ...] | Callable[[], tuple[str, ...]], doc: str, what: str = "choice"
) -> Any:
    """Return a dataclass field for one of the words in `of`, a tuple or a function that is called at each check.

    A refused word is called `what`, which tells what is chosen where the field's name does not.
    """
    return field(default=default, metadata={"choices": of, "doc": doc, "what": what})


def choices(meta: Any) -> tuple[str, ...]:
    """Return the words that a field with this metadata allows; empty where any text is allowed."""
    of: Any = meta.get("choices", ())
    return tuple(of() if callable(of) else of)


def text(default: Any = MISSING, *, doc: str) -> Any:
    """Return a dataclass field for one line of text."""
    return field(default=default, metadata={"doc": doc})


def entry_name(*, doc: str) -> Any:
    """Return a dataclass field for a part's name; it must not begin like a formula, as spreadsheets open the tables."""
    return field(metadata={"doc": doc, "pattern": r"[^\s=+@-].{0,99}"})


def folder_name(*, doc: str, most: int) -> Any:
    """Return a dataclass field for a name that any operating system accepts for a folder, at most `most` characters."""
    pattern = rf"[A-Za-z0-9]([A-Za-z0-9._-]{{0,{most - 2}}}[A-Za-z0-9_-])?"
    return field(metadata={"doc": doc, "pattern": pattern, "reserved": RESERVED})


RESERVED = ("con", "prn", "aux", "nul", *(f"{port}{digit}" for port in ("com", "lpt") for digit in range(10)))
"""Names of devices on Windows; they stay reserved with any extension after a dot."""


def flag(default: bool, *, doc: str) -> Any:
    """Declare a field that is true or false."""
    return field(default=default, metadata={"doc": doc})


def optional_type(annotation: Any) -> tuple[Any, bool]:
    """Split ``T | None`` into ``(T, True)``; any other annotation is ``(annotation, False)``."""
    if get_origin(annotation) in (Union, types.UnionType):
        inner = [a for a in get_args(annotation) if a is not type(None)]
        return inner[0], True
    return annotation, False


def build(kind: type, table: Any, where: str, base: "dict[str, Any] | None" = None) -> Any:
    """Make the frozen dataclass `kind` from a TOML `table` laid over the values of `base`.

    Raises
    ------
    SpecError
        The table has an unknown key, lacks one that has no default, or holds a bad value.
    """
    if not isinstance(table, dict):
        raise SpecError(f"must be a table, got {shown(table)}", where)
    known = {f.name: f for f in fields(kind)}
    prefix = f"{where}." if where else ""
    for key in table:
        if key not in known:
            raise unknown_name(key, list(known), "key", where or "spec")
    values = dict(base or {})
    for key, value in table.items():
        values[key] = checked(known[key], value, prefix + key)
    for name, item in known.items():
        if name not in values and item.default is MISSING and item.default_factory is MISSING:
            raise SpecError(f"is missing; {item.metadata['doc']}", prefix + name)
    return kind(**values)


def checked(item: "Field[Any]", value: Any, where: str) -> Any:
    """Return a TOML value as its field's type; raise SpecError if it has another type or breaks the field's bounds."""
    kind = optional_type(item.type)[0]
    meta = item.metadata
    if kind in TYPES:
        if words := meta.get("words", ()):
            if isinstance(value, str) and value in words:
                return value
            if isinstance(value, str):
                raise unknown_name(value, list(words), "choice but a number or", where)
        if kind is int and isinstance(value, float) and value.is_integer():
            value = int(value)
        _refuse(kind, meta, value, where)
        return kind(value)
    count = meta["count"]
    inner, *_ = get_args(kind)
    if meta.get("single") and not isinstance(value, (list, tuple)):
        _refuse(inner, meta, value, where)
        return (inner(value),)
    if not isinstance(value, (list, tuple)) or not value or (count and len(value) != count):
        what = f"a list of {count or 'one or more'} numbers in {meta['unit']}"
        raise SpecError(f"must be {what}, got {shown(value)}", where)
    if len(value) > MOST_NUMBERS:
        raise SpecError(f"must be at most {MOST_NUMBERS} numbers, got {len(value)}", where)
    for i, entry in enumerate(value):
        _refuse(inner, meta, entry, f"{where}[{i}]")
    return tuple(map(inner, value))


TYPES = {bool: "true or false", str: "text", int: "a whole number", float: "a number"}
"""Types of single values, in words."""


def _refuse(kind: type, meta: Mapping[str, Any], value: Any, where: str) -> None:
    """Raise SpecError if a single value is not of type `kind` or breaks a bound in its field's metadata."""
    known: Any = (int, float) if kind is float else kind
    if not isinstance(value, known) or (isinstance(value, bool) and kind is not bool):
        raise SpecError(f"must be {TYPES[kind]}, got {shown(value)}", where)
    if kind is str:
        words = choices(meta)
        pattern = meta.get("pattern")
        if words and value not in words:
            raise unknown_name(value, list(words), meta.get("what", "choice"), where)
        if len(value) > LONGEST_TEXT or plain(value) != value:
            raise SpecError(f"must be a line of at most {LONGEST_TEXT} characters, got {shown(value)}", where)
        if pattern and not re.fullmatch(pattern, value):
            raise SpecError(f"must match {pattern}, got {shown(value)}", where)
        if value.partition(".")[0].lower() in meta.get("reserved", ()):
            raise SpecError(f"must not be the name of a device on Windows, got {value!r}", where)
    elif kind is not bool and not meta["low"] <= value <= meta["high"]:  # nan is outside, too
        low, high = meta["low"], meta["high"]
        unit = f" {meta['unit']}" if meta["unit"] not in ("", "1") else ""
        # No cure for a list's entry.
        cures = [] if where.endswith("]") else [{where: high if value > high else low}]
        sentence = f"must be at least {number(low)} and at most {number(high)}{unit}, got {number(value)}{unit}"
        raise SpecError(sentence, where, cures)
