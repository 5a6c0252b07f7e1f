"""The pad of a plan as a body that its ON taxels shake: on its mount, with the signs that keep it still.

Counted are the working modes of all taxels, and the six motions of the pad with everything that is fastened to it. A
pad that lies loose is taken as free: the stiffness of skin, foam or feet counts where the mount gives it. It is then an
even layer below the pad, a third as stiff in shear, with one quality factor for all motions. A base plate is a slab of
steel of the pad's outline.

The current's squared lines are those of the driver table, so that taxels of a channel move in phase over all coils,
where their signs do not differ. Leakage from the coils around counts as what it is in the plan at most
(`Reuse.retuned_leaks_db`), on a pad that does not move, too; spurs are not counted here.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import SpecError
from padgen.core.units import GRAM, MM
from padgen.physics.modes import RigidBody, box, combine
from padgen.physics.recoil import Base, MovingPad, MovingTaxels, balanced_signs, rigid_mass, support_stiffness
from padgen.planner.pad_mass import IRON_KG_PER_M3, PadMass
from padgen.planner.plan import Plan

__all__ = ["LOST_DB", "Mount", "Recoil", "ShakenPad", "chance_images", "pad_recoil"]

SHEAR_SHARE = 1 / 3
"""Stiffness of a soft layer against a shift over that against pressure: E/3 over E where it does not change volume."""
MOUNT_Q = 2.0
"""Quality factor on skin, foam or feet where the spec gives none: soft layers lose half of the energy in a cycle."""
LOST_DB = 2.0
"""Loss by recoil up to which there is no finding."""
IMAGES = 100
BASES_G = (50.0, 100.0, 200.0, 400.0, 800.0, 1600.0, 3200.0, 6400.0)
"""Masses of a base plate that are tried, the lightest first."""


@dataclass(frozen=True)
class Mount:
    """The place of a pad in use: what holds it, and what is below it.

    `kind` is 'resting', 'skin' or 'foam', on which it lies loose, or 'screwed' or 'glued': fastened to the base, which
    does not move where it has no mass. `base_mass_g` is the mass in g of a plate below pad and tray that moves with
    them, `stiffness_n_per_m` that of skin, foam or feet below all of it (None: loose), and `q` the quality factor of
    the vertical motion on that stiffness.
    """

    kind: str = "resting"
    base_mass_g: float | None = None
    stiffness_n_per_m: float | None = None
    q: float | None = None

    def __post_init__(self) -> None:
        for name in ("base_mass_g", "stiffness_n_per_m", "q"):
            value = getattr(self, name)
            least = 0.0 if name == "base_mass_g" else SMALLEST
            if value is not None and not least <= value <= LARGEST:
                raise SpecError(f"must be {least:g} … {LARGEST:g}, got {value:g}", name)
        if self.kind not in KINDS:
            raise SpecError(f"must be one of {', '.join(KINDS)}, got {self.kind!r}", "kind")
        if self.q is not None and self.stiffness_n_per_m is None:
            raise SpecError(f"is of the motion on stiffness_n_per_m, which is absent; got {self.q:g}", "q")

    @property
    def is_fast(self) -> bool:
        """True where the pad is fastened to a base that does not move."""
        fastened = self.kind in ("screwed", "glued")
        return fastened and self.base_mass_g is None and self.stiffness_n_per_m is None


KINDS = ("resting", "skin", "foam", "screwed", "glued")
SMALLEST = 1e-3
LARGEST = 1e12
"""Bounds of a mount's stiffness and quality factor, and of its mass above 0."""
RESTING = Mount()


@dataclass(frozen=True, slots=True)
class Recoil:
    """The recoil of the pad: how much its ON taxels shake it, and what OFF taxels hear of that.

    `pad_g` is the mass of pad, washers, tray, coils and screws, `moving_g` that of everything on the mount, its
    base included; None where that does not move. The dB are the smallest ON over the largest OFF amplitude in the
    worst of `images` images by chance: `clamped_db` on a pad that does not move, `in_step_db` on the moving one, as
    drives have it, `signed_db` with signs that keep the pad still. None where no image has taxels that are OFF.
    Glued to a plate of `base_g`, the pad loses at most 2 dB; 0 where it does so as it is, None where the heaviest
    plate that was tried is not enough.

    What moves on the mount reaches down to `lowest_mm` from the pad's underside, has its centre of mass at `centre_mm`
    and the `moments_g_mm2` (3, 3) about it. For unit acceleration of its washer upwards against the pad, a channel's
    working mode takes the forces `momenta_g` (n, 3) and, about the washer's axis at the pad's underside, the moments
    `momenta_g_mm` (n, 3), in the taxel's own axes.
    """

    pad_g: float
    moving_g: float | None
    images: int
    clamped_db: float | None
    in_step_db: float | None
    signed_db: float | None
    base_g: float | None
    lowest_mm: float = 0.0
    centre_mm: tuple[float, ...] = ()
    moments_g_mm2: tuple[tuple[float, ...], ...] = ()
    momenta_g: tuple[tuple[float, ...], ...] = ()
    momenta_g_mm: tuple[tuple[float, ...], ...] = ()

    @property
    def lost_db(self) -> float:
        """Loss in dB of the worst image by recoil, with signs that keep the pad still."""
        return 0.0 if self.clamped_db is None or self.signed_db is None else self.clamped_db - self.signed_db


class HeardImages(NamedTuple):
    """Of each image: the smallest ON amplitude over the planned one, the largest OFF one over that taxel's when ON."""

    on: np.ndarray
    off: np.ndarray

    @property
    def db(self) -> np.ndarray:
        """ON over OFF in dB; infinite where nothing is heard."""
        with np.errstate(divide="ignore"):
            return np.asarray(20 * np.log10(self.on / self.off))


class ShakenPad:
    """The pad of a plan on a mount."""

    def __init__(self, plan: Plan, mount: Mount = RESTING, masses: PadMass | None = None) -> None:
        self.plan = plan
        self.mount = mount
        self.masses = masses or PadMass(plan)
        channel_of = np.array([taxel.channel for taxel in plan.taxels])
        self.channel_of = channel_of
        columns = plan.coils.columns
        self.coil_of = np.array([taxel.coil[0] * columns + taxel.coil[1] for taxel in plan.taxels])
        figures = [(c.effective_mass_g * GRAM, c.resonance_hz, c.q, c.force_constant_n_per_a2) for c in plan.channels]
        mass, hz, q, pull = np.array(figures).T[:, channel_of]
        self.line_a2 = np.array([channel.line_a2 for channel in plan.channels])
        self.pull = pull
        self.body = self._whole()
        self.taxels = MovingTaxels(self.masses.momenta(self.body.centroid), mass, hz, q)
        self.hz = np.array([channel.resonance_hz for channel in plan.channels])
        # What each taxel does when it alone is ON, on a clamped pad: the unit of its levels.
        force = pull * self.line_a2[channel_of]
        dynamic = np.array([self.taxels.stiffness(float(f)) for f in self.hz])
        self.unit = np.abs(force / dynamic[channel_of, np.arange(len(force))])
        leaks_db = plan.reuse.retuned_leaks_db or (None,) * len(plan.channels)
        leak = np.array([0.0 if db is None else 10 ** (-db / 10) for db in leaks_db])
        self.leak = leak[channel_of]

    def _whole(self) -> RigidBody:
        """Return everything on the mount as one body."""
        base_kg = (self.mount.base_mass_g or 0.0) * GRAM
        if not base_kg:
            return self.masses.whole
        half_x, half_y = self.half_m
        top = -self.masses.height_mm * MM
        slab = box((-half_x, -half_y, self.lowest_m), (half_x, half_y, top), IRON_KG_PER_M3)
        return combine(self.masses.whole, slab)

    @property
    def half_m(self) -> tuple[float, float]:
        """Half the pad's outline along x and y."""
        pad = self.plan.spec.pad
        return (pad.width_mm / 2 + pad.border_mm) * MM, (pad.depth_mm / 2 + pad.border_mm) * MM

    @property
    def lowest_m(self) -> float:
        """Height of the lowest face above the pad's underside: negative."""
        half_x, half_y = self.half_m
        base_kg = (self.mount.base_mass_g or 0.0) * GRAM
        return -self.masses.height_mm * MM - base_kg / (4 * half_x * half_y * IRON_KG_PER_M3)

    @property
    def moving_kg(self) -> float | None:
        """Mass of everything on the mount; None where it does not move."""
        return None if self.mount.is_fast else float(self.body.mass)

    @cached_property
    def base(self) -> Base:
        """The body on its mount."""
        mass = rigid_mass(self.body)
        vertical = self.mount.stiffness_n_per_m
        if vertical is None:
            return Base(mass, np.zeros(6), np.zeros(6))
        half_x, half_y = self.half_m
        arm = float(self.body.centroid[2]) - self.lowest_m
        stiffness = support_stiffness(vertical, 2 * half_x, 2 * half_y, arm, SHEAR_SHARE)
        damping = np.sqrt(stiffness * np.diag(mass)) / (self.mount.q or MOUNT_Q)
        return Base(mass, stiffness, damping)

    @cached_property
    def shaken(self) -> list[MovingPad]:
        """The moving pad at the tone of each channel."""
        return [MovingPad(self.base, self.taxels, float(hz)) for hz in self.hz]

    def force(self, channel: int, driven: np.ndarray) -> np.ndarray:
        """Return the forces (…, n) in N at a channel's tone for taxels `driven` (…, n), levels with signs.

        A tone pulls every washer over its coil.
        """
        playing = np.where(self.channel_of == channel, driven, 0.0) * self.line_a2[channel]
        coils = playing @ (self.coil_of[:, None] == np.arange(int(self.coil_of.max()) + 1))
        return np.asarray(self.pull * coils[..., self.coil_of])

    def signs(
        self, levels: np.ndarray, kept: np.ndarray | None = None, tones: np.ndarray | None = None, phase_rad: Any = 0.0
    ) -> np.ndarray:
        """Return signs (n,) for the ON taxels of an image of `levels` (n,), 0 for the others.

        Those of one tone balance each other in what its taxels hear of the pad. Signs that are `kept` (n,), not 0, stay
        where their taxels are ON. `tones` (n,) are alike for taxels that are driven at one frequency, by default those
        of a channel; `phase_rad` are those of the forces.
        """
        signs = np.zeros(len(levels))
        moving = self.taxels.momentum * (levels * np.exp(1j * np.asarray(phase_rad)))[:, None]
        tone_of = self.channel_of if tones is None else tones
        for tone in np.unique(tone_of):
            of_tone = np.flatnonzero(tone_of == tone)
            on = of_tone[levels[of_tone] > 0]
            if len(on):
                heard = self.heard[self.channel_of[of_tone[0]]]
                signs[on] = balanced_signs(moving[on] @ heard.T, None if kept is None else kept[on])
        return signs

    @cached_property
    def heard(self) -> list[np.ndarray]:
        """What the taxels of each channel hear of the pad at their tone: `padgen.physics.recoil.MovingPad.heard`."""
        return [self.shaken[c].heard(np.flatnonzero(self.channel_of == c)) for c in range(len(self.hz))]

    def listen(self, driven: np.ndarray, clamped: bool = False) -> HeardImages:
        """Return what is heard of images of signed levels `driven` (…, n)."""
        energy = np.broadcast_to(self.leak, driven.shape).copy()
        on = np.full(driven.shape, np.inf)
        for channel in range(len(self.hz)):
            force = self.force(channel, driven)
            shaken = self.shaken[channel]
            motion = np.abs(force / shaken.dynamic if clamped else shaken.relative_motion(force)) / self.unit
            playing = (self.channel_of == channel) & (driven != 0)
            np.divide(motion, np.abs(driven), out=on, where=playing)
            energy += np.where(playing, 0.0, motion) ** 2
        off = np.sqrt(np.where(driven != 0, 0.0, energy).max(-1))
        return HeardImages(on.min(-1), off)


def chance_images(count: int, images: int, seed: int = 33) -> np.ndarray:
    """Return images (images, count) of 0 and 1 by chance: from one taxel that is ON to all but one."""
    rng = np.random.default_rng(seed)
    levels = np.zeros((images, count))
    for image in levels:
        image[rng.permutation(count)[: rng.integers(1, max(count, 2))]] = 1.0
    return levels


def pad_recoil(plan: Plan, mount: Mount = RESTING, images: int = IMAGES) -> Recoil:
    """Return what the recoil of a plan's pad costs, in the worst of some images."""
    masses = PadMass(plan)
    pad = ShakenPad(plan, mount, masses)
    pad_g = float(masses.whole.mass) / GRAM
    moving_g = None if pad.moving_kg is None else pad.moving_kg / GRAM
    momenta = np.array([channel.momentum for channel in masses.channels])
    known = Recoil(
        pad_g,
        moving_g,
        0,
        None,
        None,
        None,
        None,
        lowest_mm=pad.lowest_m / MM,
        centre_mm=tuple((pad.body.centroid / MM).tolist()),
        moments_g_mm2=_rows(pad.body.inertia / GRAM / MM**2),
        momenta_g=_rows(momenta[:, :3] / GRAM),
        momenta_g_mm=_rows(momenta[:, 3:] / GRAM / MM),
    )
    if len(plan.taxels) < 2 or not (pad.unit > 0).all():
        return known
    shown = chance_images(len(plan.taxels), images)
    clamped = float(pad.listen(shown, clamped=True).db.min())
    if pad.mount.is_fast:
        return replace(known, images=images, clamped_db=clamped, in_step_db=clamped, signed_db=clamped, base_g=0.0)
    in_step = float(pad.listen(shown).db.min())
    signed = _signed_db(pad, shown)
    base_g = 0.0 if clamped - signed <= LOST_DB else None
    for tried_g in BASES_G:
        if base_g is not None:
            break
        if tried_g > (pad.mount.base_mass_g or 0.0):
            heavier = ShakenPad(plan, replace(pad.mount, kind="glued", base_mass_g=tried_g), masses)
            if clamped - _signed_db(heavier, shown) <= LOST_DB:
                base_g = tried_g
    return replace(known, images=images, clamped_db=clamped, in_step_db=in_step, signed_db=signed, base_g=base_g)


def _rows(table: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in table.tolist())


def _signed_db(pad: ShakenPad, shown: np.ndarray) -> float:
    """Return ON over OFF in dB of the worst image (k, n) that is shown with signs that keep the pad still."""
    return float(pad.listen(np.array([levels * pad.signs(levels) for levels in shown])).db.min())
