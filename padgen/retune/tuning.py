"""`Tuning`: the taxels of one print as they were measured. Frozen plain data with a JSON round trip."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from math import isfinite
from typing import Any

from padgen.errors import FileError, number
from padgen.files import file_hash, json_text
from padgen.planner.plan import Channel, Plan
from padgen.units import UM

__all__ = [
    "TunedTaxel",
    "Tuning",
    "planned_response_um_per_a2",
    "planned_tuning",
    "tuning_from_json",
    "tuning_hash",
    "tuning_to_json",
]


@dataclass(frozen=True, slots=True)
class TunedTaxel:
    """One taxel of the print.

    `response_um_per_a2` is its amplitude at its resonance per amplitude of the line of i² there: the pull's
    force constant times Q over the stiffness. The `_error` fields are one sigma. Where `measured` is False
    the figures are the plan's; where `level_measured` is False the response follows from f and Q with the
    plan's mass and pull.
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
    """All taxels of a print, in the order of the plan's; `name` is the plan's."""

    name: str
    taxels: tuple[TunedTaxel, ...]


def planned_response_um_per_a2(channel: Channel, resonance_hz: float | None = None, q: float | None = None) -> float:
    """Amplitude in µm at resonance per A² of the line of i², of a taxel as planned or of one that came out otherwise.

    What a print moves is taken to be the stiffness: the mass stays. 0 for a washer that the coil does not pull.
    """
    hz, quality = resonance_hz or channel.resonance_hz, q or channel.q
    stiffness = channel.stiffness_n_per_m * (hz / channel.resonance_hz) ** 2
    return max(channel.force_constant_n_per_a2, 0.0) * quality / stiffness / UM


def planned_tuning(plan: Plan) -> Tuning:
    """A print that came out as planned."""
    taxels = []
    for taxel in plan.taxels:
        channel = plan.channels[taxel.channel]
        response = planned_response_um_per_a2(channel)
        taxels.append(TunedTaxel(taxel.id, channel.resonance_hz, 0.0, channel.q, 0.0, response, 0.0, False, False))
    return Tuning(plan.name, tuple(taxels))


def tuning_to_json(tuning: Tuning) -> str:
    """The tuning as JSON text."""
    return json_text(asdict(tuning))


def tuning_hash(tuning: Tuning) -> str:
    """The first 16 digits of the hash of a tuning's file."""
    return file_hash(tuning_to_json(tuning).encode())[:16]


def tuning_from_json(text: str, plan: Plan, where: str = "tuning.json") -> Tuning:
    """Read a tuning back, for `plan`.

    Raises
    ------
    FileError
        The text is no tuning, or one of other taxels than the plan's.
    """
    try:
        table = json.loads(text)
        taxels = tuple(_taxel(entry) for entry in table["taxels"])
        tuning = Tuning(str(table["name"]), taxels)
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f"is not a tuning ({type(error).__name__}: {error})", where) from error
    planned = [taxel.id for taxel in plan.taxels]
    if [taxel.id for taxel in tuning.taxels] != planned:
        raise FileError(
            f"is of {len(tuning.taxels)} taxels of {tuning.name!r}, not of the {len(planned)} of {plan.name!r};"
            " padgen retune makes one for this plan",
            where,
        )
    for taxel in tuning.taxels:
        _refuse(taxel, where)
    return tuning


def _taxel(entry: Mapping[str, Any]) -> TunedTaxel:
    return TunedTaxel(**{f.name: f.type(entry[f.name]) for f in fields(TunedTaxel) if callable(f.type)})


def _refuse(taxel: TunedTaxel, where: str) -> None:
    for name in ("resonance_hz", "q"):
        value = getattr(taxel, name)
        if not (isfinite(value) and value > 0):
            raise FileError(f"{name} of {taxel.id} must be above 0, got {number(value)}", where)
    if not (isfinite(taxel.response_um_per_a2) and taxel.response_um_per_a2 >= 0):
        raise FileError(
            f"response_um_per_a2 of {taxel.id} must be at least 0, got {number(taxel.response_um_per_a2)}", where
        )
