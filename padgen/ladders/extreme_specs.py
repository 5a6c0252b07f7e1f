"""Extreme cases of plans: specs drawn from the whole space of specs, planned end to end, and the selectivity.

Of a spec come a plan of finite figures, or one sentence. The selectivity's have a Q up to 1e7, thousands of channels,
lines that all but meet; each figure is held to the same formula in 60 digits, at the frequencies that the doubles stand
for."""

import re
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from functools import partial
from math import nan
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from padgen.core.errors import PadgenError
from padgen.make.planning import plan_for
from padgen.physics.ladder import LevelLaw, capacity, geometric_ladder
from padgen.physics.selectivity import Channels, Scheme, channels, off_energy
from padgen.spec import Spec, catalogue, make_spec
from padgen.spec.fields import choices
from padgen.verify.engines import mpmath
from padgen.verify.extreme import FINER_ELEMENTS, FINER_ERROR, Answer, ExtremeCase

__all__ = ["outcome", "random_table", "selectivity_cases", "spec_cases"]

GROUPS, IN_GROUP = 8, 50
SOLIDS = (0, 1, 9, 11, 30, 37)
"""Random specs of which a taxel is solved by finite elements, too: feasible ones of every topology."""
TOLERANCE = 3e-3
QUICK, QUICK_ERROR = (3, 1), 3e-3
"""Order and levels of elements that a beam model is held against, and what they may be off by."""
MOST_ODD = 4
"""Fields, at most, that are drawn from all that they may be, the others being of the catalogues or usual."""
LONGEST_SENTENCE = 1000
IMPOSSIBLE: dict[str, dict[str, Any]] = {
    "a washer that sags by 10 mm over a gap of 1 mm": {"resonances_hz": [5.0], "band_hz": [4, 6], "resolution": 1},
    "a washer that rests on its coil by its weight": {"coil": {"gap_mm": 0.05}, "resonances_hz": [60.0, 120.0]},
    # Tones, or fewer channels over a coil, pull less: the search would take those, and that pad does survive.
    "a level of half the gap": {
        "drive": {"level_um": 500.0, "scheme": "biased"},
        "coil": {"grid": [1, 1], "gap_mm": 1.0},
    },
    "a level of twice the gap": {"drive": {"level_um": 2000.0}},
}
FREE = (
    "resolution",
    "threshold_file",
    "threshold_hz",
    "threshold_um",
    "resonances_hz",
    "structure",
    "name",
    "source",
    "power_w",
)
"""Fields of the spec that are not drawn among the odd ones: without bounds, or drawn always."""


def spec_cases() -> Iterator[ExtremeCase]:
    """Yield groups of random specs, taxels of some of them by finite elements, and statics that no pad survives."""
    for first in range(0, GROUPS * IN_GROUP, IN_GROUP):
        name, source = f"random {first} … {first + IN_GROUP - 1}", "a plan of finite figures, or one sentence"
        yield ExtremeCase(name, "specs", "plan", partial(_group, first), partial(np.array, [0.0]), source)
    for number in SOLIDS:
        quick, source = partial(_solid, number, QUICK, QUICK_ERROR), f"elements of order {QUICK[0]}, {QUICK_ERROR:.1%}"
        yield ExtremeCase(f"taxel of random {number}", "specs", "beam", partial(_beam, number), quick, source)
    converged, finer = partial(_solid, SOLIDS[1], None, nan), partial(_solid, SOLIDS[1], FINER_ELEMENTS, FINER_ERROR)
    source = f"elements of order {FINER_ELEMENTS[0]}, {FINER_ELEMENTS[1]} layers"
    yield ExtremeCase(f"taxel of random {SOLIDS[1]}", "specs", "elements", converged, finer, source)
    for name, fields_ in IMPOSSIBLE.items():
        table = {"name": "impossible", "resolution": 4, "band_hz": [50, 200], "q_min": 15, **fields_}
        told, source = partial(np.array, [1.0]), "an error or a refusal, since no pad can be so"
        yield ExtremeCase(name, "specs", "plan", partial(_refused, table), told, source)


def _group(first: int) -> Answer:
    """Count how many of a group's specs are answered wrongly; raise with the first of them."""
    found = {number: outcome(random_table(number)) for number in range(first, first + IN_GROUP)}
    wrong = [f"random {number}: {fault}" for number, fault in found.items() if fault]
    if wrong:
        raise ValueError(f"{len(wrong)} of {IN_GROUP} are wrong: {'; '.join(wrong[:3])}")
    return Answer(np.array([0.0]), 0.0)


def _refused(table: dict[str, Any]) -> Answer:
    """Return 1 for a plan that has found an error; a refusal is raised."""
    plan = plan_for(make_spec(table))
    return Answer(np.array([float(any(finding.level == "error" for finding in plan.findings))]), 0.0)


def _beam(number: int) -> Answer:
    """Return the lowest resonance by the plan's model, which states some of its standard deviations."""
    channel = plan_for(make_spec(random_table(number, 0))).channels[0]
    return Answer(np.array([channel.resonance_hz]), channel.model_error)


def _solid(number: int, setting: tuple[int, int] | None, error: float) -> Answer:
    """Return the same of the printed solid, by elements of a setting that err by `error`, or by the tuning ones."""
    from padgen.make.solid_tuning import solid_taxel
    from padgen.solid.formats.step import write_taxel_step  # before NGSolve, which brings another OCCT
    from padgen.verify.elasticity import converged_modes, solve_modes

    plan = plan_for(make_spec(random_table(number, 0)))
    with TemporaryDirectory() as folder:
        step = Path(folder) / "taxel.step"
        write_taxel_step(plan, plan.channels[0], step)
        taxel = solid_taxel(plan, plan.channels[0], step)
        found = solve_modes(taxel, *setting) if setting else converged_modes(taxel, TOLERANCE)
    working = found.modes.working
    stated = error if setting else float(found.error[working])
    return Answer(found.modes.frequency_hz[[working]], stated, found.residual)


def random_table(number: int, most_odd: int = MOST_ODD) -> dict[str, Any]:
    """Draw spec number `number`, as a table; the same on every machine."""
    random = Random(number)
    draw = random.random
    low, side_mm = 10 * 20 ** draw(), 30 * 5 ** draw()
    material, made = random.choice(sorted(catalogue("material").items()))
    printers = [name for name, entry in sorted(catalogue("printer").items()) if entry["process"] == made["process"]]
    table: dict[str, Any] = {
        "name": f"random-{number}",
        "resolution": 1 + int((side_mm / 12) ** 2 * draw()),
        "band_hz": [low, low * 2 * 10 ** draw()],
        "q_min": 3 * 30 ** draw(),
        "material": material,
        "printer": random.choice(printers),
        "washer": random.choice(sorted(catalogue("washer"))),
        "pad": {"width_mm": side_mm, "depth_mm": side_mm},
        "suspension": {"topology": random.choice(["auto", "cantilever", "folded", "bridge"])},
    }
    for _ in range(int(draw() * (most_odd + 1))):
        name, item = random.choice(DRAWN)
        meta = item.metadata
        if known := choices(meta):
            value: Any = random.choice(known)
        elif meta["low"] > 0:
            value = meta["low"] * (meta["high"] / meta["low"]) ** draw()
        else:
            value = meta["high"] * draw() ** 4
        entry = table.setdefault(name, {}) if name else table
        if isinstance(entry, str):
            entry = table[name] = {"name": entry}
        entry[item.name] = int(value) if item.type == "int" or item.type is int else value
    return table


def _is_drawn(item: Any) -> bool:
    single = "low" in item.metadata and "count" not in item.metadata
    return item.name not in FREE and (single or bool(choices(item.metadata)))


DRAWN = [
    (name, item)
    for name, table in [("", Spec), *((part.name, part.type) for part in fields(Spec) if is_dataclass(part.type))]
    for item in fields(table)
    if _is_drawn(item)
]
"""The tables of a spec ("" is the top level) and their fields, those that have bounds or choices."""


def outcome(table: dict[str, Any]) -> str:
    """Return the fault of the answer to a spec, empty where it is a plan of finite figures or one sentence.

    A plan that finds an error in itself, as where a coil does not pull its washer, may have infinite figures.
    """
    try:
        plan = plan_for(make_spec(table))
    except PadgenError as error:
        return "its refusal is no sentence" if "\n" in str(error) or len(str(error)) > LONGEST_SENTENCE else ""
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    honest = any(finding.level == "error" for finding in plan.findings)
    lost = re.search(r"(\w+)\W+(nan|inf)\b", repr(vars(plan)))
    return f"{lost[1]} is no number" if lost and not honest else ""


DIGITS = 60
ROUNDING = float(np.finfo(float).eps)
PER_LINE = 16
"""Roundings that one line's energy may take, and one more for each time that the sum doubles."""


def selectivity_cases() -> Iterator[ExtremeCase]:
    """Yield the energy of one OFF taxel in the worst state of the others, and the paper's capacity."""
    for q in (1.0, 15.0, 1e3, 1e5, 1e7):
        yield _energy(f"32 channels in 20 … 1000 Hz, Q = {q:g}", (20.0, 1000.0), 32, q, "spur-free", 16)
    wide = "of 2,048 channels over 10⁴ in frequency, Q ="
    for q, off in ((1.0, 1023), (1e7, 0), (1e7, 1023), (1e7, 2047)):
        yield _energy(f"number {off} {wide} {q:g}", (0.1, 1000.0), 2048, q, "spur-free", off)
    for scheme in ("tones", "biased"):
        for off in (0, 31, 63):
            name = f"number {off} of 64 channels with spurs, Q = 1e7"
            yield _energy(name, (20.0, 1000.0), 64, 1e7, scheme, off)
    for scheme in ("tones", "spur-free"):
        name = "8 channels within 1e-9 of each other, Q = 1e7"
        yield _energy(name, (100.0, 100.0 * (1 + 1e-9)), 8, 1e7, scheme, 4)
    for q, delta_y in ((15.0, 10.0), (1e7, 10.0), (1e7, 1e-3), (1.0, 3.9999)):
        yield _capacity(q, delta_y)


def _case(name: str, model: str, value: Callable[[], float], stated: float, exact: Callable[[], Any]) -> ExtremeCase:
    def reference() -> np.ndarray:
        with mpmath.workdps(DIGITS):
            return np.array([float(exact())])

    source = f"the same sums in {DIGITS} digits (mpmath)"
    return ExtremeCase(name, "selectivity", model, lambda: Answer(np.array([value()]), stated), reference, source)


def _energy(name: str, band_hz: tuple[float, float], count: int, q: float, scheme: str, off: int) -> ExtremeCase:
    def value() -> float:
        return float(off_energy(_even_channels(band_hz, count, q), Scheme(scheme))[off])

    def exact() -> Any:
        own = _even_channels(band_hz, count, q)
        hz, line = ([mpmath.mpf(float(v)) for v in part] for part in (own.resonance_hz, own.line))
        return _summed(hz, line, mpmath.mpf(q), Scheme(scheme), off)

    return _case(name, scheme, value, (PER_LINE + float(np.log2(count))) * ROUNDING, exact)


def _capacity(q: float, delta_y: float) -> ExtremeCase:
    def exact() -> Any:
        share = mpmath.mpf(delta_y) / (4 * mpmath.mpf(q))
        return mpmath.log(mpmath.mpf(1000) / 20) / mpmath.log((1 + share) / (1 - share))

    name = f"channels in 20 … 1000 Hz, Q = {q:g}, Δy = {delta_y:g}"
    return _case(name, "Eq. 12", lambda: capacity(20.0, 1000.0, q, delta_y), 8 * ROUNDING, exact)


def _even_channels(band_hz: tuple[float, float], count: int, q: float) -> Channels:
    resonance_hz = geometric_ladder(*band_hz, count)
    return channels(resonance_hz, q, LevelLaw(1.0)(resonance_hz))


def _summed(hz: list[Any], line: list[Any], q: Any, scheme: Scheme, off: int) -> Any:
    def heard(frequency: Any, amplitude: Any) -> Any:
        share = frequency / hz[off]
        return (amplitude / line[off]) ** 2 / ((q * (1 - share**2)) ** 2 + share**2)

    others = [j for j in range(len(hz)) if j != off]
    total = sum(heard(hz[j], line[j]) for j in others)
    if not scheme.has_pair_spurs:
        return total
    half = 2 if scheme.name == "tones" else 1
    biased = 2 * mpmath.mpf(scheme.bias_ratio) * max(line)
    for place, a in enumerate(others):
        if scheme.is_biased:
            total += heard(2 * hz[a], line[a] ** 2 / (2 * biased))
        for b in others[place + 1 :]:
            both = 2 * mpmath.sqrt(line[a] * line[b]) if scheme.name == "tones" else line[a] * line[b] / biased
            total += heard((hz[a] + hz[b]) / half, both) + heard(abs(hz[a] - hz[b]) / half, both)
    return total
