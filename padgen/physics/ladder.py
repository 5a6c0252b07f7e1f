"""Number and frequencies of the channels that fit a band (paper Eq. 6-12)."""

from math import atanh, exp, floor, inf, log

import numpy as np

__all__ = ["capacity", "geometric_ladder", "ladder_ratio", "paper_ladder", "slot_half_width", "whole_channels"]


def slot_half_width(q: float, delta_y: float) -> float:
    """Return half the relative width of a slot, ``a = Δy/(4Q)``; 1 or more means no capacity at all."""
    return delta_y / (4 * q)


def ladder_ratio(q: float, delta_y: float) -> float:
    """Return the smallest ratio of neighbouring resonances, ``(1+a)/(1−a)``; infinite where a ≥ 1."""
    a = slot_half_width(q, delta_y)
    return (1 + a) / (1 - a) if a < 1 else inf


def capacity(low_hz: float, high_hz: float, q: float, delta_y: float) -> float:
    """Return the number of channels of one coil by the paper's bound (Eq. 12), not rounded down.

    ``n = ln(f_hi/f_lo) / (2 artanh a)``; the artanh does not cancel at large Q.

    >>> capacity(20, 1000, q=15, delta_y=10)
    11.626584840139861
    """
    a = slot_half_width(q, delta_y)
    return log(high_hz / low_hz) / (2 * atanh(a)) if a < 1 else 0.0


def paper_ladder(low_hz: float, count: int, q: float, delta_y: float) -> np.ndarray:
    """Return `count` resonances in Hz at the closest spacing, with the lower edge of the lowest slot at `low_hz`."""
    a = slot_half_width(q, delta_y)
    return low_hz / (1 - a) * ladder_ratio(q, delta_y) ** np.arange(count)


def geometric_ladder(lowest_hz: float, highest_hz: float, count: int) -> np.ndarray:
    """Return `count` resonances in Hz, evenly spaced in octaves from `lowest_hz` to `highest_hz`."""
    if count == 1:
        return np.array([(lowest_hz * highest_hz) ** 0.5])
    return lowest_hz * exp(log(highest_hz / lowest_hz) / (count - 1)) ** np.arange(count)


def whole_channels(capacity_: float) -> int:
    """Return the capacity rounded down; a capacity that is whole but for rounding counts as whole."""
    return floor(capacity_ * (1 + 1e-12))
