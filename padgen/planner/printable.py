"""Round beams to the steps of the printer, and fit the ladder of resonances to the rounded beams.

Where the steps are fine (variable line width) a width is simply rounded. Where they are coarse (whole pixels, whole
lines) a step moves a resonance by several per cent. Other layer counts and lengths then help to come near a target; of
the beams near their targets, the set with the best selectivity is taken.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from padgen.physics.ladder import slot_half_width
from padgen.planner.settings import scheme_for, sets_db
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.spec import Spec

__all__ = ["DRAWN_SHARE", "LENGTH_STEP_MM", "STUBBY", "IdealBeam", "on_grid", "printable_beams", "steps_are_coarse"]

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


class _Options(NamedTuple):
    """Printable beams (k,) for one channel, the nearest to its target first, with resonances and masses."""

    beam: BeamShape
    resonance_hz: np.ndarray
    mass_kg: np.ndarray


def steps_are_coarse(spec: Spec) -> bool:
    """Return whether rounding the smallest beam to the printer's steps moves its resonance by over 0.1 %."""
    return spec.printer.width_step_mm / 2 > COARSE_SHARE * spec.printer.smallest_beam_mm


def printable_beams(spec: Spec, ideal: Sequence[IdealBeam], target_hz: np.ndarray) -> list[BeamShape]:
    """Return printable beams for the `ideal` ones, which resonate at `target_hz` (n,)."""
    if not steps_are_coarse(spec):
        return [
            item.beam._replace(width_mm=float(on_grid(spec, item.beam.width_mm, item.width_span_mm[1])))
            for item in ideal
        ]
    options = [_options(spec, item, float(f)) for item, f in zip(ideal, target_hz, strict=True)]
    chosen = _most_selective(spec, options, target_hz) if not spec.resonances_hz else [0] * len(options)
    return [BeamShape(*(float(axis[k]) for axis in o.beam)) for o, k in zip(options, chosen, strict=True)]


def on_grid(spec: Spec, width_mm: float | np.ndarray, widest_mm: float) -> np.ndarray:
    """Return the nearest printable widths in mm: the smallest beam plus whole steps, at most `widest_mm`."""
    smallest, step = spec.printer.smallest_beam_mm, spec.printer.width_step_mm
    most = np.floor((widest_mm - smallest) / step + 1e-6)
    return np.asarray(smallest + np.clip(np.round((np.asarray(width_mm) - smallest) / step), 0, most) * step)


def _options(spec: Spec, item: IdealBeam, target_hz: float) -> _Options:
    """Return printable beams around the ideal one whose resonances lie near the target; the nearest one at least."""
    axes = _widths_mm(spec, item), _thicknesses_mm(spec, item), _lengths_mm(spec, item)
    beam = BeamShape(*(axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")))
    slender = min(STUBBY, item.beam.length_mm / item.beam.thickness_mm)
    sound = beam.length_mm >= slender * beam.thickness_mm - 1e-9
    beam = BeamShape(*(axis[sound] for axis in beam))
    model = TaxelModel(spec, item.topology, plate_shape(spec), beam)
    miss = np.abs(np.log(model.resonance_hz / target_hz))
    low, high = spec.band_hz
    outside = (model.resonance_hz < low * (1 - DRAWN_SHARE)) | (model.resonance_hz > high * (1 + DRAWN_SHARE))
    if not outside.all():
        miss = np.where(outside, np.inf, miss)
    order = np.lexsort((np.abs(beam.length_mm - item.beam.length_mm), miss.round(9)))
    reach = max(slot_half_width(spec.q_min, spec.delta_y) * SLOT_SHARE, float(miss.min()) + 1e-12)
    near = order[miss[order] <= reach][:MOST_OPTIONS]
    return _Options(BeamShape(*(axis[near] for axis in beam)), model.resonance_hz[near], model.effective_mass_kg[near])


def _widths_mm(spec: Spec, item: IdealBeam) -> np.ndarray:
    step = spec.printer.width_step_mm
    around = on_grid(
        spec, item.beam.width_mm + step * np.arange(-WIDTHS_TRIED, WIDTHS_TRIED + 1), item.width_span_mm[1]
    )
    return np.array(sorted(set(around.tolist())))


def _thicknesses_mm(spec: Spec, item: IdealBeam) -> np.ndarray:
    """Return the thicknesses to try: as planned and, where they may differ, one and two layers more.

    Fewer layers would print less surely.
    """
    layer_mm, thickness = spec.printer.layer_mm, item.beam.thickness_mm
    if "thickness" not in spec.suspension.tune or spec.suspension.thickness_mm is not None:
        return np.array([thickness])
    thicker = np.round(thickness + layer_mm * np.arange(3), 6)
    return np.asarray(thicker[thicker <= spec.taxel.plate_thickness_mm - layer_mm + 1e-9])


def _lengths_mm(spec: Spec, item: IdealBeam) -> np.ndarray:
    length, (shortest, longest) = item.beam.length_mm, item.length_span_mm
    if "length" not in spec.suspension.tune or spec.suspension.length_mm is not None:
        return np.array([length])
    around = np.round(length + LENGTH_STEP_MM * np.arange(-LENGTHS_TRIED, LENGTHS_TRIED + 1), 6)
    return np.asarray(around[(around >= shortest - 1e-9) & (around <= longest + 1e-9)])


def _most_selective(spec: Spec, options: Sequence[_Options], target_hz: np.ndarray) -> list[int]:
    """Return the index of the beam that each channel takes of its options.

    Each begins with the beam nearest to its target. One channel at a time then takes better beams, until the all-state
    selectivity reaches that of the targets.
    """
    scheme = scheme_for(spec, target_hz)

    def printed(chosen: list[int]) -> tuple[np.ndarray, np.ndarray]:
        picked = list(zip(options, chosen, strict=True))
        return np.array([o.resonance_hz[k] for o, k in picked]), np.array([o.mass_kg[k] for o, k in picked])

    chosen = [0] * len(options)
    best, enough = (sets_db(spec, hz, printed(chosen)[1], scheme) for hz in (printed(chosen)[0], target_hz))
    for _ in range(ROUNDS):
        before = best
        if best >= enough:
            break
        for i, option in enumerate(options):
            for k in range(len(option.resonance_hz)):
                tried = [*chosen[:i], k, *chosen[i + 1 :]]
                found = sets_db(spec, *printed(tried), scheme)
                if found > best + 1e-9:
                    chosen, best = tried, found
        if best <= before + 1e-6:
            break
    return chosen
