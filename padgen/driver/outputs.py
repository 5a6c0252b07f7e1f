"""The amplifier outputs that a drive needs, and what an AC-coupled sound card leaves of it if the spec names none."""

from dataclasses import dataclass
from itertools import product
from math import inf

import numpy as np

from padgen.driver.waveform import CoilDrive, PadDrive, constant_a2
from padgen.measured.tuning import Tuning, planned_tuning
from padgen.physics.resonator import relative_energy
from padgen.planner.plan import Plan
from padgen.spec.load import COMMON_CORNER_HZ

__all__ = ["Outputs", "needed_outputs"]

MOST_SPELLED_OUT = 4
"""Channels of a coil up to which all on/off states are tried; beyond, one on, one off and all on."""
POINTS = 64
"""Points in a cycle of the highest line at which the current is taken."""


@dataclass(frozen=True, slots=True)
class Outputs:
    """Outputs that a file needs: `count`, one for each coil, and whether they must pass 0 Hz (`coupling` 'DC').

    The other figures are of what a first-order high-pass at `ac_corner_hz` leaves of a drive that must, None for one
    that need not: own lines of ON taxels, `ac_level_db`, from and to, None where nothing is left of them; and the
    smallest ON over the largest OFF taxel of a coil in its worst state, with it and without. `states` counts those that
    were tried.
    """

    count: int
    coupling: str
    ac_corner_hz: float | None = None
    ac_level_db: tuple[float, float] | None = None
    ac_selectivity_db: float | None = None
    selectivity_db: float | None = None
    states: int = 0


def needed_outputs(plan: Plan, drive: PadDrive, tuning: Tuning | None = None) -> Outputs:
    """Return number and coupling of the outputs that a drive needs, and what of it passes an AC-coupled sound card."""
    count = len(drive.coils)
    if not drive.has_constant:
        return Outputs(count, "AC or DC")
    if drive.scheme.is_biased:
        # The wanted lines are products with the constant current, and vanish with it.
        return Outputs(count, "DC", COMMON_CORNER_HZ)
    taxels = (tuning or planned_tuning(plan)).taxels
    alike = {coil.harmonic.tobytes() + coil.line_a2.tobytes(): coil for coil in drive.coils if len(coil.taxels)}
    levels_db = list[float]()
    left = inf
    whole = inf
    states = 0
    for coil in alike.values():
        coil_taxels = [taxels[index] for index in coil.taxels]
        resonance, q = np.array([(taxel.resonance_hz, taxel.q) for taxel in coil_taxels]).T
        for on in _states(len(coil_taxels)):
            states += 1
            level_db, kept_db = _after_high_pass(drive, coil, on, resonance, q, COMMON_CORNER_HZ)
            levels_db += level_db[on].tolist()
            left = min(left, kept_db)
            whole = min(whole, _after_high_pass(drive, coil, on, resonance, q, 0.0)[1])
    return Outputs(
        count,
        "DC",
        COMMON_CORNER_HZ,
        (min(levels_db), max(levels_db)),
        None if left == inf else left,
        None if whole == inf else whole,
        states,
    )


def _states(count: int) -> list[np.ndarray]:
    """Return the on/off states (n,) to try: all but silence; for many channels just one on, just one off, all on."""
    if count <= MOST_SPELLED_OUT:
        return [np.array(state) for state in product((False, True), repeat=count) if any(state)]
    one = np.eye(count, dtype=bool)
    return [*one, *~one, np.ones(count, bool)]


def _after_high_pass(
    drive: PadDrive, coil: CoilDrive, on: np.ndarray, resonance_hz: np.ndarray, q: np.ndarray, corner_hz: float
) -> tuple[np.ndarray, float]:
    """Return lines (n,) of i² after a high-pass in dB relative to the wanted lines, and the selectivity in dB kept.

    Each taxel is one resonance; the spur-free current is held.
    """
    points = 1 << (POINTS * int(coil.harmonic.max()) - 1).bit_length()
    angle = np.arange(points) * (2 * np.pi / points)
    square = constant_a2(coil, on.astype(float))[0] + sum(
        line * np.cos(k * angle + phase)
        for k, line, phase in zip(coil.harmonic[on], coil.line_a2[on], coil.phase_rad[on], strict=True)
    )
    hz = np.arange(points // 2 + 1) / drive.period_s
    passed = np.ones(len(hz))
    if corner_hz:
        passed = hz / (hz - 1j * corner_hz)
    current = np.fft.irfft(np.fft.rfft(np.sqrt(np.maximum(square, 0.0))) * passed, points)
    lines = np.abs(np.fft.rfft(current**2))[1:] * (2 / points)
    felt = np.array(
        [(lines**2 * relative_energy(hz[1:], f, taxel_q)).sum() for f, taxel_q in zip(resonance_hz, q, strict=True)]
    )
    felt /= coil.line_a2**2 * relative_energy(coil.force_hz, resonance_hz, q)
    level_db = 20 * np.log10(lines[coil.harmonic - 1] / coil.line_a2)
    kept_db = inf if on.all() else float(10 * np.log10(felt[on].min() / felt[~on].max()))
    return level_db, kept_db
