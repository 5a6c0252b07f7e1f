"""Recoil of a plan's pad: a rigid body on its mount that ON taxels shake, and the signs of motion that balance it.

Counted are the working modes of all taxels, and the six motions of the pad with everything that is fastened to it. A
pad that lies loose is taken as free: the stiffness of skin, foam or feet counts where the mount gives it. It is then an
even layer below the pad, a third as stiff in shear, with one quality factor for all motions. A base plate is a slab of
steel of the pad's outline.

The current's squared lines are those of the driver table, so that taxels of a channel move in phase over all coils,
where their signs do not differ. Leakage from the coils around counts as what it is in the plan at most
(`Reuse.retuned_leaks_db`), on a pad that does not move, too; spurs are not counted here. Channels that take turns count
as playing at once.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from math import inf, isfinite
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import Finding, about, less_or_more_text
from padgen.core.units import GRAM, MM
from padgen.physics.modes import RigidBody, box, combine
from padgen.physics.recoil import Base, MovingPad, MovingTaxels, balanced_signs, rigid_mass, support_stiffness
from padgen.planner.pad_mass import IRON_KG_PER_M3, PadMass
from padgen.planner.plan import Plan, Prints, Recoil
from padgen.planner.printed_pads import leaked_energy
from padgen.planner.verdict import left_by_recoil_db, moving_pad_db, recoil_db, works_by_table
from padgen.spec import MountTable

__all__ = [
    "LOST_DB",
    "ShakenPad",
    "pad_recoil",
    "planned_recoil",
    "random_images",
    "recoil_energy",
    "recoil_findings",
]

SHEAR_SHARE = 1 / 3
"""Stiffness of a soft layer against a shift over that against pressure: E/3 over E where it does not change volume."""
MOUNT_Q = 2.0
"""Quality factor on skin, foam or feet where the spec gives none: soft layers lose half of the energy in a cycle."""
LOST_DB = 2.0
"""Loss by recoil up to which a base plate counts as heavy enough, where nothing else says so."""
IMAGES = 100
BASES_G = (50.0, 100.0, 200.0, 400.0, 800.0, 1600.0, 3200.0, 6400.0)
"""Masses of a base plate that are tried, the lightest first."""


class ImageAmplitudes(NamedTuple):
    """Smallest ON and largest OFF amplitude in each on/off image, divided by the same taxel's planned ON amplitude."""

    on: np.ndarray
    off: np.ndarray

    @property
    def db(self) -> np.ndarray:
        """ON over OFF in dB of each image; infinite where no OFF taxel moves."""
        with np.errstate(divide="ignore"):
            return np.asarray(20 * np.log10(self.on / self.off))


class ShakenPad:
    """The pad of a plan as a rigid body on a mount, which its ON taxels shake."""

    def __init__(self, plan: Plan, mount: MountTable | None = None, masses: PadMass | None = None) -> None:
        self.plan = plan
        self.mount = mount or plan.spec.mount
        self.masses = masses or PadMass(plan)
        channel_of = np.array([taxel.channel for taxel in plan.taxels])
        self.channel_of = channel_of
        columns = plan.coils.columns
        self.coil_of = np.array([taxel.coil[0] * columns + taxel.coil[1] for taxel in plan.taxels])
        figures = [(c.effective_mass_g * GRAM, c.resonance_hz, c.q, c.force_constant_n_per_a2) for c in plan.channels]
        mass, hz, q, pull = np.array(figures).T[:, channel_of]
        self.line_a2 = np.array([channel.line_a2 for channel in plan.channels])
        # Which tone drives each taxel, and with which complex line of i².
        self.tone_of = channel_of
        self.line = self.line_a2[channel_of]
        self.pull = pull
        self.body = self._whole()
        self.taxels = MovingTaxels(self.masses.momenta(self.body.centroid), mass, hz, q)
        self.hz = np.array([channel.resonance_hz for channel in plan.channels])
        # What each taxel does when it alone is ON, on a clamped pad: the unit of its levels.
        force = pull * self.line
        dynamic = np.array([self.taxels.stiffness(float(f)) for f in self.hz])
        self.unit = np.abs(force / dynamic[channel_of, np.arange(len(force))])
        self.leak = leaked_energy(plan)[1, channel_of]

    def _whole(self) -> RigidBody:
        """Return pad, washers, tray or board, coils, screws and any base plate as one rigid body."""
        base_kg = (self.mount.base_mass_g or 0.0) * GRAM
        if not base_kg:
            return self.masses.whole
        half_x, half_y = self.half_m
        top = -self.masses.height_mm * MM
        slab = box((-half_x, -half_y, self.lowest_m), (half_x, half_y, top), IRON_KG_PER_M3)
        return combine(self.masses.whole, slab)

    @property
    def half_m(self) -> tuple[float, float]:
        """Half the width and half the depth in m of the pad's outline, border included."""
        pad = self.plan.spec.pad
        return (pad.width_mm / 2 + pad.border_mm) * MM, (pad.depth_mm / 2 + pad.border_mm) * MM

    @property
    def lowest_m(self) -> float:
        """Height (negative) of the lowest face of tray, coils or base from the pad's underside."""
        half_x, half_y = self.half_m
        base_kg = (self.mount.base_mass_g or 0.0) * GRAM
        return -self.masses.height_mm * MM - base_kg / (4 * half_x * half_y * IRON_KG_PER_M3)

    @property
    def moving_kg(self) -> float | None:
        """Mass of everything on the mount; None where that does not move."""
        return None if self.mount.is_immovable else float(self.body.mass)

    @cached_property
    def base(self) -> Base:
        """Mass, stiffness and damping of the rigid pad on its mount."""
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
        """The coupled model of rigid pad and taxels at the frequency of each tone."""
        return [MovingPad(self.base, self.taxels, float(hz)) for hz in self.hz]

    def force(self, tone: int, driven: np.ndarray) -> np.ndarray:
        """Return the forces (…, n) in N on all taxels at one tone, with taxels driven at signed levels (…, n).

        A tone pulls every washer over its coil.
        """
        of_tone = np.flatnonzero(self.tone_of == tone)
        playing = driven[..., of_tone] * self.line[of_tone]
        coils = np.zeros((*playing.shape[:-1], int(self.coil_of.max()) + 1), playing.dtype)
        np.add.at(np.moveaxis(coils, -1, 0), self.coil_of[of_tone], np.moveaxis(playing, -1, 0))
        return np.asarray(self.pull * coils[..., self.coil_of])

    def signs(self, levels: np.ndarray, kept: np.ndarray | None = None, turn: float | None = None) -> np.ndarray:
        """Return signs of motion (n,) for taxels at `levels` (n,), so that their recoils cancel best; 0 for OFF taxels.

        Those of one tone balance each other in what its taxels hear of the pad. Signs that are `kept` (n,), not 0, stay
        where their taxels are ON and others would not help enough (`padgen.physics.recoil.balanced_signs`).
        """
        signs = np.zeros(len(levels))
        force = self.pull * self.line * levels
        for tone, heard in enumerate(self.heard):
            on = np.flatnonzero((self.tone_of == tone) & (levels > 0))
            moving = self.taxels.momentum[on] * (force[on] / self.shaken[tone].dynamic[on])[:, None]
            signs[on] = balanced_signs(moving @ heard.T, None if kept is None else kept[on], turn)
        return signs

    @cached_property
    def heard(self) -> list[np.ndarray]:
        """For each tone, the matrix from the driven taxels' momentum to the motion that the pad gives its taxels."""
        channels = [self.channel_of[np.argmax(self.tone_of == tone)] for tone in range(len(self.hz))]
        heard_by = [np.flatnonzero(self.channel_of == channel) for channel in channels]
        return [shaken.listening_matrix(listeners) for shaken, listeners in zip(self.shaken, heard_by, strict=True)]

    def listen_apart(self, shown: np.ndarray) -> ImageAmplitudes:
        """Return ON and OFF amplitudes of images of levels (k, n), each taxel driven at a separate frequency.

        The frequencies lie so near the channel's that the pad answers alike; what they move adds as energies. All
        taxels hear the pad; those of the same coil are pulled as well.
        """
        energy = np.broadcast_to(self.leak, shown.shape).copy()
        on = np.full(shown.shape, np.inf)
        momentum = self.taxels.momentum
        for channel, shaken in enumerate(self.shaken):
            of_channel = np.flatnonzero(self.channel_of == channel)
            square = shown[:, of_channel] ** 2
            driven, mate = self._coil_mates(of_channel)
            force = self.pull[mate] * self.line[of_channel[driven]]
            moving = np.zeros((len(of_channel), 6), complex)
            np.add.at(moving, driven, (force / shaken.dynamic[mate])[:, None] * momentum[mate])
            pad = shaken.square**2 * moving @ shaken.compliance.T
            per_unit = 1 / (np.abs(shaken.dynamic) * self.unit)
            products = (pad[:, :, None] * pad[:, None, :].conj()).reshape(len(pad), 36)
            shaking = (square @ products).reshape(-1, 6, 6).real
            energy += ((momentum @ shaking) * momentum).sum(-1) * per_unit**2
            by_pad = (pad[driven] * momentum[mate]).sum(1)
            motion = np.abs(force + by_pad) * per_unit[mate]
            more = motion**2 - (np.abs(by_pad) * per_unit[mate]) ** 2
            np.add.at(energy.T, mate, (square[:, driven] * more).T)
            on[:, of_channel] = motion[mate == of_channel[driven]]
        off = np.sqrt(np.where(shown != 0, 0.0, energy).max(-1))
        return ImageAmplitudes(np.where(shown != 0, on, np.inf).min(-1), off)

    def _coil_mates(self, taxels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return pairs (m,) of taxels over the same coil: one's index in `taxels` (i,), the other's on the pad."""
        by_coil = np.argsort(self.coil_of, kind="stable")
        sorted_coils = self.coil_of[by_coil]
        begin, end = (np.searchsorted(sorted_coils, self.coil_of[taxels], side) for side in ("left", "right"))
        many = end - begin
        driven = np.repeat(np.arange(len(taxels)), many)
        within = np.arange(len(driven)) - np.repeat(np.cumsum(many) - many, many)
        return driven, by_coil[np.repeat(begin, many) + within]

    def listen(self, driven: np.ndarray, clamped: bool = False) -> ImageAmplitudes:
        """Return ON and OFF amplitudes of images of signed levels `driven` (…, n); if `clamped`, the pad is still."""
        energy = np.broadcast_to(self.leak, driven.shape).copy()
        on = np.full(driven.shape, np.inf)
        for tone, shaken in enumerate(self.shaken):
            force = self.force(tone, driven)
            motion = np.abs(force / shaken.dynamic if clamped else shaken.relative_motion(force)) / self.unit
            playing = (self.tone_of == tone) & (driven != 0)
            np.divide(motion, np.abs(driven), out=on, where=playing)
            energy += np.where(playing, 0.0, motion) ** 2
        off = np.sqrt(np.where(driven != 0, 0.0, energy).max(-1))
        return ImageAmplitudes(on.min(-1), off)


def random_images(count: int, images: int, seed: int = 33) -> np.ndarray:
    """Return random images (images, count) of 0 and 1; in each, at least one taxel is ON and at least one OFF."""
    rng = np.random.default_rng(seed)
    levels = np.zeros((images, count))
    for image in levels:
        image[rng.permutation(count)[: rng.integers(1, max(count, 2))]] = 1.0
    return levels


def pad_recoil(plan: Plan, mount: MountTable | None = None, images: int = IMAGES) -> Recoil:
    """Return the pad's recoil in the worst of random images: by the drive table, re-tuned, and with balancing signs.

    The pad is on the `mount`, by default that of the plan's spec.
    """
    masses = PadMass(plan)
    pad = ShakenPad(plan, mount, masses)
    known = _recoil_without_signs(pad, images)
    if known.images == 0:
        return known
    shown = random_images(len(plan.taxels), images)
    known = replace(known, signed_db=known.clamped_db if pad.mount.is_immovable else _signed_db(pad, shown))

    def keeps(moving_db: float | None) -> bool:
        return _or_inf(known.clamped_db) - _or_inf(moving_db) <= LOST_DB

    return _with_base(known, pad, keeps, lambda heavier: _signed_db(heavier, shown), known.signed_db)


def planned_recoil(plan: Plan, prints: Prints) -> Recoil:
    """Return the recoil of a plan's pad, and the lightest base plate on which `prints` keep the asked selectivity."""
    pad = ShakenPad(plan)
    known = _recoil_without_signs(pad, IMAGES)
    planned = replace(plan, prints=prints, recoil=known)
    if known.images == 0 or moving_pad_db(planned) is None:
        return known

    shown = random_images(len(plan.taxels), IMAGES)
    listened = ShakenPad.listen if works_by_table(planned) else ShakenPad.listen_apart

    def heard_db(heavier: ShakenPad) -> float | None:
        return _worst(listened(heavier, shown))

    def keeps(moving_db: float | None) -> bool:
        kept_db = left_by_recoil_db(planned, moving_db)
        return kept_db is not None and kept_db >= plan.selectivity.asked_db

    return _with_base(known, pad, keeps, heard_db, recoil_db(planned))


def recoil_energy(plan: Plan) -> float:
    """Return the energy that recoil adds to an OFF taxel, divided by that of ON taxels, in the worst random image."""
    heard = _recoil_without_signs(ShakenPad(plan), IMAGES)
    if heard.apart_db is None:
        return 0.0
    still = 0.0 if heard.clamped_db is None else 10 ** (-heard.clamped_db / 10)
    return float(max(10 ** (-heard.apart_db / 10) - still, 0.0))


def recoil_findings(plan: Plan) -> Iterator[Finding]:
    """Yield a warning if the spec says how the pad is held and recoil leaves less selectivity than is asked."""
    recoil = plan.recoil
    left_db = moving_pad_db(plan)
    asked_db = plan.selectivity.asked_db
    if not plan.spec.mount.is_said or recoil.moving_g is None or left_db is None or left_db >= asked_db:
        return
    only = "only " if left_db > 0 else ""
    cures: tuple[dict[str, Any], ...] = ()
    if recoil.base_g is not None:
        cures = ({"mount.kind": "glued", "mount.base_mass_g": recoil.base_g},)
    yield Finding(
        "warning",
        "pad.recoil",
        "pad",
        f"taxels that are ON shake the pad ({about(recoil.moving_g)} g with all that moves with it), so that in"
        f" {plan.spec.print_share:.0%} of prints they vibrate {only}{less_or_more_text(-left_db)} than OFF ones (asked:"
        f" {asked_db:.1f} dB)",
        cures,
    )


def _recoil_without_signs(pad: ShakenPad, images: int) -> Recoil:
    """Return the recoil of a pad in random images, without balancing signs or a search for a base plate."""
    plan = pad.plan
    momenta = np.array([channel.momentum for channel in pad.masses.channels])
    known = Recoil(
        pad_g=float(pad.masses.whole.mass) / GRAM,
        moving_g=None if pad.moving_kg is None else pad.moving_kg / GRAM,
        images=0,
        clamped_db=None,
        in_step_db=None,
        apart_db=None,
        signed_db=None,
        base_g=None,
        lowest_mm=pad.lowest_m / MM,
        centre_mm=tuple((pad.body.centroid / MM).tolist()),
        moments_g_mm2=_rows(pad.body.inertia / GRAM / MM**2),
        momenta_g=_rows(momenta[:, :3] / GRAM),
        momenta_g_mm=_rows(momenta[:, 3:] / GRAM / MM),
    )
    if len(plan.taxels) < 2 or not (pad.unit > 0).all():
        return known
    shown = random_images(len(plan.taxels), images)
    clamped_db = _worst(pad.listen(shown, clamped=True))
    if pad.mount.is_immovable:
        return replace(known, images=images, clamped_db=clamped_db, in_step_db=clamped_db, apart_db=clamped_db)
    return replace(
        known,
        images=images,
        clamped_db=clamped_db,
        in_step_db=_worst(pad.listen(shown)),
        apart_db=_worst(pad.listen_apart(shown)),
    )


def _with_base(
    known: Recoil,
    pad: ShakenPad,
    keeps: Callable[[float | None], bool],
    heard_db: Callable[[ShakenPad], float | None],
    as_it_is_db: float | None,
) -> Recoil:
    """Return `known` with the lightest tried base plate whose ON over OFF in dB satisfies `keeps`, if there is one."""
    if keeps(as_it_is_db):
        return replace(known, base_g=0.0, based_db=as_it_is_db)
    for tried_g in BASES_G:
        if tried_g > (pad.mount.base_mass_g or 0.0):
            glued = replace(pad.mount, kind="glued", base_mass_g=tried_g)
            based_db = heard_db(ShakenPad(pad.plan, glued, pad.masses))
            if keeps(based_db):
                return replace(known, base_g=tried_g, based_db=based_db)
    return known


def _rows(table: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in table.tolist())


def _signed_db(pad: ShakenPad, shown: np.ndarray) -> float | None:
    """Return ON over OFF in dB of the worst of images (k, n), shown with signs that keep the pad still."""
    return _worst(pad.listen(np.array([levels * pad.signs(levels) for levels in shown])))


def _worst(heard: ImageAmplitudes) -> float | None:
    """Return ON over OFF in dB of the worst image; None where no OFF taxel moves in any."""
    db = float(heard.db.min())
    return db if isfinite(db) else None


def _or_inf(db: float | None) -> float:
    return inf if db is None else db
