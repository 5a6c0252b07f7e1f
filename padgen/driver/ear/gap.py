"""Taxels whose pull grows as the gap closes: ``F = c i² (g/(g − z))^p``, stepped in time, all taxels at once.

z is the washer's motion from where it hangs. Each mode moves by its exact transition with the pull linear between
the steps (first-order hold); what that takes off a line of i² is given back to it beforehand. The pull at a step's
end is the one at the motion that the step predicts, whose error is of third order in the step.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from padgen.driver.ear.motion import HeardTaxel

__all__ = ["STEPS_PER_PERIOD", "GapTaxels", "gap_taxels", "held_squares", "step_gap"]

STEPS_PER_PERIOD = 32
"""Steps in a period of the highest line, at least."""
NEAREST = 0.99
"""Share of the gap at which a washer counts as pulled onto the coil; there it is followed no further."""
BLOCK = 1024


class GapTaxels(NamedTuple):
    """Taxels (n,) with modes (k,), padded with modes that do not move, and the steps' coefficients (n, k)."""

    gain: np.ndarray
    rest_m: np.ndarray
    gap_m: np.ndarray
    exponent: np.ndarray
    keep: np.ndarray
    before: np.ndarray
    after: np.ndarray


def gap_taxels(taxels: Sequence[HeardTaxel], gap_m: np.ndarray, exponent: np.ndarray, step_s: float) -> GapTaxels:
    """What steps of `step_s` need, for taxels that hang `gap_m` (n,) above the coil."""
    most = max(len(taxel.frequency_hz) for taxel in taxels)
    shape = len(taxels), most
    gain, keep, before, after = np.zeros((*shape, 3)), *(np.zeros(shape, complex) for _ in range(3))
    for i, taxel in enumerate(taxels):
        pole, k = taxel.pole, len(taxel.frequency_hz)
        first, second = _phi(pole * step_s)
        # What is kept is y/ω²: for s linear from a to b, y' = p y + s adds h ((φ₁ − φ₂) a + φ₂ b).
        gain[i, :k] = taxel.gain_m * (taxel.omega**2 / pole.imag)[:, None]
        keep[i, :k] = np.exp(pole * step_s)
        before[i, :k], after[i, :k] = step_s * (first - second), step_s * second
    rest_m = np.array([taxel.rest_m for taxel in taxels])
    return GapTaxels(gain, rest_m, gap_m, np.maximum(exponent, 0.0), keep, before, after)


def _phi(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``(e^z − 1)/z`` and ``(e^z − 1 − z)/z²``."""
    term, first, second = np.ones_like(z), np.zeros_like(z), np.zeros_like(z)
    for k in range(1, 24):
        first = first + term / k
        second = second + term / (k * (k + 1))
        term = term * z / k
    small = np.abs(z) < 1
    safe = np.where(small, 1.0, z)
    grown = np.expm1(safe)
    return np.where(small, first, grown / safe), np.where(small, second, (grown - safe) / safe**2)


def held_squares(lines_a2: np.ndarray, points: int, steps_per_s: float, step_hz: float) -> np.ndarray:
    """i² (points,) at the steps such that a line through them, held linearly, has the lines (m,) of `step_hz` apart."""
    from scipy.fft import irfft

    lines = np.array(lines_a2[: points // 2])
    lines /= np.sinc(np.arange(len(lines)) * (step_hz / steps_per_s)) ** 2
    lines[1:] /= 2
    return np.asarray(irfft(lines, points, norm="forward"))


def step_gap(
    taxels: GapTaxels, square_a2: np.ndarray, column: np.ndarray, loops: bool, state: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Felt motion (n, 3, s) in m and which (n,) are pulled onto the coil, for blocks of steps of i² (steps, coils).

    `column` (n,) tells each taxel's coil. `state` (n, k), over ω², is the one at the first step, and is changed into
    the one a step after the last, where i² is the first again if it `loops`, else as at the last.
    """
    vertical = np.ascontiguousarray(taxels.gain[..., 0])
    at_once = (vertical * taxels.after.imag).sum(1) + taxels.rest_m[:, 0]
    near = _closeness(taxels, (vertical * state.imag).sum(1) + taxels.rest_m[:, 0] * square_a2[0][column])
    pull = square_a2[0][column] * near
    last = len(square_a2)
    for start in range(0, last, BLOCK):
        stop = min(start + BLOCK, last)
        swing, pulls = np.empty((stop - start, *state.shape)), np.empty((stop - start, len(state)))
        after = np.append(np.arange(start + 1, stop), stop if stop < last else 0 if loops else last - 1)
        for k, square in enumerate(square_a2[after][:, column]):
            swing[k], pulls[k] = state.imag, pull
            lead = taxels.keep * state
            lead += taxels.before * pull[:, None]
            # The motion at the end of the step, pulled as strongly as at its beginning.
            near = _closeness(taxels, (vertical * lead.imag).sum(1) + at_once * (square * near))
            pull = square * near
            np.add(lead, taxels.after * pull[:, None], out=state)
        felt = np.einsum("skj,kjp->kps", swing, taxels.gain, optimize=True)
        felt += taxels.rest_m[:, :, None] * pulls.T[:, None]
        yield felt, (felt[:, 0] >= NEAREST * taxels.gap_m[:, None]).any(1)


def _closeness(taxels: GapTaxels, z_m: np.ndarray) -> np.ndarray:
    share: np.ndarray = (1 - np.minimum(z_m / taxels.gap_m, NEAREST)) ** -taxels.exponent
    return share
