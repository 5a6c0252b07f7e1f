"""Pull of a coil and of its core on small disc and ring magnets above it.

Above all of a coil its potential in A is a sum of Bessel functions (Jackson, *Classical Electrodynamics*, 3.8),

    ψ = Σ_m cos mφ ∫ Φ_m(k) J_m(kρ) exp(−kz) dk,   H = −∇ψ,

and so the energy of a magnet of polarisation J, radii a and b and height h, `gap` above and `offset` off the axis, is
that of its charged faces (`magnets.face_flux`; off the axis by Watson, *Theory of Bessel Functions*, 1944, 11.3),

    U = Σ_m ∫ Φ_m J_m(k offset) 2πJ (a J₁(ka) − b J₁(kb)) (exp(−kh) − 1) exp(−k gap) / k dk.

Forces, moments and slopes are its derivatives, so they cost no more than the energy. A winding has Φ₀ in closed form
but for an integral over its radius; the charges of its core are those of `magnetics.charged_core` in the coil's field,
and by `magnetics.steel_body` in the magnet's. What a moving magnet induces in the coil is its force per ampere times
its velocity (reciprocity).

Fields from outside do not change the polarisation: a recoil permeability of 1.05 lets them change it by 5 % of what
they are, at most. The steel of cores is linear. SI units; a current whose field lies along the polarisation pulls.
"""

from collections.abc import Sequence
from functools import lru_cache
from math import ceil, log, pi
from typing import Any, NamedTuple

import numpy as np

from padgen.physics.magnetics import (
    MOST_RINGS,
    MU_0,
    CoilSource,
    SteelBody,
    SteelRing,
    Winding,
    charged_core,
    fine_rings,
    gauss,
)
from padgen.physics.magnets import (
    DECAY,
    PANEL_NODES,
    PANEL_PHASE,
    Coupling,
    DiscMagnet,
    bessel,
    face_flux,
    steel_charges,
    wave_points,
)
from padgen.physics.track_pull import MagnetWaves, track_pulls

__all__ = ["LEAST_GAP", "MagnetPull", "RestOnSpring", "magnet_pull", "rest_on_spring", "shared_core"]

LEAST_GAP = 50e-6
"""Smallest gap in m that is computed; nearer ones count as this."""
STEPS = 1.25
"""Ratio of the gaps and of the reaches for which wave numbers are kept."""
AT_ONCE = 1 << 17
"""Most pairs of a place and a wave number that are computed together."""


class MagnetPull(NamedTuple):
    """Forces and moments of a coil and its core on a magnet at n places, with slopes and error bounds, as arrays (n,).

    Per ampere: `force` towards the coil in N/A, its `slope` with the gap in N/(A·m), `side` force in N/A away from the
    coil's axis, `moment` in N·m/A about a horizontal axis through the middle of the magnet's underside at right angles
    to the offset, positive if it lowers the far side; `error` bounds that of the force, `slope_error` that of the
    slope. Without a current, by the core alone: `core_pull` towards the coil in N; `core_stiffness` in N/m, its slope
    with the gap, which is mostly negative and adds to the spring's; `core_side`, `core_moment`; and `core_error`, which
    bounds that of the pull. Rectangular coils also push at right angles to the offset: `side_across` in N/A to the
    left of it, and `moment_across`, positive if it lowers the left side.
    """

    force: np.ndarray
    slope: np.ndarray
    side: np.ndarray
    moment: np.ndarray
    error: np.ndarray
    slope_error: np.ndarray
    core_pull: np.ndarray
    core_stiffness: np.ndarray
    core_side: np.ndarray
    core_moment: np.ndarray
    core_error: np.ndarray
    side_across: np.ndarray
    moment_across: np.ndarray


MOST = (40, 24)
"""Most nodes on the core's top face, and highest order round its axis, to save time."""
FEWER = 0.7
"""Share of the core's nodes in a second solution; its difference counts as error."""
CORE_SHARE = 0.003
"""Relative error of what the core adds (docs/magnets.md)."""
RULE_SHARES = (2e-5, 2e-4)
"""Errors of the integrals over wave numbers for force and slope, over those of the integrands without their signs."""


class _Core(NamedTuple):
    """A magnet's potential at surface nodes of a coil's core, and the charge it induces there, by angular order m.

    `along` (m, K, 3, nodes) times J_m(k offset) exp(−k gap) is a magnet's potential in A at the nodes and its first and
    second slope with the gap. `across` (m, K, 2, nodes) times J_m' exp(−k gap) is its slope with the offset, with its
    sign turned, and with the magnet's tilt. `echo` (m, nodes, nodes) times a potential is the nodes' charge, weighted
    so that its product with a potential is an energy in J.
    """

    along: np.ndarray
    across: np.ndarray
    echo: np.ndarray


class _Spectrum(NamedTuple):
    """Hankel spectra over wave numbers k (K,): of a coil's potential and, with quadrature weights, of a magnet.

    `faces` is the magnet as it takes part in energies, `turned` in moments; `coil` is Φ₀ per ampere, `doubt` its change
    by fewer nodes on the core.
    """

    k: np.ndarray
    faces: np.ndarray
    turned: np.ndarray
    coil: np.ndarray
    doubt: np.ndarray
    cores: tuple[_Core, ...]


def magnet_pull(
    coil: CoilSource, magnet: DiscMagnet, gap: Any, place: Any, steel: SteelRing | None = None
) -> MagnetPull:
    """Return a coil's pull on a magnet whose underside is `gap` (n,) m above its top, at `place` (n, 2) m off its axis.

    A `place` (n,) is so many m along x. Bounds of the errors are in docs/magnets.md. Gaps below `LEAST_GAP` count as
    that. `steel` lies on top of the magnet and moves with it (`magnets.steel_charges`).
    """
    gap = np.maximum(np.atleast_1d(np.asarray(gap, float)), LEAST_GAP)
    place = np.asarray(place, float)
    if not (gap.size and place.size):
        return MagnetPull(*np.zeros((13, 0)))
    if coil.tracks:
        return _rectangular_pulls(coil, magnet, gap, place, steel)
    gap, offset = np.broadcast_arrays(gap, np.hypot(*place.T) if place.ndim > 1 else place)
    pairs = list(zip(gap.tolist(), offset.tolist(), strict=True))
    row = {pair: at for at, pair in enumerate(dict.fromkeys(pairs))}  # many taxels lie alike over their coils
    near, beside = np.array(list(row)).T
    spectrum = _spectrum(coil, magnet, float(near.min()), float(beside.max()), steel)
    some = max(AT_ONCE // len(spectrum.k), 1)
    blocks = [
        _pulls(spectrum, near[at : at + some], beside[at : at + some], coil.uneven) for at in range(0, len(row), some)
    ]
    return MagnetPull(*np.concatenate(blocks, axis=1)[:, [row[pair] for pair in pairs]])


def _rectangular_pulls(
    coil: CoilSource, magnet: DiscMagnet, gap: np.ndarray, place: np.ndarray, steel: SteelRing | None
) -> MagnetPull:
    """Return the pulls of a coil of straight tracks, by the magnet's field at the tracks; each place but once."""
    if place.ndim < 2:
        place = np.stack([np.ravel(place), np.zeros(place.size)], -1)
    gap, x, y = np.broadcast_arrays(gap, *place.T)
    rows, back = np.unique(np.stack([gap, x, y], -1), axis=0, return_inverse=True)
    farthest = float(np.hypot(x, y).max()) + coil.outer_diameter / 2
    least_gap, reach = _shared_range(magnet, float(gap.min()), farthest)
    waves = MagnetWaves(*_magnet_waves(magnet, least_gap, reach, steel), least_gap, reach)
    pulls = track_pulls(coil.tracks, waves, rows[:, 0], rows[:, 1:], coil.uneven)
    distance = np.hypot(*rows[:, 1:].T)
    out = rows[:, 1:] / np.where(distance > 0, distance, 1.0)[:, None]
    left = np.stack([-out[:, 1], out[:, 0]], -1)
    side, moment, side_across, moment_across = (
        (vector * way).sum(1) for way in (out, left) for vector in (pulls.side, pulls.lowering)
    )
    none = np.zeros((5, len(rows)))
    both = pulls.force, pulls.slope, side, moment, pulls.error, pulls.slope_error, *none, side_across, moment_across
    return MagnetPull(*np.stack(both)[:, back.ravel()])


def _pulls(spectrum: _Spectrum, gap: np.ndarray, offset: np.ndarray, uneven: float) -> np.ndarray:
    """Return the fields of `MagnetPull` at gaps and offsets (n,) in m, as an array (13, n)."""
    orders = max((len(core.echo) for core in spectrum.cores), default=1)
    k = spectrum.k
    fall = np.exp(-gap[:, None] * k)
    around = bessel(offset[:, None] * k, orders)
    turns = _bessel_derivatives(around)
    coil = spectrum.faces * spectrum.coil
    force = -(fall * around[0]) @ (k * coil)
    slope = (fall * around[0]) @ (k * k * coil)
    side = -(fall * turns[0]) @ (k * coil)
    moment = (fall * turns[0]) @ (spectrum.turned * spectrum.coil)
    doubt = spectrum.faces * spectrum.doubt
    lost = [
        np.abs((fall * around[0]) @ (power * doubt))
        + share * (fall @ np.abs(power * coil))
        + uneven * np.abs(fall @ (power * coil))
        for power, share in zip((k, k * k), RULE_SHARES, strict=True)
    ]
    static = np.zeros((5, gap.size))
    if spectrum.cores:
        fine, coarse = (_core_pulls(core, fall, around, turns) for core in spectrum.cores)
        static[:4] = fine
        static[4] = np.abs(fine[0] - coarse[0]) + CORE_SHARE * np.abs(fine[0])
    return np.stack([force, slope, side, moment, *lost, *static, *np.zeros((2, gap.size))])


def _bessel_derivatives(around: np.ndarray) -> np.ndarray:
    """Return the derivatives of Bessel functions from their values (m + 1, …), for all orders but the highest."""
    below = np.concatenate([-around[1:2], around[:-2]])
    turning = (below - around[1:]) / 2
    turning[0] = -around[1]
    return turning


def _core_pulls(core: _Core, fall: np.ndarray, around: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return the core's pull, stiffness, side force and moment (4, n) on a magnet, by charge the magnet induces on it.

    The energy is half that of the magnet in the field of this charge, which is linear in the magnet's potential u: its
    slope is that of u in the field of the charge as it lies, and the second one also has that of the charge itself.
    """
    pull, stiffness, charges = _drawn(core, [fall * wave for wave in around[: len(core.echo)]])
    side, moment = np.zeros((2, len(fall)))
    for across, turned, charge in zip(core.across, turns, charges, strict=False):
        sideways, tilted = np.moveaxis(np.tensordot(fall * turned, across, 1), 1, 0)
        side += (charge * sideways).sum(1)
        moment += (charge * tilted).sum(1)
    return np.stack([pull, stiffness, side, moment])


def _drawn(core: _Core, waves: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
    """Return a magnet's pull and stiffness (n,) by charge it induces on a core, and that charge (n, nodes) per order.

    `waves` (n, K) are J_m(k offset) exp(−k gap) of its places.
    """
    pull, stiffness = np.zeros((2, len(waves[0])))
    charges = []
    for along, echo, wave in zip(core.along, core.echo, waves, strict=True):
        at, moved, bent = np.moveaxis(np.tensordot(wave, along, 1), 1, 0)
        charge = at @ echo
        pull += (charge * moved).sum(1)
        stiffness += (charge * bent).sum(1) + ((moved @ echo) * moved).sum(1)
        charges.append(charge)
    return pull, stiffness, charges


def _spectrum(
    coil: CoilSource, magnet: DiscMagnet, gap: float, offset: float, steel: SteelRing | None = None
) -> _Spectrum:
    """Return a spectrum valid for all gaps ≥ `gap` and offsets ≤ `offset` in m; similar calls share a cached one."""
    return _kept_spectrum(coil, magnet, *_shared_range(magnet, gap, offset), steel)


def _core_at(coil: CoilSource, magnet: DiscMagnet, gap: float, offset: float) -> tuple[np.ndarray, _Core] | None:
    """Return the wave numbers and the core of `_spectrum`, alone a third of the work; None of a coil without one."""
    shared = _shared_range(magnet, gap, offset)
    core = _kept_core(coil, magnet, *shared, None, 1.0)
    return core and (_magnet_waves(magnet, shared[0], shared[1] + _half_width(coil), None)[0], core)


def _shared_range(magnet: DiscMagnet, gap: float, offset: float) -> tuple[float, float]:
    """Return a gap of steps from `LEAST_GAP` on, at most `gap`, and a reach of such steps, at least `offset`, in m."""
    low = LEAST_GAP * STEPS ** int(log(gap / LEAST_GAP) / log(STEPS))
    finest = magnet.outer_diameter / 16
    return low, finest * STEPS ** ceil(log(max(offset, finest) / finest) / log(STEPS))


@lru_cache(maxsize=64)
def _kept_spectrum(
    coil: CoilSource, magnet: DiscMagnet, gap: float, reach: float, steel: SteelRing | None
) -> _Spectrum:
    k, faces, turned = _magnet_waves(magnet, gap, reach + _half_width(coil), steel)
    wound = sum((_wound(winding, k) for winding in coil.windings), np.zeros_like(k))
    nodes = [_core_nodes(coil, magnet, gap, reach, share) for share in (1.0, FEWER)]
    charged = [core for core in (charged_core(coil, *counts) for counts in nodes) if core is not None]
    if not charged:
        return _Spectrum(k, faces, turned, wound, 0 * k, ())
    step = max(0.8 * gap, coil.outer_diameter / MOST_RINGS)
    drawn, fewer = (_core_wave(body, charge, step, k) for body, charge in charged)
    doubt = np.abs(drawn - fewer) + CORE_SHARE * np.abs(drawn)
    kept = (_kept_core(coil, magnet, gap, reach, steel, share) for share in (1.0, FEWER))
    cores = tuple(core for core in kept if core is not None)
    return _Spectrum(k, faces, turned, wound + drawn, doubt, cores)


@lru_cache(maxsize=64)
def _magnet_waves(
    magnet: DiscMagnet, gap: float, reach: float, steel: SteelRing | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the wave numbers k (K,), and `faces` and `turned` (K,) of a `_Spectrum`, for radii up to `reach` in m."""
    moved = max(magnet.outer_diameter, steel.outer_diameter if steel else 0.0) / 2
    k, weight = wave_points(DECAY / gap, reach + moved)
    height = k * magnet.height
    flux = 2 * pi * magnet.polarisation * face_flux(magnet, k)
    across = 2 * pi * magnet.polarisation * sum(sign * a**2 * bessel(k * a, 2)[2] for a, sign in magnet.rims)
    turned = -(height * flux * np.exp(-height) + across * np.expm1(-height))
    faces = flux * np.expm1(-height)
    if steel:
        drawn, tilted = _ring_wave(steel_charges(magnet, steel), k)
        faces += drawn
        turned += tilted
    return k, weight * faces, weight * turned


def _core_nodes(coil: CoilSource, magnet: DiscMagnet, gap: float, reach: float, share: float) -> tuple[int, int]:
    """Return a `share` of the nodes on the core's top face, and of the orders round its axis, that a magnet takes."""
    overlap = min(reach, coil.core_diameter / 2 + magnet.outer_diameter / 2)
    top = ceil(6 + coil.core_diameter / 2 / gap)
    orders = ceil(3 + 1.2 * overlap / (gap + 0.3e-3))
    return ceil(share * min(top, MOST[0])), ceil(share * min(orders, MOST[1]))


@lru_cache(maxsize=128)
def _kept_core(
    coil: CoilSource, magnet: DiscMagnet, gap: float, reach: float, steel: SteelRing | None, share: float
) -> _Core | None:
    charged = charged_core(coil, *_core_nodes(coil, magnet, gap, reach, share))
    return charged and _core(charged[0], *_magnet_waves(magnet, gap, reach + _half_width(coil), steel))


def _half_width(coil: CoilSource) -> float:
    return max(coil.outer_diameter, coil.core_diameter) / 2


def _ring_wave(rings: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Return what the steel on a magnet adds to the spectra of the magnet's energy and moment, (2, K) in Wb."""
    radius, height, charge = rings
    around = bessel(k[:, None] * radius, 1)
    fall = MU_0 * charge * np.exp(-k[:, None] * height)
    return np.stack([(fall * around[0]).sum(-1), -k * (fall * (height * around[0] + radius * around[1])).sum(-1)])


def _wound(winding: Winding, k: np.ndarray) -> np.ndarray:
    """Return the Hankel spectrum Φ₀ (K,) of a winding's potential per ampere, integrated over its cross-section."""
    inner = winding.inner_diameter / 2
    outer = max(winding.outer_diameter / 2, inner + 1e-9)
    rings = _integral_of_rings(k, inner, outer) / (outer - inner)
    length = k * winding.length
    return winding.turns / 2 * rings * np.exp(k * winding.top) * -np.expm1(-length) / length


def _integral_of_rings(k: np.ndarray, inner: float, outer: float) -> np.ndarray:
    """Return ∫ r J₁(kr) dr from radius `inner` to `outer`, in m, at wave numbers k."""
    ends = np.outer((inner, outer), k)
    waves = ends[1] - ends[0] > PANEL_PHASE
    integral = np.empty_like(k)
    integral[~waves] = _integral_of_wave(*ends[:, ~waves])
    if waves.any():
        # Where many waves lie on the radius, what lies below its ends is added up once for all k, panel by panel.
        panel = (ends[:, waves] / PANEL_PHASE).astype(int)
        starts = np.arange(panel.max() + 1) * PANEL_PHASE
        whole = np.append(0.0, np.cumsum(_integral_of_wave(starts, starts + PANEL_PHASE)))
        below = whole[panel] + _integral_of_wave(panel * PANEL_PHASE, ends[:, waves])
        integral[waves] = below[1] - below[0]
    return integral / k**2


def _integral_of_wave(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return ∫ x J₁(x) dx from `start` to `end`, which lie at most `PANEL_PHASE` apart."""
    node, weight = gauss(PANEL_NODES)
    x = start[..., None] + (end - start)[..., None] * node
    return np.asarray((x * bessel(x, 1)[1]) @ weight * (end - start))


def _core_wave(body: SteelBody, charge: np.ndarray, step: float, k: np.ndarray) -> np.ndarray:
    """Return the Hankel spectrum Φ₀ (K,) of a charged core's potential per ampere; rings on top lie `step` m apart."""
    radius, height, shares = fine_rings(body, step)
    total = 2 * pi * radius * (shares @ charge)
    return (bessel(k[:, None] * radius, 1)[0] * np.exp(k[:, None] * height)) @ total / (4 * pi)


def _core(body: SteelBody, k: np.ndarray, faces: np.ndarray, turned: np.ndarray) -> _Core:
    orders = len(body.response) - 1
    mean = np.where(np.arange(orders + 1) == 0, 1.0, 2.0)[:, None, None]
    waves = bessel(body.radius * k[:, None], orders) * np.exp(body.height * k[:, None]) * mean / (4 * pi * MU_0)
    slopes = np.stack([faces, -k * faces, k * k * faces], -1)
    turns = np.stack([-k * faces, turned], -1)
    along, across = (part[:, :, None] * waves[:, :, None] for part in (slopes, turns))
    return _Core(along, across, MU_0 / mean * np.swapaxes(body.response, 1, 2) * body.area)


def shared_core(
    coil: CoilSource, magnet: DiscMagnet, gap: np.ndarray, places: np.ndarray, polarity: np.ndarray
) -> Coupling:
    """Return a core's pulls on equal magnets at `places` (n, 2) in m from its axis, and the stiffness coupling them.

    `force` (n,) in N is the pull of each towards the coil, by what it draws itself (`MagnetPull.core_pull`) and by what
    the others draw; the stiffness has both, too. `gap` (n,) is in m, `polarity` (n,) 1 or −1.
    """
    offset = np.hypot(*places.T)
    around = np.arctan2(places[:, 1], places[:, 0])
    gap = np.maximum(gap, LEAST_GAP)
    count = len(offset)
    pull = np.zeros(count)
    stiffness = np.zeros((count, count))
    there = _core_at(coil, magnet, float(gap.min()), float(offset.max()))
    if there is None:
        return Coupling(pull, stiffness)
    k, core = there
    fall = polarity[:, None] * np.exp(-gap[:, None] * k)
    waves = bessel(offset[:, None] * k, len(core.echo) - 1)
    for m, (along, echo) in enumerate(zip(core.along, core.echo, strict=True)):
        at, moved, bent = np.moveaxis(np.tensordot(fall * waves[m], along, 1), 1, 0)
        turned = np.cos(m * np.subtract.outer(around, around))
        charge = at @ echo
        pull += (turned * (moved @ charge.T)).sum(1)
        stiffness += turned * (moved @ echo @ moved.T) + np.diag((turned * (bent @ charge.T)).sum(1))
    return Coupling(pull, stiffness)


class RestOnSpring(NamedTuple):
    """Equilibrium of magnets (n,) on springs over a core, without a current.

    `gap` in m is where they come to rest, `stiffness` in N/m what the spring and the core's pull leave there, and
    `snap_gap` the gap below which the pull outruns the spring, or a fifth of the first gap if it does not above that.
    These are NaN for magnets that snap in at once, on springs below `least_stiffness` in N/m.
    """

    gap: np.ndarray
    stiffness: np.ndarray
    snap_gap: np.ndarray
    least_stiffness: np.ndarray


LEVEL_STEP = log(5) / 20
"""Logarithmic step of the gaps at which `rest_on_spring` solves the pull: levels from `LEAST_GAP` on, the same for all
magnets, so that those of one offset share them."""
LEVELS = 5
"""Levels that are solved together: near gaps take many more wave numbers than far ones."""
FINE = 481
"""Gaps at which spring and pull are compared, in even steps of the logarithm."""
NEAREST = 0.2
"""Smallest of these gaps over the largest."""


def rest_on_spring(
    coil: CoilSource, magnet: DiscMagnet, gap: np.ndarray, offset: np.ndarray, stiffness: np.ndarray
) -> RestOnSpring:
    """Return where magnets (n,) on springs of `stiffness` in N/m rest over a core; `gap` in m is that without pull."""
    gap, offset, stiffness = np.broadcast_arrays(*map(np.atleast_1d, (gap, offset, stiffness)))
    lowest = np.maximum(NEAREST * gap, np.minimum(gap, LEAST_GAP))
    at = gap * (lowest / gap) ** np.linspace(0, 1, FINE)[:, None]
    pull, slope = _core_pull_between(coil, magnet, at, offset)
    left = pull - stiffness * (gap - at)  # negative where the spring wins
    with np.errstate(divide="ignore", invalid="ignore"):
        least = np.where(at < gap, pull / (gap - at), np.inf).min(0)
    free = left[0] <= 0  # no pull at all: it rests where it is
    rests = (left <= 0).argmax(0)
    held = free | (rests > 0)
    beyond = (left > 0) & (np.arange(len(at))[:, None] > rests)
    snaps = np.where(beyond.any(0), beyond.argmax(0), len(at) - 1)
    rest_gap = np.where(free, gap, _crossing(at, left, np.maximum(rests, 1)))
    snap_gap = np.where(beyond.any(0), _crossing(at, left, snaps), lowest)
    steep = np.take_along_axis(slope, rests[None], 0)[0]
    rest, left_over, snap = (np.where(held, part, np.nan) for part in (rest_gap, stiffness + steep, snap_gap))
    return RestOnSpring(rest, left_over, snap, least)


def _core_pull_between(
    coil: CoilSource, magnet: DiscMagnet, at: np.ndarray, offset: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the core's pull in N and its slope in N/m (…, n) at gaps `at` (…, n) in m, interpolated by cubics."""
    place = np.log(np.maximum(at, LEAST_GAP) / LEAST_GAP) / LEVEL_STEP
    low = place.astype(int)
    first = low.min() // LEVELS
    blocks = range(first, (low.max() + 1) // LEVELS + 1)
    offsets = tuple(sorted(set(offset.tolist())))
    column = np.searchsorted(offsets, offset)
    solved = np.concatenate([_core_levels(coil, magnet, offsets, block) for block in blocks], axis=1)
    low_row = low - first * LEVELS
    (start, start_slope), (end, end_slope) = (solved[:, row, column] for row in (low_row, low_row + 1))
    t = place - low
    level = LEAST_GAP * np.exp(low * LEVEL_STEP)
    # By the logarithm of the gap (Hermite).
    leaving = start_slope * level * LEVEL_STEP
    coming = end_slope * level * np.exp(LEVEL_STEP) * LEVEL_STEP
    cubic = 2 * (start - end) + leaving + coming
    square = -3 * (start - end) - 2 * leaving - coming
    pull = ((cubic * t + square) * t + leaving) * t + start
    slope = (3 * cubic * t + 2 * square) * t + leaving
    return pull, slope / (LEVEL_STEP * at)


@lru_cache(maxsize=1024)
def _core_levels(coil: CoilSource, magnet: DiscMagnet, offsets: tuple[float, ...], block: int) -> np.ndarray:
    """Return the core's pull in N and its slope in N/m (2, LEVELS, n) at the gaps of one `block`, offsets (n,) in m."""
    gap = LEAST_GAP * np.exp((block * LEVELS + np.arange(LEVELS)) * LEVEL_STEP)
    there = _core_at(coil, magnet, float(gap[0]), offsets[-1])
    if there is None:
        return np.zeros((2, LEVELS, len(offsets)))
    k, core = there
    fall = np.exp(-gap[:, None, None] * k)
    around = bessel(np.array(offsets)[:, None] * k, len(core.echo) - 1)
    waves = (fall * around[:, None]).reshape(len(around), -1, len(k))
    pull, stiffness, _ = _drawn(core, list(waves))
    return np.stack([pull, stiffness]).reshape(2, LEVELS, len(offsets))


def _crossing(at: np.ndarray, left: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Return the gaps (n,) at which `left` (m, n) crosses 0 just before row `index` (n,), by linear interpolation."""
    rows = np.maximum(index - 1, 0), np.maximum(index, 0)
    (start, end), (before, after) = ([np.take_along_axis(of, row[None], 0)[0] for row in rows] for of in (at, left))
    change = np.where(before == after, 1.0, after - before)
    return start - before / change * (end - start)
