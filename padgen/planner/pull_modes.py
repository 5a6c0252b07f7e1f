"""Look up the coil's pull on the washer at each taxel's site, and compute how it excites the taxel's modes.

``padgen/physics/pulls.npy`` has tables of the pull for all coils and washers of the catalogues (`docs/measure_force.py
tables` makes them). For other parts the pull at each distance from the coil's axis is solved at a few gaps and kept in
the cache, over ranges of gaps that are the same for every spec.

The modes are `TaxelModes`, whether from the beam model or from finite elements.
"""

from collections.abc import Sequence
from functools import lru_cache
from itertools import permutations
from math import log, sqrt
from typing import NamedTuple

import numpy as np

from padgen.core.units import MM
from padgen.physics.ladder import slot_half_width
from padgen.physics.magnetics import CoilSource, SteelRing
from padgen.physics.pull import PullAt, PullTable, brought_table, make_table, parts_key
from padgen.physics.resonator import ModalTaxels, TaxelModes, felt_gains, modal_taxels, without_quiet_modes
from padgen.planner.coils import coil_source
from padgen.planner.plan import TURNS, Channel, Plan, Site
from padgen.planner.taxel_model import TaxelModel, plate_shape, recess_mm
from padgen.spec import Spec

__all__ = [
    "MODES_DB",
    "ModeFields",
    "coil_modes",
    "force_error",
    "heard_modes",
    "magnetic_parts",
    "mode_fields",
    "mode_names",
    "modes_in_slots",
    "pull_range",
    "pulled_shares",
    "pulls",
    "site_wrenches",
    "taxel_modes",
]

MODES_DB = 1.0
"""Loss of selectivity by other modes up to which there is no finding."""
QUIET_SHARE = 1e-6
"""Share of the static compliance below which a mode counts as not excited by a pull at the washer's axis."""
NAMES = ("stretch", "lateral", "bending", "torsion", "pitch", "yaw")
"""Names of modes by the largest part of the plate's motion: along x, y, z, and about x, y, z."""


class ModeFields(NamedTuple):
    """The fields of a `Channel` about its modes; `Channel` explains them."""

    modes_hz: tuple[float, ...]
    mode_shares: tuple[float, ...]
    pulled_shares: tuple[float, ...]
    mode_motions: tuple[tuple[float, ...], ...]
    rest_motion: tuple[float, ...]
    pull_wrench: tuple[float, ...]

    @property
    def pulled_share(self) -> float:
        """Ratio of the working mode's motion under the real pull to that under a vertical pull at the washer's axis."""
        return self.pulled_shares[int(np.argmax(self.mode_shares))]


def taxel_modes(model: TaxelModel) -> TaxelModes:
    """Return the modes of `model`: those solved by finite elements if it has them, else the beam model's six."""
    solved: TaxelModes | None = getattr(model, "solved", None)
    if solved is not None:
        return solved
    modes = model.modes
    motion = np.concatenate([modes.at_point(model.washer_point_m), modes.shape[3:]]).T
    return TaxelModes(modes.frequency_hz, motion)


def mode_fields(modes: TaxelModes, wrench: np.ndarray) -> ModeFields:
    """Return the modes of one taxel for the plan; the pull's `wrench` (6,) is that of `site_wrenches`.

    Shares are of the working mode's static compliance under a vertical pull at the washer's axis.
    """
    axial = modes.compliances()
    unit = axial[modes.working]
    rest = np.zeros(6) if modes.rest is None else modes.rest @ wrench
    return ModeFields(
        tuple(modes.frequency_hz.tolist()),
        tuple((axial / unit).tolist()),
        tuple((modes.compliances(wrench) / unit).tolist()),
        tuple(tuple(row) for row in modes.motion.tolist()),
        tuple(rest.tolist()),
        tuple(wrench.tolist()),
    )


def pulled_shares(modes: Sequence[TaxelModes], wrenches: np.ndarray) -> np.ndarray:
    """Return `ModeFields.pulled_share` (n,) of taxels whose pulls have `wrenches` (n, 6)."""
    shares = []
    for own, wrench in zip(modes, wrenches, strict=True):
        axial = own.compliances()
        working = axial.argmax()
        shares.append(own.compliances(wrench)[working] / axial[working])
    return np.array(shares)


def force_error(modes: TaxelModes, wrench: np.ndarray, error: float, radius_m: float) -> float:
    """Return the relative error of the force on the working mode; the pull's `wrench` (6,) is that of `site_wrenches`.

    The axial pull has the relative `error`. The side force is off by as many newtons, the moment by the same force at
    the rim of the washer, `radius_m` from its axis (docs/accuracy.md). The three errors are independent.
    """
    x, y = wrench[:2] / (np.hypot(*wrench[:2]) or 1.0)
    off = np.array([(0, 0, 1, 0, 0, 0), (x, y, 0, 0, 0, 0), (0, 0, 0, -y * radius_m, x * radius_m, 0)])
    share, *parts = (modes.compliances(part)[modes.working] for part in (wrench, *off))
    return float(error * np.linalg.norm(parts) / abs(share)) if share else error


def site_wrenches(spec: Spec, pulled: PullAt, sites: Sequence[Site]) -> np.ndarray:
    """Return the wrench (n, 6), force and moment, of the pull at each site per newton of its vertical part.

    It is in N and N m, about the washer's axis at z = 0, in the taxel's own axes. A washer that the coil does not pull
    gets (0, 0, 1, 0, 0, 0).
    """
    wrench = np.tile(np.eye(6)[2], (len(sites), 1))
    for column, part in ((0, pulled.side), (4, pulled.moment)):
        np.divide(part, -pulled.pull, out=wrench[:, column], where=pulled.pull > 0)
    # Unit vector away from the coil's axis; zero on the axis, where there is no side force.
    out = np.array([np.divide(site.washer_mm, site.coil_distance_mm or 1.0) for site in sites])
    cosine, sine = np.array([TURNS[site.along] for site in sites]).T
    # The same vector in the taxel's own axes.
    x, y = cosine * out[:, 0] + sine * out[:, 1], cosine * out[:, 1] - sine * out[:, 0]
    turned = np.empty_like(wrench)
    for a, b in ((0, 1), (3, 4)):
        turned[:, a] = x * wrench[:, a] - y * wrench[:, b]
        turned[:, b] = y * wrench[:, a] + x * wrench[:, b]
    turned[:, [2, 5]] = wrench[:, [2, 5]]
    # The underside of the washer is the glue's thickness above the bed's plane.
    height = (recess_mm(spec)[1] - spec.washer.thickness_mm) * MM
    turned[:, 3] -= height * turned[:, 1]
    turned[:, 4] += height * turned[:, 0]
    return turned


def coil_modes(spec: Spec, channels: Sequence[Channel]) -> ModalTaxels:
    """Return all modes of the taxels of one coil, driven at their resonances."""
    most = max(len(channel.modes_hz) for channel in channels) + 1
    frequency, gain = np.ones((len(channels), most)), np.zeros((len(channels), most, 3))
    radius_m = spec.taxel.boss_diameter_mm / 2 * MM
    for i, channel in enumerate(channels):
        modes = TaxelModes(np.array(channel.modes_hz), np.array(channel.mode_motions))
        wrench, rest = np.array(channel.pull_wrench), np.array(channel.rest_motion)
        count = len(channel.modes_hz) + 1
        frequency[i, :count], gain[i, :count] = felt_gains(modes, wrench, rest, radius_m)
    return modal_taxels(
        frequency, gain, np.array([c.q for c in channels]), np.array([c.resonance_hz for c in channels])
    )


def heard_modes(spec: Spec, channels: Sequence[Channel], line: np.ndarray) -> ModalTaxels:
    """Return `coil_modes` without modes that no line of the drive excites much; `line` (n,) as in `Channels`."""
    own_hz = np.array([c.resonance_hz for c in channels])
    return without_quiet_modes(coil_modes(spec, channels), own_hz, line, spec.drive.bias_ratio)


def modes_in_slots(plan: Plan) -> list[tuple[Channel, Channel]]:
    """Return pairs of channels: one whose second mode lies in the slot of the other.

    Only modes count that a pull at the washer's axis does not excite.
    """
    half = slot_half_width(plan.spec.q_min, plan.spec.delta_y)
    return [
        (channel, other)
        for own in plan.sets
        for channel, other in permutations(own, 2)
        if channel.second_mode_share < QUIET_SHARE and abs(channel.second_mode_hz / other.resonance_hz - 1) < half
    ]


def mode_names(spec: Spec, channel: Channel) -> tuple[str, ...]:
    """Return a name for each mode of a channel.

    The working mode is 'bending'. The others take, of the names left, that of the largest part of the plate's motion:
    at half the plate's height, near the centre of mass, with rotations times the plate's radius of gyration. Beyond
    six, modes are 'higher'.
    """
    plate = plate_shape(spec)
    height, arm = plate.thickness_mm / 2 * MM, plate.length_mm / 12**0.5 * MM
    motion = np.array(channel.mode_motions)
    motion[:, 0] += height * motion[:, 4]
    motion[:, 1] -= height * motion[:, 3]
    part = motion**2 * np.array([1, 1, 1, arm, arm, arm]) ** 2
    part /= part.sum(1, keepdims=True)
    names = ["higher"] * len(motion)
    working = int(np.argmax(channel.mode_shares)), NAMES.index("bending")
    for n in range(min(len(motion), len(NAMES))):
        mode, kind = np.unravel_index(int(part.argmax()), part.shape) if n else working
        names[mode] = NAMES[kind]
        part[mode], part[:, kind] = -1.0, -1.0
    return tuple(names)


KIND = "pulls"
CODE = ("physics/magnetic_charge.py", "physics/pull.py")
LOW, RANGE, GAPS = 0.35 * MM, 3, 5
"""Parts outside the catalogues are solved at `GAPS` gaps in each range, from `LOW · RANGE^k` to `LOW · RANGE^(k+1)`."""


def magnetic_parts(spec: Spec) -> tuple[CoilSource, SteelRing]:
    """Return the coil and the washer of a spec in SI units."""
    washer = spec.washer
    return (
        coil_source(spec.coil),
        SteelRing(
            washer.outer_diameter_mm * MM,
            washer.inner_diameter_mm * MM,
            washer.thickness_mm * MM,
            washer.relative_permeability,
        ),
    )


def pulls(spec: Spec, gap_m: np.ndarray, offset_m: np.ndarray) -> PullAt:
    """Return the pulls (n,) on washers over gaps (n,) in m, at offsets (n,) in m from the coil's axis."""
    parts = magnetic_parts(spec)
    result, missing = np.empty((len(PullAt._fields), len(gap_m))), np.ones(len(gap_m), bool)

    def answer(table: PullTable | None, among: np.ndarray) -> None:
        if table is not None and (among := among & table.covers(gap_m, offset_m)).any():
            result[:, among] = table.at(gap_m[among], offset_m[among])
            missing[among] = False

    answer(_shipped_table(*parts), missing)
    part = pull_range(gap_m)
    for offset, k in sorted(set(zip(offset_m[missing].tolist(), part[missing].tolist(), strict=True))):
        answer(_own(*parts, k, offset), (offset_m == offset) & (part == k))
    return PullAt(*result)


def pull_range(gap_m: np.ndarray) -> np.ndarray:
    """Return the number (n,) of the range of a gap (n,) in m; gaps of different ranges may have different tables."""
    return np.floor(np.log(gap_m / LOW) / log(RANGE)).astype(int)


_shipped_table = lru_cache(maxsize=64)(brought_table)


@lru_cache(maxsize=1024)
def _own(coil: CoilSource, washer: SteelRing, part: int, offset_m: float) -> PullTable:
    """Return the pulls at one offset over one range of gaps; cached on disk, since solving takes some ten ms."""
    from padgen.core import cache

    low, high, reach = LOW * RANGE**part, LOW * RANGE ** (part + 1), max(offset_m, 1e-9) * sqrt(2)
    key = cache.key_of([parts_key(coil, washer), low, high, reach, GAPS, cache.code_hash(*CODE)])
    try:
        known = np.array(cache.load(KIND, key), float).reshape(-1, GAPS)
        if np.isfinite(known).all():
            return PullTable(low, high, reach, known[0], known[1:].T[:, None])
    except (TypeError, ValueError):
        pass
    table = make_table(coil, washer, low, high, reach, GAPS, 1)
    cache.store(KIND, key, [table.scale.tolist(), *table.shape[:, 0].T.tolist()])
    return table
