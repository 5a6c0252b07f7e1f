"""Simulate prints of a plan (Monte-Carlo), as many as its verdict needs, and judge every printed coil.

A simulated print differs from the plan in its resonances and in the pull on its washers; Q and the masses of the
response stay (`padgen.planner.life` simulates other Q, and what comes after re-tuning). Each cause is a normal random
number z of the given sigma and multiplies a resonance by ``exp(s z)``, with s = d ln f / d z. So neither dimensions nor
resonances become negative, however large the spread.

====================  ==============================  =====================================================
cause                 acts on                         d ln f
====================  ==============================  =====================================================
modulus               a print                         1/2 dE/E
common z              a print                         s_t dt/t
common beads          a print                         s_b dr/r
across beads          every print alike               s_b ln r, less its mean over the channels
common gap            a print                         (m + 1) by the pull's softening, dg/g
common glue           a print                         −1/2 dm over the effective mass
field z               a taxel, by its place           s_t dt/t
width, length         a taxel                         s_w dw/w, s_l dl/l
thickness             a taxel                         s_t dt/t
beads                 a taxel                         s_b dr/r
glue                  a taxel                         −1/2 dm over the effective mass
washer                a taxel                         by its kinetic energy in the mode (`_washer_offset_sensitivity`)
gap                   a taxel                         (m + 1) by the pull's softening, dg/g
====================  ==============================  =====================================================

s_w, s_t, s_l come from the beam model by central differences (the point-mass rule has 1/2, 3/2, −3/2), and so does
s_b, of the stiffness r across the beads of a layer over that along them. Beads run along every beam; their ratio counts
by twist, by curling and by the ends of a beam (`padgen.physics.beams`). It is below 1 in every print: calibration takes
its mean effect for the modulus's, and what it does to the channels' ratios is in all prints alike. A pull goes with the
gap g as ``g^−m``, so that a gap also changes how much each washer is pulled, by −m dg/g.

The field is a smooth error of height over the bed, with a correlation of ``exp(−d²/L²)`` between taxels d apart. A
washer may lie anywhere in its recess: its sigma along each axis is a quarter of the clearance. The constant offsets of
a printer are not simulated (`padgen.spec.Spread`).

Every printed coil is judged over all states by the closed form of `padgen.physics.selectivity`: the smallest ON
amplitude (of a taxel on alone) over the largest OFF amplitude (with all others on). The washers' unequal distances from
the coil, and what their gaps make of the pull, are counted, and so are a re-tuned taxel's other modes, off by as much
as its resonance is. Leakage adds what it adds in the plan, and so do other modes before that.

There are four stages. In the first, tones and forces are the plan's, so that a detuned taxel moves less than planned
when ON. In the others each tone is moved to where its taxel is believed to resonate, and forces restore the level that
the level law gives there: after a coupon the error common to the print is known, after some measured taxels the field
as well, after re-tuning every taxel's own resonance.

`what_prints_keep` estimates the selectivity of printed pads from few prints, with the error.
"""

from dataclasses import astuple, dataclass, fields, replace
from functools import lru_cache
from math import inf, log, sqrt
from typing import NamedTuple

import numpy as np

from padgen.core.units import G_PER_CM3, GRAM, MG, MM, UM
from padgen.physics.ladder import LevelLaw, ladder_ratio
from padgen.physics.resonator import ModalTaxels, relative_energy
from padgen.physics.selectivity import Channels, Scheme, channels, off_energy
from padgen.planner.channels import hanging_gap_um, heard_modes
from padgen.planner.drive_scheme import placed_channels
from padgen.planner.plan import Plan, Prints, level_law
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.spec import Spec
from padgen.spec.model import LifeTable

__all__ = [
    "NAMES",
    "NOT_PRINTED",
    "OF_A_PRINT",
    "QUICK_PADS",
    "STAGES",
    "SURELY",
    "Coils",
    "Design",
    "Drawn",
    "Drift",
    "Simulated",
    "Spreads",
    "coils_of",
    "compared_prints",
    "covariance",
    "design_of",
    "detuning_sigmas",
    "drawn_drift",
    "drawn_prints",
    "known_print_db",
    "leaked_energy",
    "log_resonances",
    "pads_until_sure",
    "quantile_error",
    "ratio_spread",
    "rising_db",
    "sensitivities",
    "share_error",
    "simulated_prints",
    "spreads_of",
    "what_prints_keep",
    "work_per_pad",
]


BLOCK_OF_MODES = 1 << 14
"""Responses of other modes that are worked out together: few enough for a processor's cache, which halves the time."""
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
QUIET = 0.01
"""Largest joint amplitude of modes that are left out, over an OFF taxel's amplitude by its own mode: 0.1 dB."""
ROUNDING_DB = 1e-9
NODES = 6
"""Nodes of the field per correlation length; with five the covariance is 1e-6 off."""
SMALLEST_WAVE = 1e-7
FARTHEST = 20.0
"""Largest change of ln f that is computed: so detuned, a taxel is lost anyway, and larger powers would overflow."""


@dataclass(frozen=True, slots=True)
class Spreads:
    """Standard deviation of each cause of print errors: relative for `modulus` and beads, else in the unit of its name.

    `across_beads` is no spread: it is −ln of the stiffness across the beads over that along them, alike in every print.
    """

    modulus: float
    common_z_mm: float
    field_z_mm: float
    width_mm: float
    thickness_mm: float
    length_mm: float
    glue_mg: float
    washer_mm: float
    common_beads: float = 0.0
    across_beads: float = 0.0
    beads: float = 0.0
    common_gap_mm: float = 0.0
    gap_mm: float = 0.0
    common_glue_mg: float = 0.0

    def none(self) -> "Spreads":
        """Return spreads of zero: all prints are as drawn."""
        return Spreads(*[0.0] * len(NAMES))


STAGES = ("planned", "coupon", "some", "retuned")
"""Stages of knowledge about a print: none, the error common to the print, also the field, every taxel's resonance."""
JUDGED = ("planned", "retuned")
"""Stages that findings are judged by."""
NAMES = tuple(f.name for f in fields(Spreads))
IN_EVERY_PRINT = "across_beads"
OF_A_PRINT = ("modulus", "common_z_mm", "common_beads", "common_gap_mm", "common_glue_mg", IN_EVERY_PRINT)
"""Causes with one random number per print. The field has a smooth random function, the others a number per taxel."""
GAPS = ("common_gap_mm", "gap_mm")
"""Causes that change the pull as well."""


class Coils(NamedTuple):
    """Coils that have the same n channels, and the indices (n, coils) of their taxels in `Plan.taxels`."""

    channels: np.ndarray
    taxels: np.ndarray


class Design(NamedTuple):
    """Input of print simulations that a plan gives: arrays by channel (n,) and by taxel (t,), and the coils.

    `leaks` is as `leaked_energy` returns it. `others` (n,) is the energy that other modes add to an OFF taxel in the
    plan; `modes` has the heard modes of each of `coils`, or None where `others` are to be added in every print. `kept`
    is the share of its energy that an ON taxel keeps where its beams stretch. `need` is the asked energy ratio of ON
    over OFF. `weight` (causes, n) is d ln f per unit of each of `Spreads`; `pull_per_mm` (n,) is d ln of the pull per
    mm of gap; `sensitivity` (n, 3) is d ln f / d ln of width, thickness and length. `field_length_mm` is the field's
    correlation length.
    """

    resonance_hz: np.ndarray
    q: np.ndarray
    mass_g: np.ndarray
    pull: np.ndarray
    leaks: np.ndarray
    others: np.ndarray
    modes: tuple[ModalTaxels | None, ...]
    kept: float
    law: LevelLaw
    scheme: Scheme
    need: float
    crowded_ratio: float
    weight: np.ndarray
    pull_per_mm: np.ndarray
    sensitivity: np.ndarray
    channel: np.ndarray
    place_mm: np.ndarray
    field_length_mm: float
    coils: tuple[Coils, ...]


class Simulated(NamedTuple):
    """Results of simulated pads (p,) at each of `STAGES` (s,), from tones as planned to every taxel re-tuned.

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
    """Return the standard deviation that a spec gives to each cause of print errors."""
    spread = spec.spread
    taxel = spec.taxel
    return Spreads(
        modulus=spread.common_modulus,
        common_z_mm=spread.common_z_mm,
        field_z_mm=spread.bed_field_mm,
        width_mm=spread.width_mm,
        thickness_mm=spread.thickness_mm,
        length_mm=spread.length_mm,
        glue_mg=spread.glue_mg if taxel.glue_spread_mg is None else taxel.glue_spread_mg,
        washer_mm=0.0 if taxel.centre_post else taxel.washer_clearance_mm / 4,
        common_beads=spread.common_beads,
        across_beads=-log(spread.bead_ratio),
        beads=spread.beads,
        common_gap_mm=spread.common_gap_mm,
        gap_mm=spread.gap_mm,
        common_glue_mg=spread.common_glue_mg,
    )


def sensitivities(plan: Plan) -> np.ndarray:
    """Return d ln f / d ln of width, thickness, length and bead ratio (n, 4) of every channel, by the beam model."""
    step = np.exp(STEP * np.concatenate([np.eye(4), -np.eye(4)]))
    sizes = np.array([(c.beam.width_mm, c.beam.thickness_mm, c.beam.length_mm) for c in plan.channels])
    log_hz = log_resonances(plan, sizes[:, None] * step[:, :3], step[:, 3])
    return np.asarray(((log_hz[:, :4] - log_hz[:, 4:]) / (2 * STEP)).round(STEP_DECIMALS))


def log_resonances(plan: Plan, sizes_mm: np.ndarray, bead_ratio: np.ndarray | float = 1.0) -> np.ndarray:
    """Return ln of the resonance in Hz (n, k) of each channel with beams of given sizes (n, k, 3) in mm.

    The sizes are width, thickness and length; `bead_ratio` (k,) is the stiffness across beads over that along them.
    """
    ratio = np.concatenate([[1.0], np.broadcast_to(bead_ratio, sizes_mm.shape[1])])
    result = np.empty(sizes_mm.shape[:2])
    for topology in {c.beam.topology for c in plan.channels}:
        index = [c.index for c in plan.channels if c.beam.topology == topology]
        drawn = np.array([(c.beam.width_mm, c.beam.thickness_mm, c.beam.length_mm) for c in plan.channels])[index, None]
        size = np.concatenate([drawn, sizes_mm[index]], axis=1)
        shape = BeamShape(*np.moveaxis(size, -1, 0))
        beads = np.broadcast_to(ratio, size.shape[:2])
        model = TaxelModel(plan.spec, topology, plate_shape(plan.spec), shape, bead_ratio=beads)
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
    """Return the input of print simulations for a plan, with its taxels at `places_mm` (t, 2) if these are given."""
    spec = plan.spec
    sensitivity = sensitivities(plan)
    size = np.array([(c.beam.width_mm, c.beam.thickness_mm, c.beam.length_mm) for c in plan.channels])
    mass = np.array([c.effective_mass_g for c in plan.channels])
    pull = np.array([c.force_constant_n_per_a2 for c in plan.channels])
    width, thickness, length = (sensitivity[:, :3] / size).T
    beads = sensitivity[:, 3]
    glue = -0.5 / (mass * GRAM / MG)
    gap_mm = hanging_gap_um(spec, np.array([c.sag_um for c in plan.channels])) * UM / MM
    exponent = np.array([c.pull_exponent for c in plan.channels])
    # The pull's softening is of the mean pull over the gap: it goes with a power of the gap less by one.
    gap = np.array([c.pull_shift for c in plan.channels]) * (exponent + 1) / gap_mm
    weight = {
        "modulus": np.full(len(mass), 0.5),
        "common_z_mm": thickness,
        "field_z_mm": thickness,
        "width_mm": width,
        "thickness_mm": thickness,
        "length_mm": length,
        "glue_mg": glue,
        "washer_mm": _washer_offset_sensitivity(plan),
        "common_beads": beads,
        IN_EVERY_PRINT: beads.mean() - beads,
        "beads": beads,
        "common_gap_mm": gap,
        "gap_mm": gap,
        "common_glue_mg": glue,
    }
    channel = np.array([taxel.channel for taxel in plan.taxels])
    alike: dict[tuple[int, ...], list[list[int]]] = {}
    for index in coils_of(plan).values():
        alike.setdefault(tuple(channel[index]), []).append(index)
    coils = tuple(Coils(np.array(members), np.array(alike[members]).T) for members in sorted(alike))
    others, heard = _other_modes(plan)
    heard_by_coils = [[heard[k] for k in one.channels if k in heard] for one in coils]
    return Design(
        resonance_hz=np.array([c.resonance_hz for c in plan.channels]),
        q=np.array([c.q for c in plan.channels]),
        mass_g=mass,
        pull=pull if (pull > 0).all() else np.ones(len(mass)),
        leaks=leaked_energy(plan),
        others=others,
        modes=tuple(ModalTaxels(*map(np.concatenate, zip(*of, strict=True))) if of else None for of in heard_by_coils),
        kept=float(10 ** (-max(c.level_loss_db for c in plan.channels) / 10)),
        law=level_law(spec),
        scheme=plan.scheme,
        need=10 ** ((plan.selectivity.asked_db - ROUNDING_DB) / 10),
        crowded_ratio=ladder_ratio(spec.q_min, spec.delta_y),
        weight=np.array([weight[name] for name in NAMES]),
        pull_per_mm=-exponent / gap_mm,
        sensitivity=sensitivity[:, :3],
        channel=channel,
        place_mm=np.array([(t.x_mm, t.y_mm) for t in plan.taxels] if places_mm is None else places_mm, float),
        field_length_mm=spec.spread.field_length_mm,
        coils=tuple(Coils(np.array(members), np.array(alike[members]).T) for members in sorted(alike)),
    )


def work_per_pad(design: Design) -> float:
    """Return the computing work of a simulated pad, in resonator responses; random numbers of a taxel count as ten."""
    with_pairs = design.scheme.has_pair_spurs
    each = [(n := len(coils.channels)) ** 2 + with_pairs * (n > 2) * n**2 * (n - 1) for coils in design.coils]
    coils = [coils.taxels.shape[1] for coils in design.coils]
    return float(len(STAGES) * sum(np.multiply(each, coils)) + 10 * len(design.channel))


def leaked_energy(plan: Plan) -> np.ndarray:
    """Return each channel's energy (2, n) when OFF, from leakage of other coils, divided by its energy when ON.

    The first row is for all coils in step, as by the driver table, the second for re-tuned coils, each at its own
    frequencies. Both take the other coils' tones to lie at the taxel's resonance, while they only come near it.
    """
    total = np.zeros((2, len(plan.channels)))
    for row, leaks_db in zip(total, (plan.reuse.leaks_db, plan.reuse.retuned_leaks_db), strict=True):
        if leaks_db:  # a fixture with a single taxel has none
            row += [0.0 if db is None else 10 ** (-db / 10) for db in leaks_db]
    return total


def _other_modes(plan: Plan) -> tuple[np.ndarray, dict[int, ModalTaxels]]:
    """Return OFF taxels' energy (n,) by modes other than the working one, divided by their ON energy, and these modes.

    These are by the index of the channel, of those that hear more than their working mode.
    """
    total = np.zeros(len(plan.channels))
    heard = dict[int, ModalTaxels]()
    for channel_set in plan.sets:
        if len(channel_set) < 2:
            continue
        taxels = placed_channels(plan.spec, channel_set)
        modes = heard_modes(plan.spec, channel_set, taxels.line, QUIET)
        more = off_energy(taxels, plan.scheme, modes) - off_energy(taxels, plan.scheme)
        index = [c.index for c in channel_set]
        total[index] = np.maximum(more, 0.0)
        if modes.responses > 1:
            heard |= {k: ModalTaxels(*(part[i : i + 1] for part in modes)) for i, k in enumerate(index)}
    return total, heard


class _PrintedModes(NamedTuple):
    """Modes of n taxels in many printed pads: each planned frequency times its taxel's `x` in each pad.

    `x` (n, pads) are printed over planned resonances, `q_ratio` (n, pads) the Q over the plan's. Lines are
    those of all pads, the pads last.
    """

    modes: ModalTaxels
    x: np.ndarray
    q_ratio: np.ndarray | None = None

    @property
    def responses(self) -> int:
        """Number of resonator responses computed for each taxel and spectral line: one of each mode."""
        return self.modes.responses

    def energy(self, rows: slice, frequency: np.ndarray, rest: np.ndarray | float = 0.0) -> np.ndarray:
        """Return taxels' felt energy (rows, lines) at spectral lines, divided by that at their tones; ignore `rest`.

        It is written out with one division, since most of the time of judging prints goes into it.
        """
        x = self.x[rows, None]
        count, _, pads = x.shape
        hz = frequency.reshape(-1, pads) / x
        lost = hz if self.q_ratio is None else hz / self.q_ratio[rows, None]
        hz, lost = (part.reshape(count, 1, -1) for part in (hz, lost))
        period = 1 / self.modes.frequency_hz[rows, :, None]
        damping = period / self.modes.q[rows, None, None]
        gain = self.modes.gain[rows].transpose(0, 2, 1)
        behind = gain * damping.transpose(0, 2, 1)
        energy = np.empty((count, hz.shape[2]))
        step = max(BLOCK_OF_MODES // (count * len(period[0])), 1)
        for start in range(0, hz.shape[2], step):
            some = slice(start, start + step)
            stiff = hz[..., some] ** 2 * period**2
            np.subtract(1, stiff, out=stiff)
            scale = lost[..., some] ** 2 * damping**2
            scale += stiff * stiff
            np.divide(1, scale, out=scale)
            stiff *= scale
            energy[:, some] = ((gain @ stiff) ** 2 + (behind @ scale * lost[..., some]) ** 2).sum(1)
        if self.q_ratio is None:
            return energy
        # Over the energy at resonance, which goes with the square of Q.
        return (energy.reshape(count, -1, pads) / self.q_ratio[rows, None] ** 2).reshape(energy.shape)


def _washer_offset_sensitivity(plan: Plan) -> np.ndarray:
    """Return |d ln f| (n,) per mm that a channel's washer lies off the middle of its recess, in the worst direction.

    First-order perturbation: the relative fall of f is half of the washer's relative gain of kinetic energy.
    """
    washer = plan.spec.washer_or_magnet
    area = np.pi / 4 * (washer.outer_diameter_mm**2 - washer.inner_diameter_mm**2) * MM**2
    mass = area * washer.thickness_mm * MM * washer.density_g_per_cm3 * G_PER_CM3
    motion = np.array([c.mode_motions[int(np.argmax(c.mode_shares))] for c in plan.channels])
    up = motion[:, 2]
    tilt = motion[:, 3:5]
    return np.asarray(mass * np.abs(up) * np.hypot(*tilt.T) * MM)


def ratio_spread(design: Design, spreads: Spreads) -> float:
    """Return the relative sigma over prints of the ratio of two neighbouring resonances of a coil, for the worst pair.

    An error common to a print counts by the difference of the two channels' sensitivities, the field also by the
    distance of their taxels. For one channel the pair is two taxels of that channel at one place.
    """
    worst = 0.0
    for coils in design.coils:
        index = np.repeat(coils.taxels[:, 0], 2 if len(coils.channels) == 1 else 1)
        pair = design._replace(channel=design.channel[index], place_mm=design.place_mm[index])
        total = covariance(pair, replace(spreads, **{IN_EVERY_PRINT: 0.0}))
        each = np.diag(total)
        worst = max(worst, float((each[1:] + each[:-1] - 2 * np.diag(total, 1)).max()))
    return float(np.sqrt(worst))


def detuning_sigmas(design: Design, spreads: Spreads) -> tuple[float, ...]:
    """Return the worst channel's sigmas of ln(resonance/tone) if nothing, a coupon, some taxels or all are measured."""
    square = (np.array(astuple(replace(spreads, **{IN_EVERY_PRINT: 0.0})))[:, None] * design.weight) ** 2
    known = (), OF_A_PRINT, (*OF_A_PRINT, "field_z_mm"), NAMES
    return tuple(float(square[[name not in some for name in NAMES]].sum(0).max() ** 0.5) for some in known)


class Ratios(NamedTuple):
    """Ratios to the plan: of resonances or tones `x`, of pulls, and of quality factors `q` (None if as planned)."""

    x: np.ndarray
    pull: np.ndarray
    q: np.ndarray | None = None


class Drift(NamedTuple):
    """Changes of prints after re-tuning: `log_x` shifts ln f of all taxels; `life` has random spreads of f and Q."""

    log_x: float
    life: LifeTable


class Drifted(NamedTuple):
    """Prints some time after re-tuning (taxels, pads): ln(resonance / that when re-tuned) and ln(Q / planned Q).

    Q was the same when they were re-tuned, so that their lines follow it.
    """

    log_x: np.ndarray
    log_q: np.ndarray


class Drawn(NamedTuple):
    """Random print errors: ln(printed / planned resonance) and ln(printed / planned pull).

    The rows of both (3, taxels, pads) are the error common to a print, this with the field (which leaves pulls as they
    are), and this with each taxel's own error.
    """

    log_x: np.ndarray
    log_pull: np.ndarray


def drawn_prints(design: Design, spreads: Spreads, seed: int, unit: int, pads: int) -> Drawn:
    """Draw the random errors of `pads` prints.

    Each kind of error has a stream of random numbers, drawn pad by pad: the first pads are the same however many there
    are.
    """
    taxels = len(design.channel)
    sigma = dict(zip(NAMES, astuple(spreads), strict=True))
    weight = dict(zip(NAMES, np.array(astuple(spreads))[:, None] * design.weight, strict=True))
    streams = [np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(unit, k))) for k in range(4)]
    log_x = np.zeros((3, taxels, pads))
    log_pull = np.zeros((3, taxels, pads))
    common = dict(zip(OF_A_PRINT, streams[0].standard_normal((pads, len(OF_A_PRINT))).T, strict=True))
    common[IN_EVERY_PRINT] = np.ones(pads)
    log_x[:] = sum(np.multiply.outer(weight[name], common[name]) for name in OF_A_PRINT)[design.channel]
    field = weight["field_z_mm"]
    if field.any():
        log_x[1:] += field[design.channel, None] * _field(design, streams[1], pads)
    many = [weight[name] ** 2 for name in NAMES if name not in (*OF_A_PRINT, *GAPS, "field_z_mm")]
    log_x[2] += np.sqrt(sum(many))[design.channel, None] * streams[2].standard_normal((pads, taxels)).T
    if any(sigma[name] for name in GAPS):
        of_taxel = streams[3].standard_normal((pads, taxels)).T
        log_x[2] += weight["gap_mm"][design.channel, None] * of_taxel
        pull = design.pull_per_mm[design.channel, None]
        log_pull[:] = pull * sigma["common_gap_mm"] * common["common_gap_mm"]
        log_pull[2] += pull * sigma["gap_mm"] * of_taxel
    return Drawn(log_x, log_pull)


def drawn_drift(drift: Drift, taxels: int, seed: int, unit: int, pads: int) -> Drifted:
    """Draw random changes of `pads` prints after re-tuning, from streams separate from those of `drawn_prints`."""
    of_print, of_taxel = (np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(unit, k))) for k in (4, 5))
    life = drift.life
    ageing, common_q = of_print.standard_normal((pads, 2)).T
    q = of_taxel.standard_normal((pads, taxels)).T
    log_x = np.broadcast_to(drift.log_x + life.ageing * ageing, q.shape)
    return Drifted(log_x, np.clip(life.common_q * common_q + life.q * q, -FARTHEST, FARTHEST))


def _field(design: Design, rng: np.random.Generator, pads: int) -> np.ndarray:
    """Draw a smooth random field of sigma 1 at the taxels (taxels, pads): waves along x times waves along y."""
    (x, at_x), (y, at_y) = (np.unique(side, return_inverse=True) for side in design.place_mm.T)
    along, across = (_waves(tuple(side.tolist()), design.field_length_mm) for side in (x, y))
    z = rng.standard_normal((pads, along.shape[1], across.shape[1]))
    grid = along @ z @ across.T
    return np.asarray(grid[:, at_x, at_y].T)


@lru_cache(maxsize=8)
def _waves(places_mm: tuple[float, ...], length_mm: float) -> np.ndarray:
    """Return W (n, k) so that ``W Wᵀ`` is the covariance exp(−d²/length²) between places (n,) at distances d.

    The waves stand on nodes a sixth of the length apart, or on the places themselves if these are fewer: each wave
    takes a random number for every pad.
    """
    place_mm = np.array(places_mm)
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


def simulated_prints(
    design: Design,
    spreads: Spreads,
    pads: int,
    seed: int,
    stages: tuple[str, ...] = STAGES,
    drift: Drift | None = None,
    least_share: float = 0.0,
) -> Simulated:
    """Return the results of `pads` simulated prints of a design, judged at each of the given `stages` of tuning.

    With a `drift`, they are judged after it. Once less than a `least_share` of them can be good at the last stage, the
    rest is not judged: it counts as good.
    """
    taxels = len(design.channel)
    unit = max(min(DRAWN // taxels, MOST_DRAWN), 1)
    prints = _unjudged(design, pads, stages)
    for number in range(-(-pads // unit)):
        many = min(unit, pads - number * unit)
        drawn = drawn_prints(design, spreads, seed, number, many)
        later = None if drift is None else drawn_drift(drift, taxels, seed, number, many)
        if not _judge_drawn(design, drawn, number * unit, stages, prints, later, least_share):
            break
    return prints


def known_print_db(plan: Plan, resonances_hz: np.ndarray) -> tuple[float, float] | None:
    """Return the selectivity in dB of a print of given resonances (taxels,): with the planned tones, and re-tuned.

    None where nothing moves an OFF taxel.
    """
    design = design_of(plan, None)
    log_x = np.log(resonances_hz / design.resonance_hz[design.channel])
    at_every_stage = np.repeat(log_x[None, :, None], 3, axis=0)
    prints = _unjudged(design, 1, JUDGED)
    _judge_drawn(design, Drawn(at_every_stage, np.zeros_like(at_every_stage)), 0, JUDGED, prints)
    if not np.isfinite(prints.ratio).all():
        return None
    planned, retuned = _decibels(prints.ratio[:, 0]).tolist()
    return planned, retuned


def _decibels(ratio: np.ndarray) -> np.ndarray:
    """Return energy ratios in dB; for a ratio of 0 a very low figure instead of minus infinity."""
    return np.asarray(10 * np.log10(np.maximum(ratio, np.finfo(float).tiny)))


def rising_db(ratio: np.ndarray, share: float) -> tuple[np.ndarray, int]:
    """Return energy ratios (…, pads) in dB, in rising order, and the index of the one that a `share` of pads reach."""
    pads = ratio.shape[-1]
    return np.sort(_decibels(ratio), axis=-1), min(int((1 - share) * pads), pads - 1)


def _unjudged(design: Design, pads: int, stages: tuple[str, ...]) -> Simulated:
    taxels = len(design.channel)
    many = len(stages)
    return Simulated(
        np.full((many, pads), np.inf),
        np.zeros((many, pads), int),
        np.ones((many, pads), bool),
        np.zeros(len(design.q)),
        np.zeros(2),
        np.zeros((many, taxels), int),
        np.zeros((many, taxels), int),
    )


def _judge_drawn(
    design: Design,
    drawn: Drawn,
    before: int,
    stages: tuple[str, ...],
    prints: Simulated,
    later: Drifted | None = None,
    least_share: float = 0.0,
) -> bool:
    """Judge randomly drawn prints at given stages of tuning, and write results into `prints` from pad `before` on.

    With `later` they are judged as they are then, with the tones and lines of now. Stops, and returns False, once less
    than a `least_share` of all prints can be good at the last stage.
    """
    known = [STAGES.index(stage) for stage in stages]
    step = max(BLOCK // len(design.channel), 1)
    prints.square[:] += np.bincount(design.channel, (drawn.log_x[2] ** 2).sum(1), len(design.q))
    for first in range(0, drawn.log_x.shape[2], step):
        pads = slice(first, first + step)
        x, pull = (np.exp(np.clip(part[:, :, pads], -FARTHEST, FARTHEST)) for part in drawn)
        one = np.ones_like(x[:1])
        tones, pulls = (np.concatenate([one, part])[known] for part in (x, pull))
        block = slice(before + first, before + first + x.shape[2])
        now = Ratios(x[2], pull[2])
        if later is not None:
            now = Ratios(x[2] * np.exp(later.log_x[:, pads]), pull[2], np.exp(later.log_q[:, pads]))
        for coils, modes in zip(design.coils, design.modes, strict=True):
            _judge(design, coils, modes, now, Ratios(tones, pulls), stages, prints, block)
        if prints.good[-1].mean() < least_share:
            return False
    return True


def _judge(
    design: Design,
    coils: Coils,
    modes: ModalTaxels | None,
    printed: Ratios,
    known: Ratios,
    stages: tuple[str, ...],
    prints: Simulated,
    block: slice,
) -> None:
    """Compute ON over OFF of alike coils in a block of pads at each stage, and write the results into `prints`.

    `printed` (taxels, pads) is over the plan, `known` (stages, taxels, pads) what tones and lines follow at each of
    `stages`; `modes` are as in `Design`. Before a pad is re-tuned its detuned taxels count, and other modes as planned.
    """
    n = len(coils.channels)
    shape = (*coils.taxels.shape, printed.x.shape[1])
    x = printed.x[coils.taxels].reshape(n, -1)
    pulled = printed.pull[coils.taxels].reshape(n, -1)
    f, q, mass, pull = (v[coils.channels, None] for v in (design.resonance_hz, design.q, design.mass_g, design.pull))
    q_ratio = None
    if printed.q is not None:
        q_ratio = printed.q[coils.taxels].reshape(n, -1)
        q = q * q_ratio
    hz = f * x
    for k, (stage, *followed) in enumerate(zip(stages, known.x, known.pull, strict=True)):
        is_retuned = stage == STAGES[-1]
        printed_modes = _PrintedModes(modes, x, q_ratio) if modes and is_retuned else None
        tone, strength = (part[coils.taxels].reshape(n, -1) for part in followed)
        tone_hz = f * tone
        driven = channels(tone_hz, q, design.law(tone_hz), mass, pull * strength)
        # The line that would move each taxel by its level at its own resonance, over its driven line.
        rise = (hz / tone_hz) ** 2 * strength / pulled
        taxel = Channels(hz, q, driven.line * rise)
        on = (relative_energy(tone_hz, hz, q) / rise**2).reshape(shape)
        off = np.zeros(shape) + design.leaks[int(is_retuned), coils.channels, None, None]
        if n > 1:
            off += off_energy(taxel, design.scheme, printed_modes, driven).reshape(shape)
        if printed_modes is None:
            off += design.others[coils.channels, None, None]
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
FIRST_PADS = 40
"""Pads after which a layout is left whose good share is surely too small."""
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


def what_prints_keep(plan: Plan, design: Design, quick: bool = False) -> Prints:
    """Return the selectivity of simulated prints of `plan`: as many as a sure estimate takes, or few if `quick`."""
    if quick:
        return _simulated(plan, design, few_pads(design), JUDGED)
    return _simulated_until_sure(plan, design, STAGES)


def few_pads(design: Design) -> int:
    """Return how many pads are simulated to compare layouts: fewer where a pad takes much work."""
    return min(QUICK_PADS, pads_until_sure(work_per_pad(design)))


def compared_prints(plan: Plan, least_db: float, least_share: float, quick: bool = False) -> tuple[float, Prints]:
    """Return a pad's selectivity in dB without print errors, and figures of its re-tuned prints, to compare layouts.

    As many prints are simulated as comparing layouts needs: none (`NOT_PRINTED`) if the drawn pad keeps less than
    `least_db`, and few if these show that the share of good ones is surely below `least_share`; with `quick` never
    more. At first other modes add what they add in the plan: to follow them with every line takes several times as
    long.
    """
    exact = design_of(plan, None)
    design = exact._replace(modes=(None,) * len(exact.coils))
    stages = STAGES[-1:]
    ratio = float(simulated_prints(design, spreads_of(plan.spec).none(), 1, 0, stages).ratio.min())
    paper_db = 10 * float(np.log10(ratio)) if ratio > 0 else float("-inf")
    if paper_db < least_db:
        return paper_db, NOT_PRINTED
    few = few_pads(design)
    many = few if quick else max(few, pads_until_sure(work_per_pad(design)))
    rounds = [(design, FIRST_PADS), (design, few), (exact, FIRST_PADS), (exact, few)]
    if many > few:
        rounds.append((exact, many))
    for one, pads in rounds:
        prints = _simulated(plan, one, pads, stages)
        is_below = prints.good_share + SURELY * prints.error_share < least_share
        is_above = one is exact and prints.good_share >= plan.spec.print_share + NEAR_SHARE
        if is_below or (pads >= few and (is_above or prints.good_share == 0)):
            return paper_db, prints
    if quick:
        return paper_db, prints
    # What they keep in dB is sure enough by now to compare layouts.
    pads = pads_until_sure(work_per_pad(exact), prints.error_share, 0.0, many)
    return paper_db, prints if pads == many else _simulated(plan, exact, pads, stages)


def _simulated_until_sure(plan: Plan, design: Design, stages: tuple[str, ...]) -> Prints:
    prints = _simulated(plan, design, pads_until_sure(work_per_pad(design)), stages)
    pads = pads_until_sure(work_per_pad(design), prints.error_share, prints.error_db or 0.0, prints.pads)
    return prints if pads == prints.pads else _simulated(plan, design, pads, stages)


def share_error(share: float, made: int) -> float:
    """Return half the width of Wilson's 95 % interval of a `share` among `made`."""
    z2 = SIGMAS_95**2
    return SIGMAS_95 * sqrt(share * (1 - share) / made + z2 / (4 * made**2)) / (1 + z2 / made)


def quantile_error(rising: np.ndarray, share: float) -> float:
    """Return half the width of the 95 % interval of the value that a `share` of the sorted values reach.

    It lies between two ranks (normal approximation of the binomial distribution).
    """
    made = len(rising)
    away = SIGMAS_95 * sqrt(made * share * (1 - share))
    low, high = (int(np.clip((1 - share) * made + sign * away, 0, made - 1)) for sign in (-1, 1))
    return float(rising[high] - rising[low]) / 2


def pads_until_sure(work_of_pad: float, error_share: float | None = None, error_db: float = 0.0, pads: int = 0) -> int:
    """Return how many pads to simulate: for a first estimate or, given its errors after `pads` pads, for a sure one."""
    first, most = (int(max(limit / work_of_pad, FEWEST)) for limit in (WORK, MOST_WORK))
    if error_share is None:
        return min(PADS, first)
    unsure = max(error_share / SURE_SHARE, error_db / SURE_DB) ** 2
    return int(min(unsure * pads, most)) if unsure > 1 else pads


def _simulated(plan: Plan, design: Design, made: int, stages: tuple[str, ...]) -> Prints:
    spreads = spreads_of(plan.spec)
    columns = plan.coils.columns
    prints = simulated_prints(design, spreads, made, 0, stages)
    share = plan.spec.print_share
    kept, reached = rising_db(prints.ratio, share)
    good = float(prints.good[-1].mean())
    heard = bool(np.isfinite(kept).all())
    of_coils = dict(zip([t.coil for t in plan.taxels], (prints.good_coils[-1] / made).tolist(), strict=True))
    dbs: dict[str, float | None] = dict(zip(stages, kept[:, reached].tolist(), strict=True)) if heard else {}
    return Prints(
        print_db=dbs.get("retuned"),
        planned_db=dbs.get("planned"),
        coupon_db=dbs.get("coupon"),
        some_db=dbs.get("some"),
        good_share=good,
        good_taxel_share=float(prints.good_taxels[-1].mean()) / len(plan.taxels),
        pads=made,
        error_db=quantile_error(kept[-1], share) if heard else None,
        error_share=share_error(good, made),
        ratio_spread=ratio_spread(design, spreads),
        coil_shares=tuple(of_coils.get(divmod(k, columns), 1.0) for k in range(plan.coils.rows * columns)),
    )
