"""Size beams for given resonances: by width alone where that suffices, else by thickness and length as well.

With the beam model a grid of thicknesses (whole layers), lengths (that the room holds) and a few widths is searched.
Choices in which few dimensions differ between channels come first, among them those least sensitive to the printer's
tolerances. The widths are then solved for exactly, and rounded to the steps of the printer.

Where the steps are fine (variable line width) a width is simply rounded. Where they are coarse (whole pixels, whole
lines) a step moves a resonance by several per cent. Other layer counts and lengths then help to come near a target; of
the beams near their targets, the set with the best selectivity is taken.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import islice, pairwise
from math import hypot, sqrt
from typing import Any, NamedTuple

import numpy as np

from padgen.core.registry import SUSPENSIONS
from padgen.physics.ladder import slot_half_width
from padgen.physics.selectivity import channels as resonators
from padgen.planner.plan import level_law, scheme_for, worst_set_db
from padgen.planner.suspensions import BeamShape, Room, allowed, suspension
from padgen.planner.taxel_model import STRAIGHT, Exponents, TaxelModel, narrowest_mm, plate_shape, shortest_mm
from padgen.spec import Printer, Spec, Spread
from padgen.spec.model import Coil, DriveTable, LifeTable, LimitsTable, PadTable, SuspensionTable

__all__ = [
    "DRAWN_SHARE",
    "LENGTH_STEP_MM",
    "STRENGTH_OVER_FATIGUE",
    "STUBBY",
    "IdealBeam",
    "Reach",
    "SizedChannel",
    "beam_inputs",
    "beams_for_resonances",
    "crowded_modes",
    "frequency_spread",
    "printable_beams",
    "printable_widths_mm",
    "reach",
    "steps_are_coarse",
]

STRENGTH_OVER_FATIGUE = 4.0
"""Breaking stress over fatigue stress: the catalogue's fatigue stress is a quarter of the strength."""
DRAWN_SHARE = 1e-3
"""Relative shift of a resonance by drawing a beam to a micrometre: 0.05 % on the smallest beam, doubled."""
LENGTH_STEP_MM = 0.05
COARSE_SHARE = 2e-3
"""Half a step of width over the width, above which rounding moves a resonance by more than 0.1 %."""
WIDTHS_TRIED = 2
LENGTHS_TRIED = 12
MOST_OPTIONS = 60
ROUNDS = 8
STUBBY = 2
"""Length over thickness below which the beam model is inaccurate (docs/accuracy.md); longer beams are taken."""
SLOT_SHARE = 0.5
"""Share of its slot by which a resonance may move from its target for better selectivity."""


class IdealBeam(NamedTuple):
    """A beam for one channel before rounding, with the widths and lengths in mm (from, to) that its room allows."""

    topology: str
    beam: BeamShape
    width_span_mm: tuple[float, float]
    length_span_mm: tuple[float, float]


_Option = tuple[BeamShape, float, float]
"""A printable beam, its resonance in Hz and its mass in kg."""


def steps_are_coarse(spec: Spec) -> bool:
    """Return whether rounding the smallest beam to the printer's steps moves its resonance by over 0.1 %."""
    return spec.printer.width_step_mm / 2 > COARSE_SHARE * spec.printer.smallest_beam_mm


def printable_beams(spec: Spec, ideal: Sequence[IdealBeam], target_hz: np.ndarray) -> list[BeamShape]:
    """Return printable beams for the `ideal` ones, which resonate at `target_hz` (n,)."""
    if not steps_are_coarse(spec):
        return [
            item.beam._replace(width_mm=float(printable_widths_mm(spec, item.beam.width_mm, item.width_span_mm[1])))
            for item in ideal
        ]
    options = [_options(spec, item, float(f)) for item, f in zip(ideal, target_hz, strict=True)]
    if spec.resonances_hz:
        return [nearest[0] for nearest, *_ in options]
    return [beam for beam, *_ in _most_selective(spec, options, target_hz)]


def printable_widths_mm(spec: Spec, width_mm: float | np.ndarray, widest_mm: float) -> np.ndarray:
    """Return the nearest printable widths in mm: the smallest beam plus whole steps, at most `widest_mm`."""
    smallest = spec.printer.smallest_beam_mm
    step = spec.printer.width_step_mm
    least = np.ceil((narrowest_mm(spec) - smallest) / step - 1e-6)
    most = np.floor((widest_mm - smallest) / step + 1e-6)
    return np.asarray(smallest + np.clip(np.round((np.asarray(width_mm) - smallest) / step), least, most) * step)


def _options(spec: Spec, item: IdealBeam, target_hz: float) -> list[_Option]:
    """Return printable beams around the ideal one whose resonances lie near the target, the nearest first.

    Thicknesses are as planned and, where they may differ, one and two layers more: fewer would print less surely.
    """
    ideal = item.beam
    layer_mm = spec.printer.layer_mm
    shortest, longest = item.length_span_mm
    near_mm = ideal.width_mm + spec.printer.width_step_mm * np.arange(-WIDTHS_TRIED, WIDTHS_TRIED + 1)
    widths = np.array(sorted(set(printable_widths_mm(spec, near_mm, item.width_span_mm[1]).tolist())))
    thicknesses = np.array([ideal.thickness_mm])
    lengths = np.array([ideal.length_mm])
    if "thickness" in spec.suspension.tune and spec.suspension.thickness_mm is None:
        thicknesses = np.round(ideal.thickness_mm + layer_mm * np.arange(3), 6)
        thicknesses = thicknesses[thicknesses <= spec.taxel.plate_thickness_mm - layer_mm + 1e-9]
    if "length" in spec.suspension.tune and spec.suspension.length_mm is None:
        lengths = np.round(ideal.length_mm + LENGTH_STEP_MM * np.arange(-LENGTHS_TRIED, LENGTHS_TRIED + 1), 6)
        lengths = lengths[(lengths >= shortest - 1e-9) & (lengths <= longest + 1e-9)]
    beam = BeamShape(*(axis.ravel() for axis in np.meshgrid(widths, thicknesses, lengths, indexing="ij")))
    sound = beam.length_mm >= min(STUBBY, ideal.length_mm / ideal.thickness_mm) * beam.thickness_mm - 1e-9
    beam = BeamShape(*(axis[sound] for axis in beam))
    model = TaxelModel(spec, item.topology, plate_shape(spec), beam)
    miss = np.abs(np.log(model.resonance_hz / target_hz))
    low, high = spec.band_hz
    outside = (model.resonance_hz < low * (1 - DRAWN_SHARE)) | (model.resonance_hz > high * (1 + DRAWN_SHARE))
    if not outside.all():
        miss = np.where(outside, np.inf, miss)
    order = np.lexsort((np.abs(beam.length_mm - ideal.length_mm), miss.round(9)))
    reach = max(slot_half_width(spec.q_min, spec.delta_y) * SLOT_SHARE, float(miss.min()) + 1e-12)
    near = order[miss[order] <= reach][:MOST_OPTIONS]
    figures = zip(*(part[near] for part in (*beam, model.resonance_hz, model.effective_mass_kg)), strict=True)
    return [(BeamShape(*map(float, size)), float(hz), float(kg)) for *size, hz, kg in figures]


def _most_selective(spec: Spec, options: Sequence[Sequence[_Option]], target_hz: np.ndarray) -> list[_Option]:
    """Return one of the printable `options` for each channel, so that together they are as selective as the targets.

    Each begins with the beam nearest to its target. One channel at a time then takes better beams, until the all-state
    selectivity reaches that of the targets.
    """
    scheme = scheme_for(spec, target_hz)

    def kept_db(chosen: Sequence[_Option]) -> float:
        return worst_set_db(spec, np.array([hz for _, hz, _ in chosen]), np.array([kg for *_, kg in chosen]), scheme)

    chosen = [nearest for nearest, *_ in options]
    best = kept_db(chosen)
    enough = worst_set_db(spec, target_hz, np.array([kg for *_, kg in chosen]), scheme)
    for _ in range(ROUNDS):
        before = best
        if best >= enough:
            break
        for i, choices in enumerate(options):
            for option in choices:
                tried = [*chosen[:i], option, *chosen[i + 1 :]]
                tried_db = kept_db(tried)
                if tried_db > best + 1e-9:
                    chosen = tried
                    best = tried_db
        if best <= before + 1e-6:
            break
    return chosen


LENGTHS = 9
WIDTHS = 4
TRIES = 6
MOST_BEAMS = 1200
THICKNESSES = 16
BEYOND_CORNERS = 1.5
"""Factor beyond the resonances of a grid's corners at which none of its bent beams resonates."""


@dataclass(frozen=True, eq=False)
class SizedChannel:
    """One channel's beam for a resonance of `target_hz`, and the model of its taxel."""

    target_hz: float
    topology: str
    beam: BeamShape
    model: TaxelModel


def frequency_spread(beam: BeamShape, spread: Spread, exponents: Exponents = STRAIGHT) -> np.ndarray:
    """Return the relative sigma of ``f ∝ w^a t^b l^c`` among prints of a calibrated printer; `exponents`: (a, b, c)."""
    sigmas = spread.width_mm, hypot(spread.common_z_mm, spread.bed_field_mm, spread.thickness_mm), spread.length_mm
    terms = zip(exponents, sigmas, beam, strict=True)
    square = sum((power * sigma / np.asarray(size)) ** 2 for power, sigma, size in terms)
    return np.asarray((square + (0.5 * spread.common_modulus) ** 2) ** 0.5)


@dataclass(frozen=True)
class Reach:
    """A grid of beams of one topology in one room, with their resonances.

    The grid has `thickness_mm` (T,), `length_mm` (L,) and `width_mm` (T, L, W), from the printer's smallest width to
    the widest that the room holds. `resonance_hz` (T, L, W) rises with the width; it is nan for shapes that are no
    beam. For beams with bends `apart` (T, L, W) is the relative distance of the nearest mode from the working one.
    """

    topology: str
    thickness_mm: np.ndarray
    length_mm: np.ndarray
    width_mm: np.ndarray
    resonance_hz: np.ndarray
    apart: np.ndarray | None

    @cached_property
    def span_hz(self) -> tuple[float, float]:
        """Lowest and highest resonance in Hz."""
        return float(np.nanmin(self.resonance_hz)), float(np.nanmax(self.resonance_hz))

    def widths_for(self, resonance_hz: np.ndarray) -> np.ndarray:
        """Return the widths in mm (n, T, L) that give each of `resonance_hz` (n,); nan where none does."""
        target = np.log(resonance_hz)[:, None, None, None]
        at = np.log(self.resonance_hz)
        width = np.log(self.width_mm)
        low, high = at[..., :-1], at[..., 1:]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (target - low) / (high - low)
        between = width[..., :-1] + share * np.diff(width, axis=-1)
        widths = np.where((target >= low - 1e-9) & (target <= high + 1e-9), between, -np.inf).max(-1)
        return np.where(np.isfinite(widths), np.exp(widths), np.nan)

    def spread(self, width_mm: np.ndarray, spec: Spec) -> np.ndarray:
        """Return the relative sigma (n, T, L) of f among prints, at widths (n, T, L) in mm; inf where the width is nan.

        For beams with bends the exponents are the slopes of the grid at its nearest width, and another mode within the
        half-power width of the working one adds a spread of 100 %.
        """
        beam = BeamShape(width_mm, self.thickness_mm[:, None], self.length_mm)
        spread = frequency_spread(beam, spec.spread)
        if self.apart is not None:
            at = np.log(self.resonance_hz)
            grid = np.log(self.width_mm)
            steps = np.diff(at, axis=-1) / np.diff(grid, axis=-1)
            spreads = [np.concatenate([steps[..., :1], steps], -1)]
            for axis, (size, rule) in enumerate(((self.thickness_mm, STRAIGHT[1]), (self.length_mm, STRAIGHT[2]))):
                slope = np.gradient(at, np.log(size), axis=axis) if len(size) > 1 else np.full(at.shape, rule)
                spreads.append(np.where(np.isnan(slope), rule, slope))
            nearest = np.abs(grid - np.log(width_mm)[..., None]).argmin(-1)[..., None]
            here = [np.take_along_axis(part[None], nearest, -1)[..., 0] for part in (*spreads, self.apart)]
            spread = frequency_spread(beam, spec.spread, (here[0], here[1], here[2])) + (here[3] < 1 / spec.q_min)
        return np.where(np.isnan(width_mm), np.inf, spread)


def layer_thicknesses_mm(printer: Printer, largest_mm: float) -> np.ndarray:
    """Return thicknesses in mm of whole layers up to `largest_mm`: all thin ones, and some of the thick ones."""
    count = int((largest_mm - printer.first_layer_mm) / printer.layer_mm + 1e-9) + 1
    layers = np.arange(printer.smallest_beam_layers, max(count, 1) + 1)
    if len(layers) > THICKNESSES:
        # Not np.unique, which would load all of numpy.ma.
        layers = np.array(sorted({round(n) for n in np.geomspace(layers[0], layers[-1], THICKNESSES).tolist()}))
    return np.round(printer.first_layer_mm + (layers - 1) * printer.layer_mm, 6)


ANY_COIL = Coil("any", 2.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 1.0, gap_mm=1.0)
"""A coil for searches on which the coil has no influence."""


def beam_inputs(spec: Spec) -> Spec:
    """Return `spec` with fixed values in all fields on which beams in a given room do not depend, to share searches.

    Of the coil only the number of sets is kept, of the drive nothing.
    """
    return replace(
        spec,
        name="",
        resolution=1,
        print_share=0.9,
        pad=PadTable(frame_thickness_mm=spec.pad.frame_thickness_mm, rib_mm=spec.pad.rib_mm),
        coil=replace(ANY_COIL, reuse="alternate" if spec.coil.sets > 1 else "same"),
        amplifier=None,
        sound_card=None,
        drive=DriveTable(),
        limits=LimitsTable(),
        life=LifeTable(),
    )


def reach(spec: Spec, topology: str, room: Room, wanted_hz: tuple[float, float] | None = None) -> Reach | None:
    """Return the `Reach` of `topology` in `room`, or None where no such beam fits.

    It may be None, too, where the corners of a grid of bent beams lie so far from `wanted_hz`, lowest and highest, that
    none resonates there: bent beams take a hundred times as long as straight ones.
    """
    # A grid of beams does not depend on what is asked of them, either. `_reach` has the topology as an argument, and
    # `tune` only matters when a beam is chosen from the grid.
    any_ladder = replace(
        beam_inputs(spec),
        band_hz=(1.0, 2.0),
        q_min=1.0,
        delta_y=10.0,
        spacing="spread",
        resonances_hz=None,
        coil=ANY_COIL,
        material=replace(spec.material, youngs_modulus_gpa=1.0),
        suspension=replace(spec.suspension, topology=SuspensionTable().topology, tune=SuspensionTable().tune),
    )
    # Resonances are exactly proportional to the root of the modulus.
    faster = sqrt(spec.material.youngs_modulus_gpa)
    if wanted_hz:
        low, high = (end / faster for end in wanted_hz)
        corners = _bent_corners_hz(any_ladder, topology, room, SUSPENSIONS.changes)
        if corners and (high < corners[0] / BEYOND_CORNERS or low > corners[1] * BEYOND_CORNERS):
            return None
    reached = _reach(any_ladder, topology, room, SUSPENSIONS.changes)
    return reached and replace(reached, resonance_hz=reached.resonance_hz * faster)


def _grid(spec: Spec, topology: str, room: Room) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return the thicknesses, lengths and widths in mm of beams of `topology` in `room`; None where none fits."""
    shape = suspension(topology)
    gap = spec.printer.smallest_gap_mm
    wanted = spec.suspension
    plate = plate_shape(spec)
    longest = shape.longest(room, plate, gap)
    widest = shape.widest(room, plate, gap)
    shortest = shortest_mm(spec, topology)
    narrowest = narrowest_mm(spec)
    if longest < shortest or widest < narrowest:
        return None
    if wanted.thickness_mm:
        thickness = np.array([wanted.thickness_mm])
    else:
        thickness = layer_thicknesses_mm(spec.printer, spec.taxel.plate_thickness_mm - spec.printer.layer_mm)
    if wanted.length_mm:
        length = np.array([wanted.length_mm] if shortest <= wanted.length_mm <= longest + 1e-9 else [])
    else:
        floor = np.floor(longest / LENGTH_STEP_MM + 1e-6) * LENGTH_STEP_MM
        length = np.round(np.linspace(min(shortest, floor), floor, LENGTHS) / LENGTH_STEP_MM) * LENGTH_STEP_MM
        length = np.round(length[length > 0], 6)  # a shortest length below half a step is rounded to 0
    if not len(thickness) or not len(length):
        return None
    return thickness, length, np.geomspace(narrowest, max(widest, narrowest * (1 + 1e-6)), WIDTHS)


def _grid_model(spec: Spec, topology: str, thickness: np.ndarray, length: np.ndarray, width: np.ndarray) -> TaxelModel:
    """Return the beam model of taxels for all combinations (T, L, W) of thicknesses, lengths and widths in mm."""
    thick, long, wide = np.meshgrid(thickness, length, width, indexing="ij", sparse=True)
    return TaxelModel(spec, topology, plate_shape(spec), BeamShape(wide, thick, long))


def _grid_hz(model: TaxelModel) -> np.ndarray:
    """Return the resonances (T, L, W) in Hz of a grid of beams; nan for beams shorter than their thickness."""
    # A piece shorter than its thickness is no beam.
    is_beam = model.beam.length_mm >= model.beam.thickness_mm
    return np.where(is_beam, np.maximum.accumulate(model.resonance_hz, axis=-1), np.nan)


@lru_cache(maxsize=1024)
def _bent_corners_hz(spec: Spec, topology: str, room: Room, changes: int) -> tuple[float, float] | None:
    """Return the lowest and highest resonance in Hz at the corners of a grid of bent beams; None without such beams."""
    grid = _grid(spec, topology, room)
    if grid is None:
        return None
    thickness, length, width = grid
    model = _grid_model(spec, topology, thickness[[0, -1]], length[[0, -1]], width)
    if model.is_straight:
        return None
    resonance = _grid_hz(model)
    if np.isnan(resonance).all():
        return None
    return float(np.nanmin(resonance)), float(np.nanmax(resonance))


@lru_cache(maxsize=256)
def _reach(spec: Spec, topology: str, room: Room, changes: int) -> Reach | None:
    grid = _grid(spec, topology, room)
    if grid is None:
        return None
    thickness, length, width = grid
    model = _grid_model(spec, topology, *grid)
    resonance = _grid_hz(model)
    if np.isnan(resonance).all():
        return None
    wide = np.broadcast_to(width, resonance.shape)
    away = np.sort(np.abs(model.modes.frequency_hz / model.resonance_hz[..., None] - 1))
    return Reach(topology, thickness, length, wide, resonance, None if model.is_straight else away[..., 1])


def beams_for_resonances(spec: Spec, room: Room, resonance_hz: tuple[float, ...]) -> tuple[SizedChannel, ...] | None:
    """Return beams whose taxels resonate at `resonance_hz` in `room`; None where some resonance is out of reach.

    The first choice (in the order of `_choices`) whose other modes lie on no channel wins. If there is none, it is the
    first choice of all, and the plan's findings warn of the modes.
    """
    targets = np.asarray(resonance_hz)
    ends = float(targets.min()), float(targets.max())
    reaches = [r for name in allowed(spec.suspension.topology) if (r := reach(spec, name, room, ends)) is not None]
    first = None
    for tried, channels in enumerate(_solved(spec, _choices(spec, reaches, targets), targets)):
        if channels is None:
            continue
        if not crowded_modes(spec, channels) and not any(_has_doubled_mode(spec, c.model) for c in channels):
            return channels
        first = first or channels
        if tried >= min(TRIES * len(_STEPS), MOST_BEAMS // len(targets)):
            break
    return first


Pick = tuple[Reach, int, int, float]
"""A beam on a grid: its `Reach`, indices of thickness and length, and a first guess of its width in mm."""

_STEPS = ("width", "width+thickness", "width+length", "width+thickness+length")


def _choices(spec: Spec, reaches: list[Reach], targets: np.ndarray) -> Iterator[list[Pick]]:
    """Yield candidate sets of one beam per channel: fewest differing dimensions first, then smallest spread of f."""
    widths = [item.widths_for(targets) for item in reaches]
    tables = [(item, width, item.spread(width, spec)) for item, width in zip(reaches, widths, strict=True)]
    allowed = set(spec.suspension.tune.split("+"))
    kind = spec.suspension.topology
    mixes = len(tables) > 1 and allowed > {"width"}
    # Members of a family differ only in a number, so that mixing them tunes just one more dimension: try this first.
    if mixes and kind != "auto":
        yield from _mixed(tables)
    for step in _STEPS:
        if set(step.split("+")) <= allowed:
            options = (option for table in tables for option in _ranked(step, *table))
            yield from (picks for _, picks in sorted(options, key=lambda option: option[0])[:TRIES])
    if mixes and kind == "auto":
        yield from _mixed(tables)


def _ranked(step: str, item: Reach, width: np.ndarray, spread: np.ndarray) -> list[tuple[float, list[Pick]]]:
    """Return one suspension's best sets of beams that differ only in dimensions named in `step`, with worst spreads."""
    # For each value of the dimensions that all channels share, every channel takes its best value of the others.
    free = [axis for axis, name in ((1, "thickness"), (2, "length")) if name in step]
    best = spread.min(axis=tuple(free), keepdims=True) if free else spread
    worst = best.max(0)
    options = []
    for flat in np.argsort(worst, axis=None, kind="stable")[:TRIES]:
        frozen = np.unravel_index(flat, worst.shape)
        if not np.isfinite(worst[frozen]):
            break
        part = spread[:, *(slice(None) if axis in free else slice(at, at + 1) for axis, at in enumerate(frozen, 1))]
        t, v = np.unravel_index(part.reshape(len(part), -1).argmin(1), part.shape[1:])
        t, v = (size if axis in free else size + at for axis, size, at in zip((1, 2), (t, v), frozen, strict=True))
        picks = [(item, int(ti), int(vi), float(width[i, ti, vi])) for i, (ti, vi) in enumerate(zip(t, v, strict=True))]
        options.append((float(worst[frozen]), picks))
    return options


def _mixed(tables: list[tuple[Reach, np.ndarray, np.ndarray]]) -> Iterator[list[Pick]]:
    """Yield one set of beams, each channel with the suspension of least spread of f; nothing if one is out of reach."""
    picks: list[Pick] = []
    for i in range(len(tables[0][1])):
        item, width, spread = min(tables, key=lambda table: float(table[2][i].min()))
        t, v = (int(at) for at in np.unravel_index(int(spread[i].argmin()), spread[i].shape))
        if not np.isfinite(spread[i, t, v]):
            return
        picks.append((item, t, v, float(width[i, t, v])))
    yield picks


def _solved(
    spec: Spec, choices: Iterator[list[Pick]], targets: np.ndarray
) -> Iterator[tuple[SizedChannel, ...] | None]:
    """Yield the printable beams of each candidate set; None if a resonance is missed or two channels would coincide.

    The first choice usually works. The others are computed several at a time, which is faster, unless the printer's
    steps are coarse: then each beam takes a search of its own.
    """
    at_once = 1 if steps_are_coarse(spec) else 2 * TRIES
    known = dict[tuple[Any, ...], list[Pick]]()
    # With more dimensions free the same beams are often found again: only the first of equal choices is taken.
    keyed = ((tuple((reach.topology, *rest) for reach, *rest in picks), picks) for picks in choices)
    new = (picks for key, picks in keyed if known.setdefault(key, picks) is picks)
    some = list(islice(new, 1))
    while some:
        ideal = _ideal_beams(spec, some, targets)
        beams = [
            beam for channel_beams in ideal if channel_beams for beam in printable_beams(spec, channel_beams, targets)
        ]
        models = iter(_models(spec, [item.topology for channel_beams in ideal for item in channel_beams], beams))
        for channel_beams in ideal:
            solved = zip(targets[: len(channel_beams)].tolist(), models, strict=False)
            channels = tuple(SizedChannel(hz, model.topology, model.beam, model) for hz, model in solved)
            # With steps too coarse for the ladder, two targets may get the same beam.
            apart = all(a.model.resonance_hz < b.model.resonance_hz for a, b in pairwise(channels))
            yield channels if channels and (apart or spec.resonances_hz) else None
        some = list(islice(new, at_once))


def _ideal_beams(spec: Spec, choices: list[list[Pick]], targets: np.ndarray) -> list[list[IdealBeam]]:
    """Return, for each choice, the beams whose widths reach all targets; an empty list for one that misses a target.

    The beams of one topology are solved together, which is faster.
    """
    every = [pick for picks in choices for pick in picks]
    count = len(targets)
    ideal: list[IdealBeam | None] = [None] * len(every)
    for name in dict.fromkeys(reach.topology for reach, *_ in every):
        same_kind = [k for k, pick in enumerate(every) if pick[0].topology == name]
        group, index = np.divmod(same_kind, count)
        sizes = [
            (width, reach.thickness_mm[t], reach.length_mm[v]) for reach, t, v, width in (every[k] for k in same_kind)
        ]
        spans = np.array([reach.width_mm[t, v, [0, -1]] for reach, t, v, _ in (every[k] for k in same_kind)]).T
        beam, solved_hz = _solve_widths(spec, name, BeamShape(*np.array(sizes).T), spans, targets[index], group)
        for at in np.flatnonzero(np.abs(solved_hz / targets[index] - 1) <= RESONANCE_TOLERANCE):
            lengths_mm = every[same_kind[at]][0].length_mm
            shape = BeamShape(*(float(side[at]) for side in beam))
            ends_mm = float(lengths_mm[0]), float(lengths_mm[-1])
            ideal[same_kind[at]] = IdealBeam(name, shape, (float(spans[0, at]), float(spans[1, at])), ends_mm)
    solved = [[beam for beam in ideal[k : k + count] if beam] for k in range(0, len(ideal), count)]
    return [beams if len(beams) == count else [] for beams in solved]


def _models(spec: Spec, names: Sequence[str], beams: Sequence[BeamShape]) -> list[TaxelModel]:
    """Return a model of each beam; those of one topology are computed together, which is faster."""
    plate = plate_shape(spec)
    models: dict[int, TaxelModel] = {}
    for name in dict.fromkeys(names):
        same_kind = [i for i, topology in enumerate(names) if topology == name]
        array = TaxelModel(spec, name, plate, BeamShape(*np.array([beams[i] for i in same_kind], float).T))
        models |= {i: TaxelModel(spec, name, plate, beams[i], member_of=(array, k)) for k, i in enumerate(same_kind)}
    return [models[i] for i in range(len(names))]


RESONANCE_TOLERANCE = 2e-3
"""Relative error of a resonance up to which a solved width is accepted; rounding to the printer's steps adds to it."""


def _solve_widths(
    spec: Spec,
    topology: str,
    beam: BeamShape,
    bounds: np.ndarray,
    targets: np.ndarray,
    group: np.ndarray,
) -> tuple[BeamShape, np.ndarray]:
    """Solve for widths with which beams resonate at `targets` (k,); return the beams and their resonances in Hz.

    Resonances rise with the width, so that a secant in logarithms of both converges. The beams of a `group` (k,) are
    kept as they are once all of the group are solved.
    """
    plate = plate_shape(spec)
    slope = np.full(len(targets), 0.5)
    solved_hz = TaxelModel(spec, topology, plate, beam).resonance_hz
    for _ in range(5):
        miss = np.log(targets / solved_hz)
        is_open = np.isin(group, group[np.abs(miss) >= 1e-5])
        if not is_open.any():
            break
        width = np.where(is_open, np.clip(beam.width_mm * np.exp(miss / slope), *bounds), beam.width_mm)
        step = np.log(width / beam.width_mm)
        before = solved_hz
        beam = beam._replace(width_mm=width)
        solved_hz = TaxelModel(spec, topology, plate, beam).resonance_hz
        secant = np.divide(np.log(solved_hz / before), step, out=slope.copy(), where=np.abs(step) > 1e-9)
        slope = np.clip(secant, 0.1, 3)
    return beam, solved_hz


def _has_doubled_mode(spec: Spec, model: TaxelModel) -> bool:
    """Return whether another mode of beams with bends lies within the half-power width of the working one.

    Without a plane of symmetry two such modes mix.
    """
    hz = np.delete(model.modes.frequency_hz, int(model.working))
    return not model.is_straight and bool((np.abs(hz / model.resonance_hz - 1) < 1 / spec.q_min).any())


def crowded_modes(spec: Spec, channels: tuple[SizedChannel, ...]) -> list[tuple[int, float, int, float]]:
    """Return modes that another channel's tone excites: (channel, its mode in Hz, other channel, relative amplitude).

    A mode lies on a channel if it is in that channel's slot and that channel's force moves it by more than 1/Δy of the
    taxel's own ON amplitude. The response is this ratio at the mode's peak. Modes that a vertical pull at the washer
    does not excite never count.
    """
    half_slot = slot_half_width(spec.q_min, spec.delta_y)
    sets = spec.coil.sets
    resonance = np.array([float(c.model.resonance_hz) for c in channels])
    mass = np.array([float(c.model.effective_mass_kg) for c in channels])
    force = resonators(resonance, spec.q_min, level_law(spec)(resonance), mass).line
    frequency = np.array([c.model.modes.frequency_hz for c in channels])
    compliance = np.array([c.model.compliances for c in channels])
    working = [int(c.model.working) for c in channels]
    crowded = []
    for i, k, j in np.argwhere(np.abs(frequency[..., None] / resonance - 1) < half_slot).tolist():
        response = float(compliance[i, k] / compliance[i, working[i]] * force[j] / force[i])
        if k != working[i] and (i - j) % sets == 0 and response > 1 / spec.delta_y:
            crowded.append((i, float(frequency[i, k]), j, response))
    return crowded
