"""Acceleration of the rigid pad in time, under any pulls on its taxels: the coupled system of `padgen.physics.recoil`.

Taxels of one mass, resonance and Q shake the pad by their momenta alone: of a group with momenta G (n, 6) = U S Vᵀ the
sums v = Uᵀu count, at most six, and obey ``m (v'' + ω₀/Q v' + ω₀² v) + S Vᵀ x'' = Uᵀ F``. A pad without a mount has
``x'' = −M⁻¹ V S v''``, which leaves it out of the unknowns; else ``M x'' + C x' + K x + V S v'' = 0`` is joined. The
poles p of the whole are stepped exactly, ``y(t + T) = e^(pT) y(t) + ∫ e^(p(T−τ)) f(t + τ) dτ``, for forces that are
cubic between samples (exponential integrators: Cox and Matthews, J. Comput. Phys. 176, 2002, 430).
"""

import numpy as np

from padgen.physics.recoil import Base, MovingTaxels

__all__ = ["MOST_UNKNOWNS", "THROUGH", "WEIGHT", "WITHIN", "PadMotion", "most_unknowns"]

MOST_UNKNOWNS = 700
"""Unknowns whose poles take about half a minute to find."""
NEGLIGIBLE = 1e-9
"""Share of the largest momentum of a group below which a sum of motions does not shake the pad."""
# Where a step of 1 is integrated, exact to rounding for |p| up to 40, and the cubics there through its end and the
# three samples before, of which each is 1 at one of them.
WITHIN, WEIGHT = (np.polynomial.legendre.leggauss(32) + np.array([[1.0], [0.0]])) / 2
THROUGH = np.linalg.solve(np.vander([1.0, 0.0, -1.0, -2.0]).T, np.vander(WITHIN, 4).T)


class PadMotion:
    """The pad's acceleration (6, s) under samples of forces, block by block.

    `push` (n, k) are the taxels' forces in N for each of k inputs.
    """

    def __init__(self, base: Base, taxels: MovingTaxels, push: np.ndarray, rate_hz: float) -> None:
        mass, damping, stiffness, drive, shakes = _reduced(taxels, push)
        count = len(mass)
        is_loose = not base.stiffness.any()
        if is_loose:
            inverse = np.linalg.inv(base.mass)
            whole = np.diag(mass) - shakes @ inverse @ shakes.T
            lossy = np.diag(damping)
            spring = np.diag(stiffness)
            reads = -inverse @ shakes.T
        else:
            whole = np.block([[np.diag(mass), shakes], [shakes.T, base.mass]])
            lossy = np.diag(np.concatenate([damping, base.damping]))
            spring = np.diag(np.concatenate([stiffness, base.stiffness]))
            drive = np.concatenate([drive, np.zeros((6, drive.shape[1]))])
            reads = np.concatenate([np.zeros((6, count)), np.eye(6)], 1)
        size = len(whole)
        system = np.zeros((2 * size, 2 * size))
        system[:size, size:] = np.eye(size)
        system[size:, :size] = -np.linalg.solve(whole, spring)
        system[size:, size:] = -np.linalg.solve(whole, lossy)
        pushed = np.linalg.solve(whole, drive)
        poles, shapes = np.linalg.eig(system)
        enters = np.linalg.solve(shapes, np.concatenate([np.zeros(pushed.shape), pushed]).astype(complex))
        # Of a pair the real part is taken twice.
        kept = poles.imag >= 0
        twice = np.where(poles[kept].imag > 0, 2.0, 1.0)
        self.pole = poles[kept] / rate_hz
        self.enters = enters[kept] / rate_hz
        self.leaves = (reads @ shapes[size:, kept]) * (poles[kept] * twice)
        self.direct = reads @ pushed
        self.taps = np.exp(np.outer(self.pole, 1 - WITHIN)) * WEIGHT @ THROUGH.T
        self.memory = [np.zeros(THROUGH.shape[0] - 1, complex)] * len(self.pole)

    def acceleration(self, inputs: np.ndarray) -> np.ndarray:
        """Return the acceleration (6, s) in m/s² and rad/s² under the next samples (k, s) of the inputs."""
        from scipy.signal import lfilter

        felt = self.direct @ inputs
        for k, pole in enumerate(self.pole.tolist()):
            entering = self.enters[k] @ inputs
            moved, self.memory[k] = lfilter(self.taps[k], [1.0, -np.exp(pole)], entering, zi=self.memory[k])
            felt += (self.leaves[:, k, None] * moved).real
        return np.asarray(felt)


def most_unknowns(taxels: MovingTaxels) -> int:
    """Return an upper bound on the number of independent combinations of taxel motions that shake the pad."""
    _, count = np.unique(np.stack([taxels.mass, taxels.resonance_hz, taxels.q]), axis=1, return_counts=True)
    return int(np.minimum(count, taxels.momentum.shape[1]).sum())


def _reduced(taxels: MovingTaxels, push: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return mass, damping, stiffness (r,), forces (r, k), momenta (r, 6) of r taxel combinations that shake a pad."""
    figures = np.stack([taxels.mass, taxels.resonance_hz, taxels.q])
    alike, group = np.unique(figures, axis=1, return_inverse=True)
    rows = []
    for index, (mass, hz, q) in enumerate(alike.T):
        members = np.flatnonzero(group.ravel() == index)
        sums, sizes, axes = np.linalg.svd(taxels.momentum[members], full_matrices=False)
        counts = sizes > NEGLIGIBLE * sizes[0]
        omega = 2 * np.pi * hz
        ones = np.ones(int(counts.sum()))
        forces = sums[:, counts].T @ push[members]
        shakes = sizes[counts, None] * axes[counts]
        rows.append((mass * ones, mass * omega / q * ones, mass * omega**2 * ones, forces, shakes))
    return tuple(np.concatenate(parts) for parts in zip(*rows, strict=True))
