"""First looks at a measured spectrum: its largest peak and the noise of a point."""

import numpy as np

__all__ = ["point_noise", "rough_peak"]


def rough_peak(frequency: np.ndarray, size: np.ndarray) -> tuple[float, float]:
    """Frequency of the largest `size` (n,), and the width where it is above 1/√2 of that without a break."""
    top = int(size.argmax())
    lower = np.flatnonzero(size < size[top] / np.sqrt(2))
    low = frequency[lower[lower < top][-1] if (lower < top).any() else 0]
    high = frequency[lower[lower > top][0] if (lower > top).any() else -1]
    return float(frequency[top]), float(high - low)


def point_noise(data: np.ndarray) -> float:
    """Root mean square noise of a point (n,) by the median second difference, which few points of a peak do not move.

    Of complex data of both parts together; of real data, such as magnitudes, of one.
    """
    second = np.abs(data[2:] - 2 * data[1:-1] + data[:-2])
    # The median of a Rayleigh variable over its root mean square is √ln 2, that of a half-normal one 0.6745.
    share = np.sqrt(np.log(2)) if np.iscomplexobj(data) else 0.67448975
    return float(np.median(second) / share / np.sqrt(6))
