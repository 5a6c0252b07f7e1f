"""Sums over the filaments of a board coil's drawn tracks: its length, inductance and force, by Neumann and Biot-Savart.

Nothing of padgen's formulas is used, only the tracks that are made: R and L of the circles that padgen sums, and the
force of its flat windings, must be those of the copper.
"""

import numpy as np

MU_0_4PI = 1e-7


def points_of(track, step_mm):
    """Return points (n, 2) in mm along a track, a step apart at most."""
    a, b = np.array(track.start_mm), np.array(track.end_mm)
    if track.middle_mm is None:
        count = max(1, int(np.ceil(np.hypot(*(b - a)) / step_mm)))
        return a + (b - a) * np.linspace(0, 1, count + 1)[:, None]
    m = np.array(track.middle_mm)
    centre = np.linalg.solve(2 * np.array([m - a, b - a]), [m @ m - a @ a, b @ b - a @ a])
    first, half = (np.arctan2(*(p - centre)[::-1]) for p in (a, m))
    half = (half - first + np.pi) % (2 * np.pi) - np.pi
    radius = np.hypot(*(a - centre))
    count = max(1, int(np.ceil(2 * abs(half) * radius / step_mm)))
    angle = first + 2 * half * np.linspace(0, 1, count + 1)
    return centre + radius * np.stack([np.cos(angle), np.sin(angle)], -1)


class Filaments:
    """Short straight pieces of a coil's tracks, in m, in the direction of the current."""

    def __init__(self, coil, tracks, shares, step_mm):
        middles, steps, layers = [], [], []
        for track in tracks:
            way = points_of(track, step_mm) * 1e-3
            depth = coil.depth[track.layer] + coil.copper[track.layer] / 2
            # Tracks are drawn outwards, but for links in the bore; the current goes inwards on upper layers of a pair.
            way = way[::-1] if track.layer % 2 == 0 else way
            way = np.column_stack([way, np.full(len(way), -depth)])
            middles.append((way[1:] + way[:-1]) / 2)
            steps.append(way[1:] - way[:-1])
            layers += [track.layer] * (len(way) - 1)
        self.middle = np.concatenate(middles)
        self.step = np.concatenate(steps)
        self.layer = np.array(layers)
        self.length = np.linalg.norm(self.step, axis=1)
        self.current = np.asarray(shares)[self.layer]
        self.copper = np.array(coil.copper)[self.layer]
        self.width = coil.track

    def resistance(self, ohm_m):
        return float((ohm_m * self.length / (self.width * self.copper) * self.current**2).sum())

    def inductance(self):
        """Double sum of Neumann; pieces near each other are integrated exactly as parallel lines."""
        mean = 0.2235 * (self.width + self.copper)
        longest = self.length.max()
        radius = np.hypot(self.middle[:, 0], self.middle[:, 1])
        total = 0.0
        for k in range(0, len(self.middle), 400):
            some = slice(k, k + 400)
            away = self.middle[some, None] - self.middle
            # Within a turn the distance is the section's own mean one; turns beside it are as far as their middles.
            alike = (self.layer[some, None] == self.layer) & (np.abs(radius[some, None] - radius) < self.width)
            kernel = 1 / np.sqrt((away**2).sum(-1) + alike * mean[some, None] ** 2 + ~alike * 1e-14)
            i, j = np.nonzero(kernel > 1 / (3 * longest))
            unit = self.step[some][i] / self.length[some][i][:, None]
            along = np.abs((away[i, j] * unit).sum(1))
            beside2 = np.maximum((away[i, j] ** 2).sum(1) - along**2, 0.0) + alike[i, j] * mean[some][i] ** 2
            half = (self.length[some][i] + self.length[j]) / 2
            beside = np.sqrt(np.maximum(beside2, 1e-14))
            kernel[i, j] = (
                _lines(along + half, beside) + _lines(np.abs(along - half), beside) - 2 * _lines(along, beside)
            ) / half**2
            flow = self.current[some][:, None] * (self.step[some] @ self.step.T) * self.current
            total += float((flow * kernel).sum())
        return MU_0_4PI * total

    def force(self, magnet):
        """Force in N/A up on the coil of a magpylib magnet, which is that down on the magnet."""
        field = magnet.getB(self.middle)
        return float((np.cross(self.step, field)[:, 2] * self.current).sum())


def _lines(x, beside):
    return x * np.arcsinh(x / beside) - np.sqrt(x * x + beside * beside)
