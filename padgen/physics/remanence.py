"""Remanence of washers and core: the part of the pull that goes with the current itself, not with its square.

Steel that keeps a share of its magnetisation acts as if a field as large as that share of its coercivity H_c were
applied to it, whatever its shape (a hysteresis loop shifted along H). A current i' that applies this field has the same
effect. With the washer's and the core's the pull is

    c (i + i_w)(i + i_c) = c (i² + ρ i + …),   ρ = i_w + i_c.

A line of the current at f with the amplitude I so makes a force of ρ I at f beside the wanted I²/2 at 2f. Where the
current has a constant part B that is the wanted line's own frequency, and the level changes by ρ/2B. A root of the
wanted force has further lines, which `root_lines` bounds. Once a magnet has touched steel it keeps all of it;
alternating currents leave less (Rayleigh's loops; Bozorth, Ferromagnetism, 1951, ch. 11). SI units.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from padgen.physics.magnetics import MU_0, CoilSource, SteelRing, flux_density

__all__ = ["RootLines", "remanent_current", "root_lines"]

POINTS = 4096
"""Phases over which the mean of a root is taken: enough for three digits."""


def remanent_current(
    coil: CoilSource, washer: SteelRing, gap: float, offset: np.ndarray, washer_field: float, core_field: float
) -> np.ndarray:
    """Return ρ (n,) in A for pulls ∝ i² + ρ i on remanent washers, `offset` (n,) m off a coil's axis and `gap` m away.

    `washer_field` and `core_field` in A/m are the shares of the coercivities that are kept. The coil's field at a
    washer is the root mean square of that in its plane, at the nearest and the farthest point of its middle line; in
    the core it is that in the middle of each winding without steel.
    """
    middle = (washer.outer_diameter + washer.inner_diameter) / 4
    at = np.abs(offset + np.array([[-1.0], [1.0]]) * middle)
    radial, _ = flux_density(coil, np.maximum(at, 1e-6 * middle), np.full_like(at, gap))
    applied = np.sqrt((radial**2).mean(0)) / MU_0
    in_core = sum(
        winding.turns / sqrt(winding.length**2 + ((winding.outer_diameter + winding.inner_diameter) / 2) ** 2)
        for winding in coil.windings
    )
    of_core = core_field / in_core if coil.core_diameter else 0.0
    return np.asarray(np.divide(washer_field, applied, out=np.zeros(len(applied)), where=applied > 0) + of_core)


class RootLines(NamedTuple):
    """Spectral lines of √(wanted force): peaks (n,) in A at the wanted frequencies, root sum square of all others."""

    wanted: np.ndarray
    others: float


def root_lines(line: np.ndarray, headroom: float) -> RootLines:
    """Return the lines of ``√(a₀ + Σ a cos θ)``, a₀ = (1 + `headroom`) Σ a, a being `line` (n,) in A², θ any phases."""
    # Phases of an additive recurrence, evenly spread in n dimensions (Roberts, 2018).
    count = len(line)
    base = 2.0
    for _ in range(60):
        base = (1 + base) ** (1 / (count + 1))
    phase = 2 * np.pi * np.arange(1, POINTS + 1)[:, None] * base ** -np.arange(1.0, count + 1)
    cosine = np.cos(phase)
    constant = (1 + headroom) * line.sum()
    root = np.sqrt(np.maximum(constant + cosine @ line, 0.0))
    wanted = 2 * (root[:, None] * cosine).mean(0)
    rest = (root**2).mean() - root.mean() ** 2 - (wanted**2).sum() / 2
    return RootLines(wanted, sqrt(max(2 * rest, 0.0)))
