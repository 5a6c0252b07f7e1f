"""Recoil of the rigid pad on its mount: taxels that are ON shake the pad, and the pad's motion shakes every taxel.

A taxel's working mode has the motion u of its washer relative to the pad, the modal mass m for it, and the momentum g
(force and moments about the pad's centre of mass, six numbers) for unit velocity. The coil stands on the same pad, so
that pull and reaction cancel in the six motions x of the whole. Lagrange's equations for the kinetic energy
``½ xᵀ M x + Σ xᵀ g u + ½ Σ m u²`` (velocities meant), with M the rigid mass of everything on the mount, are

    ``m (u'' + ω₀/Q u' + ω₀² u) = F − gᵀ x''``        ``M x'' + C x' + K x = −Σ g u''``

and for motion at an angular frequency ω, with ``D = m (ω₀² − ω² + j ω ω₀/Q)`` and ``Z = K + j ω C − ω² M``,

    ``u = (F + ω² gᵀ x) / D``        ``(Z − ω⁴ Σ g gᵀ/D) x = ω² Σ g F/D``.

The sum on the left is the load that resonating taxels are for the pad. Without it, and with vertical motion alone, N
equal taxels of mass m that move together shake a loose pad of mass M by N m/M of their own motion, and a taxel of the
same resonance that is OFF moves by Q times that. Rigid body with elastic supports and appendages: Harris and Piersol,
Harris' Shock and Vibration Handbook, 5th edition, 2002, chapters 3 and 6.

The sign of each ON taxel's motion is free. `balanced_signs` chooses them so that forces and moments cancel: the largest
first, each against what is left (largest differencing, after Karmarkar and Karp, 1982), then single and paired flips as
long as these lower the rest. A taxel that vibrates already turns over only where that lowers it by enough.
"""

from typing import NamedTuple

import numpy as np

from padgen.physics.modes import RigidBody

__all__ = ["Base", "MovingPad", "MovingTaxels", "balanced_signs", "rigid_mass", "support_stiffness"]


class Base(NamedTuple):
    """The rigid pad on its mount in SI units, in its six motions: x, y, z, and turns about these axes.

    `mass` (6, 6) is of everything on the mount, taxels at rest included, about the centre of mass; `stiffness` (6,) and
    `damping` (6,) are the mount's there.
    """

    mass: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray


class MovingTaxels(NamedTuple):
    """Working modes of n taxels in SI units: load on the pad per washer acceleration, modal mass, resonance and Q.

    `momentum` (n, 6) is force and moment about the pad's centre of mass per unit acceleration of the washer against the
    pad; `mass` (n,) the modal mass, `resonance_hz` (n,) and `q` (n,) those on a clamped pad.
    """

    momentum: np.ndarray
    mass: np.ndarray
    resonance_hz: np.ndarray
    q: np.ndarray

    def stiffness(self, hz: float) -> np.ndarray:
        """Return the dynamic stiffness (n,) in N/m of the taxels on a clamped pad: complex."""
        omega = 2 * np.pi * hz
        omega_0 = 2 * np.pi * self.resonance_hz
        return np.asarray(self.mass * (omega_0**2 - omega**2 + 1j * omega * omega_0 / self.q))


def rigid_mass(body: RigidBody) -> np.ndarray:
    """Return the mass matrix (6, 6) of a rigid body about its centre of mass."""
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = body.mass * np.eye(3)
    matrix[3:, 3:] = body.inertia
    return matrix


def support_stiffness(vertical: float, width: float, depth: float, height: float, shear: float) -> np.ndarray:
    """Return the stiffness (6,) of an even elastic layer below a pad of `width` × `depth` m.

    `vertical` is the layer's stiffness in N/m, `shear` that of a shift over it; the layer lies `height` m below the
    centre of mass. The coupling of shift and tilt is left out.
    """
    across = shear * vertical
    return np.array(
        [
            across,
            across,
            vertical,
            vertical * depth**2 / 12 + across * height**2,
            vertical * width**2 / 12 + across * height**2,
            across * (width**2 + depth**2) / 12,
        ]
    )


class MovingPad:
    """Coupled motion of the pad and its taxels at one frequency in Hz, under given forces between coils and taxels."""

    def __init__(self, base: Base, taxels: MovingTaxels, hz: float) -> None:
        omega = 2 * np.pi * hz
        self.momentum = taxels.momentum
        self.dynamic = taxels.stiffness(hz)
        impedance = np.diag(base.stiffness + 1j * omega * base.damping) - omega**2 * base.mass
        load = omega**4 * (self.momentum.T / self.dynamic) @ self.momentum
        self.square = omega**2
        self.compliance = np.linalg.inv(impedance - load)

    def base_motion(self, force: np.ndarray) -> np.ndarray:
        """Return the pad's complex motion (…, 6) in m and rad under forces (…, n) in N between coils and taxels."""
        clamped = force / self.dynamic
        return np.asarray(self.square * (clamped @ self.momentum) @ self.compliance.T)

    def relative_motion(self, force: np.ndarray) -> np.ndarray:
        """Return the taxels' complex motion (…, n) in m against the pad, under forces (…, n) in N."""
        shaken = self.square * self.base_motion(force) @ self.momentum.T
        return np.asarray((force + shaken) / self.dynamic)

    def listening_matrix(self, listeners: np.ndarray) -> np.ndarray:
        """Return R (≤ 6, 6): ``|R p|²`` is the mean square motion in m² of taxels `listeners` under the drive p (6,).

        p (6,) is ``Σ g F/D``, the momentum of the driven taxels over jω.
        """
        moved = self.square**2 * (self.momentum[listeners] / self.dynamic[listeners, None]) @ self.compliance
        return np.asarray(np.linalg.qr(moved / max(len(listeners), 1) ** 0.5, mode="r"))


def balanced_signs(parts: np.ndarray, kept: np.ndarray | None = None, turn: float | None = None) -> np.ndarray:
    """Return n signs, +1 or −1, so chosen that the sum of `parts` (n, d), each row times its sign, is small.

    Signs that `kept` (n,) has already (not 0) stay, but where another lowers the sum's square by more than a share
    `turn` of the largest part's (None: `TURN`). The same input gives the same signs.

    >>> balanced_signs(np.array([[1.0], [1.0], [2.0], [1.0]])).tolist()
    [-1.0, -1.0, 1.0, 1.0]
    """
    real = np.concatenate([parts.real, parts.imag], 1)
    sizes = (real**2).sum(1)
    signs = np.zeros(len(parts)) if kept is None else np.sign(np.asarray(kept, float))
    free = np.flatnonzero(signs == 0)
    largest = max(float(sizes.max(initial=0.0)), np.finfo(float).tiny)
    price = (TURN if turn is None else turn) * largest * signs
    least = FLIP * largest
    rest = signs @ real
    for i in free[np.argsort(-sizes[free].round(ROUND - _digits(sizes)), kind="stable")]:
        signs[i] = -1.0 if real[i] @ rest > least else 1.0
        rest = rest + signs[i] * real[i]
    gram = real @ real.T if len(parts) <= MOST_PAIRED else None
    for _ in range(MOST_FLIPS * len(parts)):
        # The price of a kept sign is paid when it turns, and paid back when it turns back.
        gain = 4 * (sizes - signs * (real @ (signs @ real))) + price * signs
        if gram is None:
            i = int((gain / least).round().argmin())
            if gain[i] >= -least:
                break
            signs[i] *= -1.0
            continue
        pairs = gain[:, None] + gain + 8 * np.outer(signs, signs) * gram
        # One alone stands on the diagonal.
        np.fill_diagonal(pairs, gain)
        i, j = np.unravel_index(int((pairs / least).round().argmin()), pairs.shape)
        if pairs[i, j] >= -least:
            break
        signs[i] *= -1.0
        if i != j:
            signs[j] *= -1.0
    return signs


ROUND = 9
FLIP = 1e-9
"""Digits of a size that count, and the share of the largest by which a flip must improve the rest: so that rounding on
another machine changes no sign."""
TURN = 0.1
"""Share of the largest part's square by which a kept sign must lower the rest's to turn: docs/recoil.md has others."""
MOST_FLIPS = 4
MOST_PAIRED = 48
"""Flips for each taxel, at most; and the most taxels of which pairs are flipped: of more, single flips leave little."""


def _digits(sizes: np.ndarray) -> int:
    largest = float(sizes.max(initial=0.0))
    return int(np.floor(np.log10(largest))) if largest > 0 else 0
