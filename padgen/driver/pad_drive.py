"""`PadDrive`: what every coil of a pad, as planned or as measured, plays when its taxels are on, and how it is sampled.

Frequencies lie on a *comb*, whole multiples of 1/period, so that what is written can be looped without a
seam and the smallest constant of a spur-free force is known for all times. A line that the comb moves off
its taxel's resonance is made as much larger as the taxel answers less there.
"""

from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from math import ceil, floor, isfinite
from typing import NamedTuple

import numpy as np

from padgen.core.errors import SpecError, at_least, number
from padgen.core.units import MH
from padgen.measured.tuning import Tuning, levels_um, planned_tuning
from padgen.physics.crest import (
    ALIAS_DB,
    RootMargin,
    comb_period_s,
    least_constant,
    low_crest_phases,
    on_comb,
    root_margin,
)
from padgen.physics.resonator import relative_energy
from padgen.physics.schemes import bias_a, current_lines_a
from padgen.physics.selectivity import Scheme
from padgen.planner.plan import CARRIER_OVER_RESONANCE, Plan
from padgen.planner.plan import carrier_hz as planned_carrier_hz
from padgen.planner.printed_pads import coils_of

__all__ = [
    "CONTROLLER_RATES_HZ",
    "HIGHEST_RATE_HZ",
    "RATES_HZ",
    "RATE_OVER_RESONANCE",
    "CoilDrive",
    "CoilLines",
    "PadDrive",
    "coil_lines",
    "constant_a2",
    "drive_at",
    "highest_hz",
    "make_drive",
]

HIGHEST_RATE_HZ = 1_000_000
RATE_OVER_RESONANCE = 8
"""Samples in a period of the highest resonance: the fewest."""


@dataclass(frozen=True, slots=True, eq=False)
class CoilDrive:
    """One coil's part of a drive; arrays (n,), its lowest channel first.

    `taxels` are indices into the plan's. A taxel at level 1 gets the line ``line_a2 cos(2π force_hz t + phase_rad)``
    of i²; `force_hz` is ``harmonic / period``. `bias_a` is the constant current of the biased scheme, else 0;
    `margin` the share of its line that each channel adds to the smallest constant, spur-free, else 0.
    """

    row: int
    column: int
    taxels: np.ndarray
    force_hz: np.ndarray
    harmonic: np.ndarray
    line_a2: np.ndarray
    phase_rad: np.ndarray
    bias_a: float
    margin: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class PadDrive:
    """The coils of a pad, row by row, and what feeds them: all of one scheme and on one comb.

    `rate_hz` is that of the samples; a period is a whole number of them. `resistance_ohm`, `inductance_h`
    are each coil's, `level_um` the ON amplitude that was asked of the lowest channel. With a `carrier_hz` (spur-free
    only) the current is ``√(2F) cos(2π carrier_hz t)``, for amplifiers that pass no constant. `alias_db` is what the
    voltage has above the amplifier's band over its largest line, the worst of all coils; None but for spur-free.
    """

    scheme: Scheme
    rate_hz: int
    period_s: float
    resistance_ohm: float
    inductance_h: float
    voltage_limit_v: float
    coils: tuple[CoilDrive, ...]
    level_um: float
    carrier_hz: float | None
    alias_db: float | None

    @property
    def period_samples(self) -> int:
        """Samples of one period of the comb."""
        return round(self.period_s * self.rate_hz)

    @property
    def has_constant(self) -> bool:
        """True where the amplifier must pass a part at 0 Hz."""
        return self.scheme.has_constant and self.carrier_hz is None


class CoilLines(NamedTuple):
    """Lines (n,) of a coil at level 1: ``Re amplitude exp(2πi harmonic t / period)``."""

    harmonic: np.ndarray
    amplitude: np.ndarray


def coil_lines(drive: PadDrive, coil: CoilDrive) -> CoilLines:
    """Return the lines of a coil's current in A beside its `bias_a`; spur-free of i² in A² beside `constant_a2`.

    They go with the level; where the scheme has no constant, with its root, at half the force's frequency.
    """
    height = coil.line_a2 if drive.scheme.is_root else current_lines_a(drive.scheme, coil.line_a2)
    if drive.scheme.has_constant:
        return CoilLines(coil.harmonic, height * np.exp(1j * coil.phase_rad))
    return CoilLines(coil.harmonic // 2, height * np.exp(0.5j * coil.phase_rad))


def constant_a2(drive: PadDrive, coil: CoilDrive, levels: np.ndarray) -> np.ndarray:
    """Return the constant part (s,) of i² of a spur-free coil with its channels at `levels` (s, n)."""
    lines = np.atleast_2d(levels) * coil.line_a2
    states, which = np.unique(lines, axis=0, return_inverse=True)
    least = least_constant(coil.harmonic, states, coil.phase_rad)
    return np.asarray((least + states @ coil.margin)[which.reshape(-1)])


def make_drive(
    plan: Plan,
    rate_hz: int,
    tuning: Tuning | None = None,
    carrier_hz: float | None = None,
    bandwidth_hz: float | None = None,
) -> PadDrive:
    """Make the drive of `plan`, for the print that `tuning` tells of (None: as planned), sampled at `rate_hz`.

    The comb's period is the shortest that moves no line far off its resonance; `bandwidth_hz` is the amplifier's (None:
    half the rate); a carrier is moved onto the comb.

    Raises
    ------
    SpecError
        `rate_hz` is too low for the highest line of the current, a carrier is outside its bounds, or a coil cannot move
        a taxel.
    """
    tuning = tuning or planned_tuning(plan)
    spec, scheme = plan.spec, plan.scheme
    known = np.array([(taxel.resonance_hz, taxel.q, taxel.response_um_per_a2) for taxel in tuning.taxels])
    resonance, q, response = known.T
    highest_hz = float(resonance.max())
    lowest_rate = ceil(RATE_OVER_RESONANCE * highest_hz)
    if not lowest_rate <= rate_hz <= HIGHEST_RATE_HZ:
        raise SpecError(
            f"must be {lowest_rate} … {HIGHEST_RATE_HZ} Hz, {RATE_OVER_RESONANCE} times the highest resonance or"
            f" more, got {number(rate_hz)} Hz",
            "--rate",
        )
    # A tone of the current at half the force's frequency must fit the period too.
    step = 1 if scheme.has_constant else 2
    period_s = comb_period_s(resonance, q, step, rate_hz)
    harmonic = on_comb(resonance, period_s, step)
    if carrier_hz is not None:
        carrier_hz = _carrier_hz(carrier_hz, scheme, rate_hz, period_s, highest_hz)
    if bandwidth_hz is not None and not (isfinite(bandwidth_hz) and bandwidth_hz > 0):
        raise SpecError(f"must be above 0 Hz, got {number(bandwidth_hz)} Hz", "bandwidth")
    band_hz = min(rate_hz / 2, bandwidth_hz or rate_hz / 2)
    unmoved = [taxel.id for taxel in tuning.taxels if not taxel.response_um_per_a2 > 0]
    if unmoved:
        raise SpecError(f"{unmoved[0]} is not pulled by its coil and cannot be driven", plan.name)
    force_hz = harmonic / period_s
    line_a2 = levels_um(plan, resonance) / response / np.sqrt(relative_energy(force_hz, resonance, q))

    @cache
    def shaped(harmonics: tuple[int, ...], lines: tuple[float, ...]) -> tuple[np.ndarray, RootMargin]:
        """Return phases (n,) and margin of a coil; many coils of a pad are alike."""
        k, line = np.array(harmonics, int), np.array(lines)
        if scheme.has_constant:
            phase = low_crest_phases(k, line) if len(k) else np.zeros(0)
        else:  # a tone's phase in i² is twice the current's
            alone = scheme.takes_turns or not len(k)
            phase = np.zeros(len(k)) if alone else 2 * low_crest_phases(k // 2, np.sqrt(line))
        if not scheme.is_root or not len(k):
            return phase, RootMargin(np.zeros(len(k)), -np.inf, 0.0, 1.0)
        margin = partial(
            root_margin,
            k,
            line,
            phase,
            period_s=period_s,
            rate_hz=rate_hz,
            resistance_ohm=spec.coil.resistance_ohm,
            inductance_h=spec.coil.inductance_mh * MH,
            # How far the root's lines may reach: about a carrier they go to both sides.
            bandwidth_hz=band_hz if carrier_hz is None else max(min(band_hz - carrier_hz, carrier_hz), 1.0),
        )
        # The margin is for the amplifier's band, and for its voltage as far as the planned constant goes: more of it
        # would heat the coil and pull the washers by more than the plan was judged by.
        most, wanted = 1 + spec.drive.headroom, margin(voltage_limit_v=spec.drive.voltage_limit_v)
        if wanted.constant <= most:
            return phase, wanted
        least = margin(voltage_limit_v=np.inf)
        if least.constant >= most:
            return phase, least
        part = (most - least.constant) / (wanted.constant - least.constant)
        share = least.share + part * (wanted.share - least.share)
        return phase, RootMargin(share, least.alias_db, least.peak_v, most)

    coils, alias_db, taxels_of = [], [], coils_of(plan)
    for place in product(range(plan.coils.rows), range(plan.coils.columns)):
        taxels = np.array(taxels_of.get(place, ()), int)  # the lowest channel first
        k, line = harmonic[taxels], line_a2[taxels]
        phase, margin = shaped(tuple(k.tolist()), tuple(line.tolist()))
        bias = bias_a(scheme, line) if scheme.is_biased and len(taxels) else 0.0
        coils.append(CoilDrive(*place, taxels, force_hz[taxels], k, line, phase, bias, margin.share))
        alias_db.append(margin.alias_db)
    return PadDrive(
        scheme,
        rate_hz,
        period_s,
        spec.coil.resistance_ohm,
        spec.coil.inductance_mh * MH,
        spec.drive.voltage_limit_v,
        tuple(coils),
        spec.drive.level_um,
        carrier_hz,
        max(alias_db) if scheme.is_root else None,
    )


def _carrier_hz(carrier_hz: float, scheme: Scheme, rate_hz: int, period_s: float, highest_hz: float) -> float:
    if not scheme.is_root:
        raise SpecError(f"is for the spur-free drive only, this one is {scheme.name!r}", "--carrier")
    lowest, highest = CARRIER_OVER_RESONANCE * highest_hz, rate_hz / 2 - CARRIER_OVER_RESONANCE * highest_hz
    if lowest > highest:
        raise SpecError(f"needs a rate of at least {at_least(4 * lowest)} Hz, got {number(rate_hz)} Hz", "--carrier")
    if not lowest <= carrier_hz <= highest:
        raise SpecError(
            f"must be {at_least(lowest)} … {number(floor(highest))} Hz, {CARRIER_OVER_RESONANCE} times the highest"
            f" resonance away from 0 and from half the rate, got {number(carrier_hz)} Hz",
            "--carrier",
        )
    return round(carrier_hz * period_s) / period_s


RATES_HZ = (48_000, 96_000, 192_000)
"""Sample rates of sound cards; the first that suits the highest resonance and the root's bends is taken."""
CONTROLLER_RATES_HZ = (8_000, 12_000, 16_000, 24_000, 32_000, *RATES_HZ)
"""For a microcontroller, which makes every sample anew."""
SAMPLES_OF_HIGHEST = 16
"""Samples in a period of the highest resonance, at least, where the rate is ours to choose."""


def drive_at(
    plan: Plan,
    rates_hz: tuple[int, ...],
    rate_hz: int | None = None,
    tuning: Tuning | None = None,
    carrier_hz: float | None = None,
) -> PadDrive:
    """Make the drive at `rate_hz`, or where that is None at the first of `rates_hz` that will do.

    `carrier_hz` None: on the carrier that the spec's amplifier needs, if it needs one.
    """
    highest = highest_hz(plan, tuning)
    if carrier_hz is None:
        carrier_hz = planned_carrier_hz(plan.spec, plan.scheme, highest)

    def made(rate: int) -> PadDrive:
        return make_drive(plan, rate, tuning=tuning, carrier_hz=carrier_hz, bandwidth_hz=plan.spec.drive.bandwidth_hz)

    if rate_hz is not None:
        return made(rate_hz)
    least = SAMPLES_OF_HIGHEST * highest
    if carrier_hz is not None:
        # One that no rate carries is refused with the bounds of the highest.
        least = max(least, min(2 * (carrier_hz + CARRIER_OVER_RESONANCE * highest), max(*rates_hz, least)))
    enough = [rate for rate in rates_hz if rate >= least] or [ceil(least / 1000) * 1000]
    for rate in enough:
        drive = made(rate)
        if drive.alias_db is None or drive.alias_db <= ALIAS_DB:
            break
    return drive


def highest_hz(plan: Plan, tuning: Tuning | None) -> float:
    """Return the highest resonance of the plan's channels, or of the print's taxels."""
    return max(one.resonance_hz for one in (plan.channels if tuning is None else tuning.taxels))
