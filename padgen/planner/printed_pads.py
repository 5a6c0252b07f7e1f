"""Simulate prints of a plan (Monte-Carlo), as many as its verdict needs, and judge every printed coil.

A simulated print differs from the plan only in its resonances; Q and the masses of the response stay. Each cause is a
normal random number z of the given sigma and multiplies a resonance by ``exp(s z)``, with s = d ln f / d z. So neither
dimensions nor resonances become negative, however large the spread.

====================  ==============================  =====================================================
cause                 acts on                         d ln f
====================  ==============================  =====================================================
modulus               a print                         1/2 dE/E
common z              a print                         s_t dt/t
field z               a taxel, by its place           s_t dt/t
width, length         a taxel                         s_w dw/w, s_l dl/l
thickness             a taxel                         s_t dt/t
glue                  a taxel                         −1/2 dm over the effective mass
washer                a taxel                         by the washer's kinetic energy in the mode (`_washer_weight`)
====================  ==============================  =====================================================

s_w, s_t, s_l come from the beam model by central differences (the point-mass rule has 1/2, 3/2, −3/2). The field is a
smooth error of height over the bed, with a correlation of ``exp(−d²/L²)`` between taxels d apart. A washer may lie
anywhere in its recess: its sigma along each axis is a quarter of the clearance. The constant offsets of a printer are
not simulated (`padgen.spec.Spread`).

Every printed coil is judged over all states by the closed form of `padgen.physics.selectivity`: the smallest ON
amplitude (of a taxel on alone) over the largest OFF amplitude (with all others on). The washers' unequal distances from
the coil are counted; leakage and other modes add what they add in the plan.

There are four stages. In the first, tones and forces are the plan's, so that a detuned taxel moves less than planned
when ON. In the others each tone is moved to where its taxel is believed to resonate, and forces restore the level that
the level law gives there: after a coupon the error common to the print is known, after some measured taxels the field
as well, after re-tuning every taxel's own resonance.

`what_prints_keep` estimates the selectivity of printed pads from few prints, with the error.
"""

from dataclasses import astuple, dataclass, fields
from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from padgen.core.units import G_PER_CM3, GRAM, MG, MM
from padgen.physics.ladder import LevelLaw, ladder_ratio
from padgen.physics.resonator import relative_energy
from padgen.physics.selectivity import Channels, Scheme, channels, off_energy
from padgen.planner.channels import heard_modes
from padgen.planner.drive_scheme import placed_channels
from padgen.planner.plan import Plan, Prints, level_law
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.spec import Spec

__all__ = [
    "NAMES",
    "NOT_PRINTED",
    "OF_A_PRINT",
    "QUICK_PADS",
    "STAGES",
    "SURELY",
    "Coils",
    "Design",
    "Simulated",
    "Spreads",
    "coils_of",
    "compared_prints",
    "covariance",
    "design_of",
    "log_detuning",
    "log_resonances",
    "missed_spreads",
    "printed",
    "ratio_spread",
    "sensitivities",
    "spreads_of",
    "what_prints_keep",
    "work",
]


BLOCK = 1 << 16
"""Responses that are computed at a time: as many as fit a core's cache."""
DRAWN = 1 << 18
MOST_DRAWN = 1 << 12
"""Printed taxels, and at most pads, that one stream of random numbers is used for."""
STEP = 1e-3
"""Relative step of the central differences; its square is their error, 1e-14 over it the rounding error."""
STEP_DECIMALS = 7
"""Decimals of the differences that are kept: the rest is less than their error, and other with another numpy."""
WORKING_SHARE = 0.3
"""Share of the largest compliance above which a mode may be followed as the working one."""
ROUNDING_DB = 1e-9
NODES = 6
"""Nodes of the field per correlation length; with five the covariance is 1e-6 off."""
SMALLEST_WAVE = 1e-7
FARTHEST = 20.0
"""Largest change of ln f that is computed: so detuned, a taxel is lost anyway, and larger powers would overflow."""


@dataclass(frozen=True, slots=True)
class Spreads:
    """One sigma of each cause: `modulus` relative, the others in the unit of their name."""

    modulus: float
    common_z_mm: float
    field_z_mm: float
    width_mm: float
    thickness_mm: float
    length_mm: float
    glue_mg: float
    washer_mm: float

    def none(self) -> "Spreads":
        """Return spreads of zero: all prints are as drawn."""
        return Spreads(*[0.0] * len(NAMES))


STAGES = ("planned", "coupon", "some", "retuned")
"""Stages of knowledge about a print: none, the error common to the print, also the field, every taxel's resonance."""
NAMES = tuple(f.name for f in fields(Spreads))
OF_A_PRINT = ("modulus", "common_z_mm")
"""Causes with one random number per print. The field has a smooth random function, the others a number per taxel."""


class Coils(NamedTuple):
    """Coils of the same channels (n,), with the indices of their taxels (n, coils)."""

    channels: np.ndarray
    taxels: np.ndarray


class Design(NamedTuple):
    """All that simulated prints take from a plan: arrays by channel (n,) and by taxel (t,), and the coils.

    `beside` (2, n) is the energy of an OFF taxel by leakage and by its other modes, over that of its ON state: with all
    coils in step, and re-tuned. `kept` is the share of its energy that an ON taxel keeps where its beams stretch.
    `need` is the asked energy ratio of ON over OFF. `weight` (8, n) is d ln f per unit of each of `Spreads`;
    `sensitivity` (n, 3) is d ln f / d ln of width, thickness and length. `field_length_mm` is the field's correlation
    length.
    """

    resonance_hz: np.ndarray
    q: np.ndarray
    mass_g: np.ndarray
    pull: np.ndarray
    beside: np.ndarray
    kept: float
    law: LevelLaw
    scheme: Scheme
    need: float
    crowded_ratio: float
    weight: np.ndarray
    sensitivity: np.ndarray
    channel: np.ndarray
    place_mm: np.ndarray
    field_length_mm: float
    coils: tuple[Coils, ...]


class Simulated(NamedTuple):
    """Results of simulated pads (p,), by stage (s,) of knowledge.

    `ratio` (s, p) is the energy of ON over OFF of a pad's worst coil, inf where nothing moves OFF taxels. `good` (s, p)
    tells if a pad is good, `good_taxels` (s, p) counts its good taxels. `good_prints` (s, t) counts the pads in which a
    taxel is good, `good_coils` (s, t) those in which its coil is. `square` (n,) sums the squares of the taxels' ln f
    off the plan. `neighbours` (2,) counts neighbouring channels that changed order, and that came too close.
    """

    ratio: np.ndarray
    good_taxels: np.ndarray
    good: np.ndarray
    square: np.ndarray
    neighbours: np.ndarray
    good_prints: np.ndarray
    good_coils: np.ndarray


def spreads_of(spec: Spec) -> Spreads:
    """Return the spreads of a spec's prints."""
    spread = spec.spread
    taxel = spec.taxel
    return Spreads(
        modulus=spread.common_modulus,
        common_z_mm=spread.common_z_mm,
        field_z_mm=spread.bed_field_mm,
        width_mm=spread.width_mm,
        thickness_mm=spread.thickness_mm,
        length_mm=spread.length_mm,
        glue_mg=taxel.glue_spread_mg,
        washer_mm=0.0 if taxel.centre_post else taxel.washer_clearance_mm / 4,
    )


def sensitivities(plan: Plan) -> np.ndarray:
    """Return d ln f / d ln of width, thickness and length (n, 3) of every channel, by the beam model."""
    step = np.exp(STEP * np.concatenate([np.eye(3), -np.eye(3)]))
    sizes = np.array([(c.beam.width_mm, c.beam.thickness_mm, c.beam.length_mm) for c in plan.channels])
    log_hz = log_resonances(plan, sizes[:, None] * step)
    return np.asarray(((log_hz[:, :3] - log_hz[:, 3:]) / (2 * STEP)).round(STEP_DECIMALS))


def log_resonances(plan: Plan, sizes_mm: np.ndarray) -> np.ndarray:
    """Return ln of the resonance in Hz (n, k) of each channel with beams of given sizes (n, k, 3) in mm.

    The sizes are width, thickness and length.
    """
    result = np.empty(sizes_mm.shape[:2])
    for topology in {c.beam.topology for c in plan.channels}:
        index = [c.index for c in plan.channels if c.beam.topology == topology]
        drawn = np.array([(c.beam.width_mm, c.beam.thickness_mm, c.beam.length_mm) for c in plan.channels])[index, None]
        size = np.concatenate([drawn, sizes_mm[index]], axis=1)
        model = TaxelModel(plan.spec, topology, plate_shape(plan.spec), BeamShape(*np.moveaxis(size, -1, 0)))
        # Of compliant modes take the one nearest to the drawn beam's, so that all sizes have the same mode.
        compliance = model.compliances
        log_hz = np.log(model.modes.frequency_hz)
        drawn_hz = np.take_along_axis(log_hz[:, :1], model.working[:, :1, None], -1)
        works = compliance > WORKING_SHARE * compliance.max(-1, keepdims=True)
        nearest = np.where(works, np.abs(log_hz - drawn_hz), inf).argmin(-1)[..., None]
        result[index] = np.take_along_axis(log_hz, nearest, -1)[:, 1:, 0]
    return result


def coils_of(plan: Plan) -> dict[tuple[int, int], list[int]]:
    """Return the indices of each coil's taxels, lowest channel first, by the coil's row and column."""
    coils: dict[tuple[int, int], list[int]] = {}
    for index, taxel in sorted(enumerate(plan.taxels), key=lambda item: item[1].channel):
        coils.setdefault(taxel.coil, []).append(index)
    return coils


def design_of(plan: Plan, places_mm: np.ndarray | None) -> Design:
    """Return all that simulated prints take from a plan, with its taxels at `places_mm` (t, 2) if these are given."""
    spec = plan.spec
    sensitivity = sensitivities(plan)
    size = np.array([(c.beam.width_mm, c.beam.thickness_mm, c.beam.length_mm) for c in plan.channels])
    mass = np.array([c.effective_mass_g for c in plan.channels])
    pull = np.array([c.force_constant_n_per_a2 for c in plan.channels])
    width, thickness, length = (sensitivity / size).T
    one = np.ones(len(mass))
    glue = -0.5 / (mass * GRAM / MG)
    channel = np.array([taxel.channel for taxel in plan.taxels])
    alike: dict[tuple[int, ...], list[list[int]]] = {}
    for index in coils_of(plan).values():
        alike.setdefault(tuple(channel[index]), []).append(index)
    return Design(
        resonance_hz=np.array([c.resonance_hz for c in plan.channels]),
        q=np.array([c.q for c in plan.channels]),
        mass_g=mass,
        pull=pull if (pull > 0).all() else np.ones(len(mass)),
        beside=_added_off_energy(plan),
        kept=float(10 ** (-max(c.level_loss_db for c in plan.channels) / 10)),
        law=level_law(spec),
        scheme=plan.scheme,
        need=10 ** ((plan.selectivity.asked_db - ROUNDING_DB) / 10),
        crowded_ratio=ladder_ratio(spec.q_min, spec.delta_y),
        weight=np.array([one / 2, thickness, thickness, width, thickness, length, glue, _washer_weight(plan)]),
        sensitivity=sensitivity,
        channel=channel,
        place_mm=np.array([(t.x_mm, t.y_mm) for t in plan.taxels] if places_mm is None else places_mm, float),
        field_length_mm=spec.spread.field_length_mm,
        coils=tuple(Coils(np.array(members), np.array(alike[members]).T) for members in sorted(alike)),
    )


def work(design: Design) -> float:
    """Return the number of responses to compute for one pad in all stages; a taxel's random numbers count as ten."""
    with_pairs = design.scheme.has_pair_spurs
    each = [(n := len(coils.channels)) ** 2 + with_pairs * (n > 2) * n**2 * (n - 1) for coils in design.coils]
    coils = [coils.taxels.shape[1] for coils in design.coils]
    return float(len(STAGES) * sum(np.multiply(each, coils)) + 10 * len(design.channel))


def _added_off_energy(plan: Plan) -> np.ndarray:
    """Return the energy (2, n) that leakage and other modes add to an OFF taxel, over that of its ON state.

    The first row is for all coils in step, as by the driver table, the second for re-tuned coils, each at its own
    frequencies. Both take the other coils' tones to lie at the taxel's resonance, while they only come near it.
    """
    total = np.zeros((2, len(plan.channels)))
    for row, leaks_db in zip(total, (plan.reuse.leaks_db, plan.reuse.retuned_leaks_db), strict=True):
        row += [0.0 if db is None else 10 ** (-db / 10) for db in leaks_db]
    for channel_set in plan.sets:
        if len(channel_set) < 2:
            continue
        taxels = placed_channels(plan.spec, channel_set)
        modes = heard_modes(plan.spec, channel_set, taxels.line)
        more = off_energy(taxels, plan.scheme, modes) - off_energy(taxels, plan.scheme)
        total[:, [c.index for c in channel_set]] += np.maximum(more, 0.0)
    return total


def _washer_weight(plan: Plan) -> np.ndarray:
    """Return |d ln f| (n,) per mm that a channel's washer lies off the middle of its recess, in the worst direction.

    First-order perturbation: the relative fall of f is half of the washer's relative gain of kinetic energy.
    """
    washer = plan.spec.washer
    area = np.pi / 4 * (washer.outer_diameter_mm**2 - washer.inner_diameter_mm**2) * MM**2
    mass = area * washer.thickness_mm * MM * washer.density_g_per_cm3 * G_PER_CM3
    motion = np.array([c.mode_motions[int(np.argmax(c.mode_shares))] for c in plan.channels])
    up = motion[:, 2]
    tilt = motion[:, 3:5]
    return np.asarray(mass * np.abs(up) * np.hypot(*tilt.T) * MM)


def ratio_spread(design: Design, spreads: Spreads) -> float:
    """Return the relative sigma of the ratio of neighbouring resonances of a coil, of the worst pair.

    An error common to a print counts by the difference of the two channels' sensitivities, the field also by the
    distance of their taxels. For one channel the pair is two taxels of that channel at one place.
    """
    worst = 0.0
    for coils in design.coils:
        index = np.repeat(coils.taxels[:, 0], 2 if len(coils.channels) == 1 else 1)
        pair = design._replace(channel=design.channel[index], place_mm=design.place_mm[index])
        total = covariance(pair, spreads)
        each = np.diag(total)
        worst = max(worst, float((each[1:] + each[:-1] - 2 * np.diag(total, 1)).max()))
    return float(np.sqrt(worst))


def missed_spreads(design: Design, spreads: Spreads) -> tuple[float, ...]:
    """Return the sigma of ln of a taxel's resonance over its tone at each of `STAGES`, for the worst channel."""
    square = (np.array(astuple(spreads))[:, None] * design.weight) ** 2
    known = (), OF_A_PRINT, (*OF_A_PRINT, "field_z_mm"), NAMES
    return tuple(float(square[[name not in some for name in NAMES]].sum(0).max() ** 0.5) for some in known)


def log_detuning(design: Design, spreads: Spreads, seed: int, unit: int, pads: int) -> np.ndarray:
    """Return ln of printed over planned resonance (3, taxels, pads).

    The rows are the error common to a print, this with the field, and this with each taxel's own error. Each of the
    three errors has a stream of random numbers, drawn pad by pad: the first pads are the same however many there are.
    """
    taxels = len(design.channel)
    weight = np.array(astuple(spreads))[:, None] * design.weight
    streams = [np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(unit, k))) for k in range(3)]
    result = np.zeros((3, taxels, pads))
    common = [k for k, name in enumerate(NAMES) if name in OF_A_PRINT]
    result[:] = (weight[common].T @ streams[0].standard_normal((pads, len(common))).T)[design.channel]
    field = weight[NAMES.index("field_z_mm")]
    if field.any():
        result[1:] += field[design.channel, None] * _field(design, streams[1], pads)
    of_taxel = np.sqrt(
        (weight[[k for k, name in enumerate(NAMES) if name not in (*OF_A_PRINT, "field_z_mm")]] ** 2).sum(0)
    )
    result[2] += of_taxel[design.channel, None] * streams[2].standard_normal((pads, taxels)).T
    return result


def _field(design: Design, rng: np.random.Generator, pads: int) -> np.ndarray:
    """Draw a smooth random field of sigma 1 at the taxels (taxels, pads): waves along x times waves along y."""
    (x, at_x), (y, at_y) = (np.unique(side, return_inverse=True) for side in design.place_mm.T)
    along, across = (_waves(side, design.field_length_mm) for side in (x, y))
    z = rng.standard_normal((pads, along.shape[1], across.shape[1]))
    grid = along @ z @ across.T
    return np.asarray(grid[:, at_x, at_y].T)


def _waves(place_mm: np.ndarray, length_mm: float) -> np.ndarray:
    """Return W (n, k) with ``W Wᵀ`` = exp(−d²/length²) for places (n,) at distances d.

    The waves stand on nodes a sixth of the length apart, or on the places themselves if these are fewer: each wave
    takes a random number for every pad.
    """
    count = int(np.ptp(place_mm) / length_mm * NODES) + 2 * NODES
    nodes = place_mm
    if count < len(place_mm):
        nodes = np.linspace(place_mm.min() - length_mm, place_mm.max() + length_mm, count)
    among_nodes, to_nodes = (np.exp(-(((at[:, None] - nodes) / length_mm) ** 2)) for at in (nodes, place_mm))
    size, shape = np.linalg.eigh(among_nodes)
    kept = size > SMALLEST_WAVE * size.max()
    return np.asarray(to_nodes @ shape[:, kept] / np.sqrt(size[kept]))


def covariance(design: Design, spreads: Spreads, coupon: np.ndarray | None = None) -> np.ndarray:
    """Return the covariance of ln f of the pad's taxels (t,), followed by those of a coupon with channels (k,).

    The coupon is printed with the pad, but somewhere else on the bed, so that its field is independent of the pad's.
    """
    apart = [np.exp(-((side[:, None] - side) ** 2) / design.field_length_mm**2) for side in design.place_mm.T]
    taxels = len(design.channel)
    more = 0 if coupon is None else len(coupon)
    channel = np.concatenate([design.channel, np.asarray(coupon if more else [], int)])
    alike = {"field_z_mm": np.eye(taxels + more)} | dict.fromkeys(OF_A_PRINT, np.ones((taxels + more,) * 2))
    alike["field_z_mm"][:taxels, :taxels] = apart[0] * apart[1]
    total = np.zeros((taxels + more,) * 2)
    for k, (name, sigma) in enumerate(zip(NAMES, astuple(spreads), strict=True)):
        each = (sigma * design.weight[k])[channel]
        total += alike[name] * np.outer(each, each) if name in alike else np.diag(each**2)
    return total


def printed(design: Design, spreads: Spreads, pads: int, seed: int, stages: tuple[str, ...] = STAGES) -> Simulated:
    """Simulate `pads` prints and judge them at the given `stages`, in blocks of bounded memory."""
    taxels = len(design.channel)
    count = len(design.q)
    many = len(stages)
    beside = design.beside[[int(stage == STAGES[-1]) for stage in stages]]
    known = [STAGES.index(stage) for stage in stages]
    unit = max(min(DRAWN // taxels, MOST_DRAWN), 1)
    step = max(BLOCK // taxels, 1)
    prints = Simulated(
        np.full((many, pads), np.inf),
        np.zeros((many, pads), int),
        np.ones((many, pads), bool),
        np.zeros(count),
        np.zeros(2),
        np.zeros((many, taxels), int),
        np.zeros((many, taxels), int),
    )
    for number in range(-(-pads // unit)):
        log_x = log_detuning(design, spreads, seed, number, min(unit, pads - number * unit))
        prints.square[:] += np.bincount(design.channel, (log_x[2] ** 2).sum(1), count)
        for first in range(0, log_x.shape[2], step):
            x = np.exp(np.clip(log_x[:, :, first : first + step], -FARTHEST, FARTHEST))
            tones = [np.ones_like(x[0]), *x]
            block = slice(number * unit + first, number * unit + first + x.shape[2])
            for coils in design.coils:
                _judge(design, coils, x[2], [tones[k] for k in known], beside, prints, block)
    return prints


def _judge(
    design: Design,
    coils: Coils,
    x: np.ndarray,
    tones: list[np.ndarray],
    beside: np.ndarray,
    prints: Simulated,
    block: slice,
) -> None:
    """Judge `coils` in a block of pads, and enter the results into `prints`.

    `x` (taxels, pads) is printed over planned resonance, `tones` the same shape for each stage, the tone over the
    planned one, `beside` (stages, n) as in `Design`.
    """
    n = len(coils.channels)
    shape = (*coils.taxels.shape, x.shape[1])
    x = x[coils.taxels].reshape(n, -1)
    f, q, mass, pull = (v[coils.channels, None] for v in (design.resonance_hz, design.q, design.mass_g, design.pull))
    hz = f * x
    for k, tone in enumerate(tones):
        tone_hz = f * tone[coils.taxels].reshape(n, -1)
        driven = channels(tone_hz, q, design.law(tone_hz), mass, pull)
        rise = (hz / tone_hz) ** 2
        # The line that would move each taxel by its level at its own resonance.
        taxel = Channels(hz, q, driven.line * rise)
        on = (relative_energy(tone_hz, hz, q) / rise**2).reshape(shape)
        more = beside[k, coils.channels, None, None]
        off = more + (off_energy(taxel, design.scheme, drivers=driven).reshape(shape) if n > 1 else 0.0 * on)
        good = design.kept * on >= np.maximum(design.need * off, 0.5 if n == 1 else 0.0)
        with np.errstate(divide="ignore"):
            ratio = design.kept * on.min(0) / off.max(0)
        good_coils = good[0] if n == 1 else ratio >= design.need
        prints.ratio[k, block] = np.minimum(prints.ratio[k, block], ratio.min(0))
        prints.good[k, block] &= good_coils.all(0)
        prints.good_taxels[k, block] += good.sum((0, 1))
        prints.good_prints[k, coils.taxels] += good.sum(-1)
        prints.good_coils[k, coils.taxels] += good_coils.sum(-1)
    apart = hz[1:] / hz[:-1]
    limit = design.crowded_ratio
    prints.neighbours[:] += (apart < 1).sum(), ((apart < limit) & (apart > 1 / limit)).sum()


PADS = 1000
FEWEST = 100
"""Pads that are simulated, and the fewest where a pad takes much work."""
QUICK_PADS = 200
NEAR_SHARE = 0.07
"""Pads for comparing layouts, and three sigma of their good share: more are simulated if it is so near to the asked."""
SURE_SHARE = 0.013
SURE_DB = 0.2
"""Half intervals above which more pads are simulated; of two hundred plans none is then off by 2 % or 0.3 dB."""
SURELY = 2.0
"""Half intervals of 95 % by which a share of few prints is below another that more prints would not reach, either."""
WORK = 4e6
MOST_WORK = 1.6e7
"""Most responses that are computed at first, and when more pads are simulated."""
SIGMAS_95 = 1.96
"""Half width of a 95 % interval, in sigmas."""
NOT_PRINTED = Prints(None, None, None, None, 0.0, 0.0, 0, None, 1.0, 0.0, ())
"""Placeholder in a plan whose prints are not simulated yet."""


def what_prints_keep(plan: Plan, quick: bool = False) -> Prints:
    """Simulate prints of `plan`, always the same ones, until the estimate is sure; with `quick` only a few."""
    design = design_of(plan, None)
    return _simulated(plan, design, QUICK_PADS, STAGES) if quick else _simulated_until_sure(plan, design, STAGES)


def compared_prints(plan: Plan, least_db: float, least_share: float) -> tuple[float, Prints]:
    """Return the selectivity in dB of the pad as drawn, leakage and other modes counted, and its re-tuned prints.

    As many prints are simulated as comparing layouts needs: none (`NOT_PRINTED`) if the drawn pad keeps less than
    `least_db`, and few if these show that the share of good ones is below `least_share`.
    """
    design = design_of(plan, None)
    stages = STAGES[-1:]
    ratio = float(printed(design, spreads_of(plan.spec).none(), 1, 0, stages).ratio.min())
    paper_db = 10 * float(np.log10(ratio)) if ratio > 0 else float("-inf")
    if paper_db < least_db:
        return paper_db, NOT_PRINTED
    prints = _simulated(plan, design, QUICK_PADS, stages)
    may_reach = prints.good_share + SURELY * prints.error_share >= least_share
    if may_reach and 0 < prints.good_share < plan.spec.print_share + NEAR_SHARE:
        prints = _simulated_until_sure(plan, design, stages)
    return paper_db, prints


def _simulated_until_sure(plan: Plan, design: Design, stages: tuple[str, ...]) -> Prints:
    first, most = (int(max(limit / work(design), FEWEST)) for limit in (WORK, MOST_WORK))
    prints = _simulated(plan, design, min(PADS, first), stages)
    unsure = max(prints.error_share / SURE_SHARE, (prints.error_db or 0.0) / SURE_DB) ** 2
    return _simulated(plan, design, int(min(unsure * prints.pads, most)), stages) if unsure > 1 else prints


def _simulated(plan: Plan, design: Design, made: int, stages: tuple[str, ...]) -> Prints:
    spreads = spreads_of(plan.spec)
    columns = plan.coils.columns
    prints = printed(design, spreads, made, 0, stages)
    share = plan.spec.print_share
    kept = np.sort(10 * np.log10(np.maximum(prints.ratio, np.finfo(float).tiny)), axis=1)
    reached = kept[:, min(int((1 - share) * made), made - 1)].tolist()
    good = float(prints.good[-1].mean())
    heard = bool(np.isfinite(kept).all())
    of_coils = dict(zip([t.coil for t in plan.taxels], (prints.good_coils[-1] / made).tolist(), strict=True))
    dbs: dict[str, float | None] = dict(zip(stages, reached, strict=True)) if heard else {}
    # The quantile lies between these ranks with 95 % confidence (normal approximation of the binomial distribution).
    away = SIGMAS_95 * sqrt(made * share * (1 - share))
    low, high = (int(np.clip((1 - share) * made + sign * away, 0, made - 1)) for sign in (-1, 1))
    z2 = SIGMAS_95**2
    return Prints(
        print_db=dbs.get("retuned"),
        planned_db=dbs.get("planned"),
        coupon_db=dbs.get("coupon"),
        some_db=dbs.get("some"),
        good_share=good,
        good_taxel_share=float(prints.good_taxels[-1].mean()) / len(plan.taxels),
        pads=made,
        error_db=float(kept[-1, high] - kept[-1, low]) / 2 if heard else None,
        # Half of Wilson's 95 % interval.
        error_share=SIGMAS_95 * sqrt(good * (1 - good) / made + z2 / (4 * made**2)) / (1 + z2 / made),
        ratio_spread=ratio_spread(design, spreads),
        coil_shares=tuple(of_coils.get(divmod(k, columns), 1.0) for k in range(plan.coils.rows * columns)),
    )
