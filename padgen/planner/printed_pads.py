"""Printing a plan many times over by a Monte-Carlo, and judging every printed coil.

A print moves resonances, and nothing else is moved here: Q and the masses of the response stay. Each spread is one
normal number z of the given sigma, its effect ``exp(s z)`` with s = d ln f / d z: log-normal, so that no dimension and
no resonance becomes negative however large a spread (at the sigma itself it is the linear rule).

====================  ==============================  =====================================================
spread                acts on                         d ln f
====================  ==============================  =====================================================
modulus               a pad                           1/2 dE/E
thickness drift       a pad                           s_t dt/t
plate gradient        a pad, by a taxel's place       what the place has of one side-to-side difference
width, length         a taxel                         s_w dw/w, s_l dl/l
thickness             a taxel                         s_t dt/t
glue                  a taxel                         −1/2 dm over the effective mass
====================  ==============================  =====================================================

s_w, s_t, s_l come from the beam model by central differences (the rule says 1/2, 3/2, −3/2). The gradient has a
random direction; along it the pad's two sides differ by its sigma, its middle not at all.

Every printed coil is judged by the closed form of `padgen.physics.selectivity` over all states, each washer pulled
as strongly as it lies to the coil: the smallest ON amplitude, that of a taxel alone on, over the largest OFF
amplitude, that with all others on. *Planned*: tones and forces stay at the plan's, so that a detuned taxel moves
less than planned when it is ON. *Retuned*: each tone goes to the measured resonance, the forces restore the level
that the level law gives it there.
"""

from dataclasses import astuple, dataclass, fields
from typing import NamedTuple

import numpy as np

from padgen.core.units import GRAM, MG
from padgen.physics.ladder import ladder_ratio
from padgen.physics.levels import LevelLaw
from padgen.physics.resonator import relative_energy
from padgen.physics.selectivity import Channels, Scheme, channels, off_energy
from padgen.planner.plan import Plan
from padgen.planner.settings import level_law
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.spec import Spec

__all__ = [
    "NAMES",
    "OF_A_PAD",
    "Coils",
    "Design",
    "Prints",
    "Spreads",
    "coils_of",
    "design_of",
    "log_detuning",
    "places_of_mm",
    "printed",
    "sensitivities",
    "spreads_of",
    "work",
]

BLOCK = 1 << 15
"""Responses that are worked on at a time: what stays in a core's cache."""
DRAWN, MOST_DRAWN = 1 << 18, 1 << 12
"""Taxels, and pads at most, that one stream of random numbers is for."""
STEP = 1e-3
"""Relative step of the central differences: their error is its square, that of rounding 1e-12 over it."""
ROUNDING_DB = 1e-9
FARTHEST = 20.0
"""Largest d ln f: beyond it a taxel is as lost as at it, and powers would overflow."""


@dataclass(frozen=True, slots=True)
class Spreads:
    """One sigma of each spread: relative (`modulus`, `plate_gradient`), in mm or in mg."""

    modulus: float
    thickness_drift_mm: float
    plate_gradient: float
    width_mm: float
    thickness_mm: float
    length_mm: float
    glue_mg: float


NAMES = tuple(f.name for f in fields(Spreads))
OF_A_PAD = ("modulus", "thickness_drift_mm", "plate_gradient")
"""Spreads with one number a pad; the others have one a taxel."""


class Coils(NamedTuple):
    """Coils of the same channels (n,), with the indices of their taxels (n, coils)."""

    channels: np.ndarray
    taxels: np.ndarray


class Design(NamedTuple):
    """What of a plan a print depends on: channels (n,), taxels (t,), coils by how many channels they have.

    `weight` (7, n) is d ln f per unit of each of `Spreads`.
    """

    resonance_hz: np.ndarray
    q: np.ndarray
    mass_g: np.ndarray
    pull: np.ndarray
    law: LevelLaw
    scheme: Scheme
    need: float
    crowded_ratio: float
    weight: np.ndarray
    sensitivity: np.ndarray
    channel: np.ndarray
    place_mm: np.ndarray
    size_mm: np.ndarray
    coils: tuple[Coils, ...]


class Prints(NamedTuple):
    """Results of pads (p,); the first axis of 2 is planned, retuned. `ratio` is an energy, inf without OFF taxels."""

    ratio: np.ndarray
    good_taxels: np.ndarray
    good: np.ndarray
    square: np.ndarray
    neighbours: np.ndarray


def spreads_of(spec: Spec) -> Spreads:
    """The spreads that a spec's material, printer and glue have.

    Of the tolerance of a thickness, a share is common to a pad; the squares of the two parts add up to its own.
    """
    printer, drift = spec.printer, spec.printer.thickness_drift_share
    return Spreads(
        modulus=spec.material.modulus_spread,
        thickness_drift_mm=printer.thickness_tolerance_mm * drift,
        plate_gradient=printer.plate_gradient,
        width_mm=printer.width_tolerance_mm,
        thickness_mm=printer.thickness_tolerance_mm * (1 - drift**2) ** 0.5,
        length_mm=printer.length_tolerance_mm,
        glue_mg=spec.taxel.glue_spread_mg,
    )


def sensitivities(plan: Plan) -> np.ndarray:
    """d ln f / d ln of width, thickness and length (n, 3) of every channel, by the beam model."""
    spec, result = plan.spec, np.empty((len(plan.channels), 3))
    step = np.exp(STEP * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)]))
    for topology in {c.beam.topology for c in plan.channels}:
        index = [c.index for c in plan.channels if c.beam.topology == topology]
        beams = [plan.channels[i].beam for i in index]
        size = np.array([(b.width_mm, b.thickness_mm, b.length_mm) for b in beams])[:, None] * step
        model = TaxelModel(spec, topology, plate_shape(spec), BeamShape(*np.moveaxis(size, -1, 0)))
        # The mode that works as drawn is followed: which one works most must not jump between the steps.
        working = np.broadcast_to(model.working[:, :1], model.working.shape)[..., None]
        log_hz = np.log(np.take_along_axis(model.modes.frequency_hz, working, -1)[..., 0])
        result[index] = (log_hz[:, 1:4] - log_hz[:, 4:]) / (2 * STEP)
    return result


def places_of_mm(plan: Plan) -> np.ndarray:
    return np.array([(taxel.x_mm, taxel.y_mm) for taxel in plan.taxels])


def coils_of(plan: Plan) -> dict[tuple[int, int], list[int]]:
    """Indices of each coil's taxels, lowest channel first."""
    coils: dict[tuple[int, int], list[int]] = {}
    for index, taxel in sorted(enumerate(plan.taxels), key=lambda item: item[1].channel):
        coils.setdefault(taxel.coil, []).append(index)
    return coils


def design_of(plan: Plan, places_mm: np.ndarray | None) -> Design:
    spec, sensitivity = plan.spec, sensitivities(plan)
    size = np.array([(c.beam.width_mm, c.beam.thickness_mm, c.beam.length_mm) for c in plan.channels])
    mass = np.array([c.effective_mass_g for c in plan.channels])
    pull = np.array([c.force_constant_n_per_a2 for c in plan.channels])
    width, thickness, length = (sensitivity / size).T
    one, glue = np.ones(len(mass)), -0.5 / (mass * GRAM / MG)
    channel = np.array([taxel.channel for taxel in plan.taxels])
    alike: dict[tuple[int, ...], list[list[int]]] = {}
    for index in coils_of(plan).values():
        alike.setdefault(tuple(channel[index]), []).append(index)
    return Design(
        resonance_hz=np.array([c.resonance_hz for c in plan.channels]),
        q=np.array([c.q for c in plan.channels]),
        mass_g=mass,
        pull=pull if (pull > 0).all() else np.ones(len(mass)),
        law=level_law(spec),
        scheme=plan.scheme,
        need=10 ** ((plan.selectivity.asked_db - ROUNDING_DB) / 10),
        crowded_ratio=ladder_ratio(spec.q_min, spec.delta_y),
        weight=np.array([one / 2, thickness, one, width, thickness, length, glue]),
        sensitivity=sensitivity,
        channel=channel,
        place_mm=places_of_mm(plan) if places_mm is None else np.asarray(places_mm, float),
        size_mm=np.array([spec.pad.width_mm, spec.pad.depth_mm]),
        coils=tuple(Coils(np.array(own), np.array(alike[own]).T) for own in sorted(alike)),
    )


def work(design: Design) -> float:
    """Responses that one pad takes, planned and retuned; the random numbers of a taxel weigh as ten."""
    with_pairs = design.scheme.has_pair_spurs
    each = [(n := len(coils.channels)) ** 2 + with_pairs * (n > 2) * n**2 * (n - 1) for coils in design.coils]
    coils = [coils.taxels.shape[1] for coils in design.coils]
    return 2.0 * sum(np.multiply(each, coils)) + 10.0 * len(design.channel)


def log_detuning(design: Design, spreads: Spreads, seed: int, unit: int, pads: int) -> np.ndarray:
    """ln of printed over planned resonance (taxels, pads). Each spread has a stream of its own."""
    taxels = len(design.channel)
    result = np.zeros((taxels, pads))
    for k, (name, sigma) in enumerate(zip(NAMES, astuple(spreads), strict=True)):
        if not sigma:
            continue
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(unit, k)))
        z = rng.standard_normal((1 if name in OF_A_PAD else taxels, pads))
        if name == "plate_gradient":
            z = z * _along(design, rng.uniform(0, np.pi, pads))
        result += (sigma * design.weight[k])[design.channel, None] * z
    return result


def _along(design: Design, angle: np.ndarray) -> np.ndarray:
    """Where taxels lie along a direction (taxels, pads): −1/2 at the pad's one side, 1/2 at the other."""
    direction = np.stack([np.cos(angle), np.sin(angle)])
    along: np.ndarray = (design.place_mm[:, :1] * direction[0] + design.place_mm[:, 1:] * direction[1]) / (
        design.size_mm @ np.abs(direction)
    )
    return along


def printed(design: Design, spreads: Spreads, pads: int, seed: int) -> Prints:
    """Print and judge, a stream of random numbers after the other, in blocks of bounded memory."""
    taxels, count = len(design.channel), len(design.q)
    unit = max(min(DRAWN // taxels, MOST_DRAWN), 1)
    step = max(BLOCK // taxels, 1)
    prints = Prints(
        np.full((2, pads), np.inf), np.zeros((2, pads), int), np.ones((2, pads), bool), np.zeros(count), np.zeros(2)
    )
    for number in range(-(-pads // unit)):
        # A stream is drawn whole, so that the first pads are the same however many there are.
        log_x = log_detuning(design, spreads, seed, number, unit)[:, : pads - number * unit]
        prints.square[:] += np.bincount(design.channel, (log_x**2).sum(1), count)
        x = np.exp(np.clip(log_x, -FARTHEST, FARTHEST))
        for first in range(0, x.shape[1], step):
            part = x[:, first : first + step]
            start = number * unit + first
            block = slice(start, start + part.shape[1])
            for coils in design.coils:
                _judge(design, coils, part, prints, block)
    return prints


def _judge(design: Design, coils: Coils, x: np.ndarray, prints: Prints, block: slice) -> None:
    """Enter what `coils` are like in prints that came out `x` (taxels, pads) off."""
    n, shape = len(coils.channels), (*coils.taxels.shape, x.shape[1])
    x = x[coils.taxels].reshape(n, -1)
    f, q, mass, pull = (v[coils.channels, None] for v in (design.resonance_hz, design.q, design.mass_g, design.pull))
    tuned = channels(f, q, design.law(f), mass, pull)
    hz = f * x
    found = channels(hz, q, design.law(hz), mass, pull)
    cases = (Channels(hz, q, tuned.line * x**2), tuned), (found, found)
    for k, (printed, tones) in enumerate(cases):
        on = (relative_energy(tones.resonance_hz, hz, q) * (tones.line / printed.line) ** 2).reshape(shape)
        if n == 1:
            good = on >= 0.5
            prints.good[k, block] &= good.all((0, 1))
        else:
            off = off_energy(printed, design.scheme, drivers=tones).reshape(shape)
            good = on >= design.need * off
            ratio = (on.min(0) / off.max(0)).min(0)
            prints.ratio[k, block] = np.minimum(prints.ratio[k, block], ratio)
            prints.good[k, block] &= ratio >= design.need
        prints.good_taxels[k, block] += good.sum((0, 1))
    apart = hz[1:] / hz[:-1]
    limit = design.crowded_ratio
    prints.neighbours[:] += (apart < 1).sum(), ((apart < limit) & (apart > 1 / limit)).sum()
