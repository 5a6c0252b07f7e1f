"""`Tuning`, the taxels of one print as measured, as frozen plain data, and its JSON file."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from padgen.core.errors import FileError, at_least, at_most, number
from padgen.core.files import file_hash, json_text, read_bounded
from padgen.core.units import UM
from padgen.planner.plan import Channel, Plan

__all__ = [
    "TunedTaxel",
    "Tuning",
    "planned_response_um_per_a2",
    "planned_tuning",
    "read_tuning",
    "refuse_tuning",
    "tuning_from_json",
    "tuning_hash",
    "tuning_to_json",
]

LARGEST_FILE, LARGEST_TAXEL = 1 << 22, 1 << 12
"""Most bytes of a file: a fixed number, and more for each taxel."""
FARTHEST = 10.0
"""Largest ratio of a resonance to the planned one, or the inverse; beyond it, another unit must have been used."""
LEAST_Q, LARGEST_Q = 0.5, 1e9
FARTHEST_RESPONSE = 1e6
"""Largest ratio of a response, or the inverse, to the one that follows from f and Q with the planned mass and pull.

A print changes it by less than ten; beyond the limit, another unit must have been used.
"""
LARGEST_ERROR = 1e6
"""Largest error of a figure, over the figure itself."""
KINDS = {float: "a number", str: "text", bool: "true or false", list: "a list", dict: "a table"}
"""Words for the types of JSON values (whole numbers are read as floats; null has no entry)."""


@dataclass(frozen=True, slots=True)
class TunedTaxel:
    """One taxel of a print; `_error` fields are one sigma.

    `response_um_per_a2` is the amplitude at resonance per amplitude of the line of i² there: the pull's force constant
    times Q over the stiffness. Where `measured` is False the figures are the plan's or estimated; where
    `level_measured` is False the response follows from f and Q with the plan's mass and pull.
    """

    id: str
    resonance_hz: float
    resonance_error_hz: float
    q: float
    q_error: float
    response_um_per_a2: float
    response_error: float
    measured: bool
    level_measured: bool


@dataclass(frozen=True, slots=True)
class Tuning:
    """All taxels of one print, in the plan's order; `name` is the plan's name."""

    name: str
    taxels: tuple[TunedTaxel, ...]


def planned_response_um_per_a2(channel: Channel, resonance_hz: float | None = None, q: float | None = None) -> float:
    """Return the amplitude in µm at resonance per A² of the line of i², with the planned mass and pull.

    `resonance_hz` and `q` are those of a print (None: as planned). A print is taken to change the stiffness and not the
    mass. The result is 0 for a washer that the coil does not pull.
    """
    hz, quality = resonance_hz or channel.resonance_hz, q or channel.q
    stiffness = channel.stiffness_n_per_m * (hz / channel.resonance_hz) ** 2
    return max(channel.force_constant_n_per_a2, 0.0) * quality / stiffness / UM


def planned_tuning(plan: Plan) -> Tuning:
    """Return the tuning of a print that came out exactly as planned."""
    taxels = []
    for taxel in plan.taxels:
        channel = plan.channels[taxel.channel]
        response = planned_response_um_per_a2(channel)
        taxels.append(TunedTaxel(taxel.id, channel.resonance_hz, 0.0, channel.q, 0.0, response, 0.0, False, False))
    return Tuning(plan.name, tuple(taxels))


def tuning_to_json(tuning: Tuning) -> str:
    """Return the tuning as JSON text."""
    return json_text(asdict(tuning))


def tuning_hash(tuning: Tuning) -> str:
    """Return the first 16 digits of the hash of a tuning's file."""
    return file_hash(tuning_to_json(tuning).encode())[:16]


def read_tuning(path: Path, plan: Plan) -> Tuning:
    """Read the tuning of a print of `plan` from a file.

    Raises
    ------
    FileError
        The file cannot be read, or is no tuning of this plan.
    """
    most = LARGEST_FILE + LARGEST_TAXEL * len(plan.taxels)
    try:
        text = read_bounded(path, most, f"a tuning of {len(plan.taxels)} taxels").decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"is not a tuning: byte {error.start} is not UTF-8 text", str(path)) from error
    return tuning_from_json(text, plan, str(path))


def tuning_from_json(text: str, plan: Plan, where: str = "tuning.json") -> Tuning:
    """Read the tuning of a print of `plan` from JSON text; `where` names its file in messages.

    Raises
    ------
    FileError
        The text is no tuning, belongs to another pad, or has figures that no print has.
    """
    try:
        table = json.loads(text, parse_int=float)
    except ValueError as error:
        raise FileError(f"is not a tuning: it is not JSON ({error})", where) from error
    except RecursionError as error:
        raise FileError("is not a tuning: it is nested too deeply", where) from error
    try:
        name, entries = _of_kind(table, "name", str), _of_kind(table, "taxels", list)
        _refuse_other(name, len(entries), plan)
        taxels = [_taxel(entry, taxel.id, k) for k, (entry, taxel) in enumerate(zip(entries, plan.taxels, strict=True))]
    except ValueError as error:
        raise FileError(f"is not a tuning of {plan.name!r}: {error}", where) from error
    tuning = Tuning(name, tuple(taxels))
    refuse_tuning(tuning, plan, where)
    return tuning


def refuse_tuning(tuning: Tuning, plan: Plan, where: str) -> None:
    """Refuse figures that no print of `plan` has.

    Raises
    ------
    FileError
        A figure is outside its bounds, which are named.
    """
    for tuned, taxel in zip(tuning.taxels, plan.taxels, strict=True):
        for name, value, (low, high), why in _bounded(tuned, plan.channels[taxel.channel]):
            # The bounds are widened, since files round to ten digits.
            if not low * (1 - 1e-9) <= value <= high * (1 + 1e-9):
                raise FileError(
                    f"{name} of {tuned.id} must be {at_least(low)} … {at_most(high)}{why}, got {number(value)}", where
                )


_Bounded = tuple[str, float, tuple[float, float], str]


def _bounded(tuned: TunedTaxel, channel: Channel) -> Iterator[_Bounded]:
    """Yield the name, value, bounds and their reason of each figure of a taxel."""
    planned = channel.resonance_hz
    around = planned / FARTHEST, planned * FARTHEST
    yield "resonance_hz", tuned.resonance_hz, around, f" Hz (planned: {number(planned)} Hz)"
    yield "q", tuned.q, (LEAST_Q, LARGEST_Q), ""
    usual = planned_response_um_per_a2(channel, tuned.resonance_hz, tuned.q) or 1.0
    if tuned.response_um_per_a2 != 0:
        bounds = usual / FARTHEST_RESPONSE, usual * FARTHEST_RESPONSE
        yield "response_um_per_a2", tuned.response_um_per_a2, bounds, " (or 0, where no current moves it)"
    for name, value, of in (
        ("resonance_error_hz", tuned.resonance_error_hz, tuned.resonance_hz),
        ("q_error", tuned.q_error, tuned.q),
        ("response_error", tuned.response_error, tuned.response_um_per_a2 or usual),
    ):
        yield name, value, (0.0, of * LARGEST_ERROR), ""


def _refuse_other(name: str, count: int, plan: Plan) -> None:
    if name != plan.name or count != len(plan.taxels):
        raise ValueError(
            f"it has {count} taxels of {name!r}, must have the {len(plan.taxels)} of {plan.name!r};"
            " padgen retune makes one for this plan"
        )


def _taxel(entry: Any, due: str, index: int) -> TunedTaxel:
    """Return a taxel from its entry in the file, which must have the ID `due`."""
    where = f" of taxel {index + 1}, {due},"
    values = {f.name: _of_kind(entry, f.name, f.type, where) for f in fields(TunedTaxel)}
    if values["id"] != due:
        raise ValueError(f"taxel {index + 1} must be {due!r}, in the order of the plan, it is {values['id']!r}")
    return TunedTaxel(**values)


def _of_kind(table: Any, name: str, kind: Any, of: str = "") -> Any:
    """Return the entry `name` of a table, which must be of the type `kind`."""
    if not isinstance(table, dict):
        raise ValueError(f"{of.strip(' ,').removeprefix('of ') or 'it'} must be a table, it is {_kind_name(table)}")
    if name not in table:
        raise ValueError(f"it has no {name!r}{of.rstrip(',')}")
    if type(table[name]) is not kind:
        raise ValueError(f"{name!r}{of} must be {KINDS[kind]}, it is {_kind_name(table[name])}")
    return table[name]


def _kind_name(value: Any) -> str:
    return KINDS.get(type(value), "null")
