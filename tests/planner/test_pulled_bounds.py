"""Bounds of gap and softening over all combinations of core, gap, offset and sag, against the pull itself.

The reference (`finer_models.true_gap` and `true_softening`) solves surface charges where the washer hangs in balance,
and averages them over the swing; a bound may be short by 1 % and 1e-6, the reference's own digits.
"""

from dataclasses import replace
from itertools import product

import numpy as np

import padgen as pg
from padgen.physics.resonator import TaxelModes
from padgen.planner.channels import (
    driven,
    hanging_gap_um,
    mode_fields,
    pull_exponent,
    site_pulls,
    site_wrenches,
    wanted_line_a2,
    working_mode_ratios,
)
from padgen.planner.left_out import _pulled
from tests.finer_models import true_gap, true_softening

SLACK = 1.01


CORES_MM, GAPS_MM, OUT, SAGS = (
    (0, 1, 2, 3, 4, 5, 6),
    (0.4, 0.6, 0.8, 1, 1.5, 2, 3),
    np.linspace(0, 0.7, 8),
    np.linspace(0, 0.5, 5),
)
"""Cores of a coil of 10 mm, gaps, offsets over the coil's diameter, sags over the gap: 1,960 combinations."""


def pulled_bounds(thinned: int = 1) -> tuple[int, list[tuple[object, ...]]]:
    """Return how many combinations of parts and places have both bounds, and a list of those that break one.

    Every `thinned`th combination of `CORES_MM` … `SAGS` is tried, with the first channel and the drive of paper-32,
    moving by a tenth of the gap.
    """
    base = pg.plan("paper-32")
    broken = []
    bounded = 0
    for core_mm, gap_mm, out, sag in [*product(CORES_MM, GAPS_MM, OUT, SAGS)][::thinned]:
        coil = replace(base.spec.coil, core_diameter_mm=core_mm, gap_mm=gap_mm)
        spec = replace(base.spec, coil=coil)
        channel = base.channels[0]
        offset_mm = float(out * coil.outer_diameter_mm)
        gap_um = gap_mm * 1e3
        site = replace(channel.site, washer_mm=(offset_mm, 0.0), coil_distance_mm=offset_mm)
        hanging_um = hanging_gap_um(spec, np.array([sag * gap_um]))
        pulled = site_pulls(spec, [site], hanging_um)
        modes = TaxelModes(np.array(channel.modes_hz), np.array(channel.mode_motions))
        wrenches = site_wrenches(spec, pulled, [site])
        force = float((pulled.pull * working_mode_ratios([modes], wrenches))[0])
        if force <= 0:
            continue
        force_mn = channel.force_mn * 0.1 * gap_um / channel.level_um
        moved = replace(
            channel,
            site=site,
            **mode_fields(modes, wrenches[0]),
            sag_um=sag * gap_um,
            level_um=0.1 * gap_um,
            force_mn=force_mn,
            force_constant_n_per_a2=force,
            line_a2=wanted_line_a2(force_mn, force),
            pull_exponent=float(pull_exponent(pulled, hanging_um)[0]),
        )
        (moved,) = driven(spec, [moved], base.scheme)
        plan = replace(base, spec=spec, channels=(moved,))
        bounds = [float(bound[0]) for bound in _pulled(plan, [moved])]
        if not np.isfinite(bounds).all():
            continue
        bounded += 1
        for term, bound, true in zip(("gap", "softening"), bounds, (true_gap(plan), true_softening(plan)), strict=True):
            if true > SLACK * bound + 1e-6:
                broken.append((term, core_mm, gap_mm, round(offset_mm, 2), sag, bound, true))
    return bounded, broken


def test_no_combination_of_parts_and_places_breaks_the_bounds_of_gap_and_softening():
    """`python docs/measure_force.py bounds` tries all 1,960 of them."""
    bounded, broken = pulled_bounds(thinned=183)
    assert bounded > 6
    assert broken == []
