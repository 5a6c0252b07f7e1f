"""Spec → Plan: search the layouts, size the beams, place the taxels, judge the result."""

from dataclasses import asdict, replace
from itertools import islice

import numpy as np

from padgen.errors import InfeasibleError
from padgen.physics.magnetics import SolenoidCoil, SteelRing, force_constant
from padgen.physics.resonator import ring_up_time
from padgen.physics.selectivity import all_states_db, crosstalk, one_hot_db
from padgen.planner.capacity import channel_limit, coil_capacity
from padgen.planner.judge import judge
from padgen.planner.layout import Layout, candidates
from padgen.planner.plan import Beam, Cell, Channel, CoilGrid, LayoutOption, Plan, Plate, Selectivity, Site, Taxel
from padgen.planner.printing import print_settings
from padgen.planner.search import sites_of, sized_layouts
from padgen.planner.sizing import SizedChannel, frequency_spread
from padgen.planner.taxel_model import fillet_mm, plate_shape, post_diameter_mm, recess_mm
from padgen.spec import Spec
from padgen.units import GRAM, MM, MN, MPA, MS, UM, decibel

__all__ = ["make_plan"]

RUNNERS_UP = 2


def make_plan(spec: Spec) -> Plan:
    """Allot resonances and beams for `spec`.

    Raises
    ------
    InfeasibleError
        No layout holds; the message names the limits of the best candidates and what would do.
    """
    limit = channel_limit(spec)
    options = candidates(spec, limit)
    sized = next(sized_layouts(spec, options), None)
    if sized is None:
        from padgen.planner.infeasible import why_not

        raise InfeasibleError(why_not(spec, options, limit), "resolution")
    layout, channels = sized
    limits = _what_limits(spec, options, layout, limit)
    bare = _assemble(spec, layout, channels, _runners_up(spec, options, layout), limits)
    return replace(bare, findings=judge(spec, bare, channels))


def _assemble(
    spec: Spec, layout: Layout, sized: tuple[SizedChannel, ...], layouts: tuple[LayoutOption, ...], limits: str
) -> Plan:
    sites = sites_of(spec, layout, sized)
    channels = _channels(spec, layout, sized, sites)
    pitch_x, pitch_y = spec.pad.width_mm / layout.columns, spec.pad.depth_mm / layout.rows
    return Plan(
        name=spec.name,
        spec=asdict(spec),
        capacity=coil_capacity(spec, limits),
        coils=CoilGrid(layout.rows, layout.columns, min(pitch_x, pitch_y), pitch_x, pitch_y),
        cell=Cell(layout.sub_columns, layout.sub_rows, layout.sub_width_mm, layout.sub_depth_mm, layout.beam_axis),
        plate=_plate(spec),
        channels=channels,
        taxels=_taxels(spec, layout, sites, sized),
        selectivity=_selectivity(spec, channels),
        layouts=layouts,
        printing=print_settings(spec, [c.beam for c in channels]),
        findings=(),
    )


def _channels(
    spec: Spec, layout: Layout, sized: tuple[SizedChannel, ...], sites: tuple[Site, ...]
) -> tuple[Channel, ...]:
    resonance = np.array([float(s.model.resonance_hz) for s in sized])
    level_um = spec.drive.level_um * (resonance[0] / resonance) ** spec.drive.level_law
    distance_m = np.array([site.coil_distance_mm for site in sites]) * MM
    force_constants = force_constant(*magnetic_parts(spec), spec.coil.gap_mm * MM, distance_m)
    channels = []
    for i, (item, site) in enumerate(zip(sized, sites, strict=True)):
        stiffness = float(item.model.stiffness_n_per_m)
        channels.append(
            Channel(
                index=i,
                resonance_hz=float(resonance[i]),
                drive_hz=float(resonance[i]) / 2,
                q=spec.q_min,
                beam=_beam(spec, item),
                effective_mass_g=float(item.model.effective_mass_kg) / GRAM,
                stiffness_n_per_m=stiffness,
                ring_up_ms=float(ring_up_time(resonance[i], spec.q_min)) / MS,
                level_um=float(level_um[i]),
                rule_hz=float(item.model.rule_hz),
                target_hz=item.target_hz,
                second_mode_hz=item.model.second_mode[0],
                second_mode_share=item.model.second_mode[1],
                modes_hz=tuple(item.model.modes.frequency_hz.tolist()),
                mode_shares=tuple((item.model.compliances * stiffness).tolist()),
                sag_um=float(item.model.sag_m) / UM,
                root_stress_mpa=float(item.model.root_stress_pa(level_um[i] * UM)) / MPA,
                print_spread=float(frequency_spread(item.beam, spec.printer)),
                force_mn=float(level_um[i]) * UM * stiffness / spec.q_min / MN,
                force_constant_n_per_a2=float(force_constants[i]),
                site=site,
            )
        )
    return tuple(channels)


def magnetic_parts(spec: Spec) -> tuple[SolenoidCoil, SteelRing]:
    """The coil and the washer of a spec in SI units."""
    coil, washer = spec.coil, spec.washer
    return (
        SolenoidCoil(
            coil.outer_diameter_mm * MM,
            coil.inner_diameter_mm * MM,
            coil.length_mm * MM,
            coil.turns,
            coil.core_diameter_mm * MM,
            coil.core_relative_permeability,
        ),
        SteelRing(
            washer.outer_diameter_mm * MM,
            washer.inner_diameter_mm * MM,
            washer.thickness_mm * MM,
            washer.relative_permeability,
        ),
    )


def _plate(spec: Spec) -> Plate:
    shape, taxel = plate_shape(spec), spec.taxel
    diameter, depth = recess_mm(spec)
    return Plate(
        *shape,
        recess_diameter_mm=diameter,
        recess_depth_mm=depth,
        post_diameter_mm=post_diameter_mm(spec),
        boss_diameter_mm=taxel.boss_diameter_mm,
        boss_top_mm=spec.pad.frame_thickness_mm + taxel.boss_protrusion_mm,
        boss_edge_mm=taxel.boss_edge_mm,
        gap_mm=spec.printer.smallest_gap_mm,
    )


def _beam(spec: Spec, item: SizedChannel) -> Beam:
    printer = spec.printer
    width, thickness, length = (float(v) for v in item.beam)
    return Beam(
        width_mm=width,
        thickness_mm=thickness,
        length_mm=length,
        topology=item.topology,
        fillet_mm=float(fillet_mm(spec, item.model.arrangement)),
        count=len(item.model.arrangement.beams),
        layers=round((thickness - printer.first_layer_mm) / printer.layer_mm) + 1,
    )


def _taxels(spec: Spec, layout: Layout, sites: tuple[Site, ...], sized: tuple[SizedChannel, ...]) -> tuple[Taxel, ...]:
    """All taxels, coil by coil from the first row; surplus places are left out at the last coils."""
    pitch_x, pitch_y = spec.pad.width_mm / layout.columns, spec.pad.depth_mm / layout.rows
    full = layout.coils - layout.surplus
    taxels = []
    for coil in range(layout.coils):
        row, column = divmod(coil, layout.columns)
        x0 = (column - (layout.columns - 1) / 2) * pitch_x
        y0 = (row - (layout.rows - 1) / 2) * pitch_y
        for channel in range(layout.channels - (coil >= full)):
            x, y = washer_place(sites[channel], float(sized[channel].model.arrangement.washer_x_mm))
            taxels.append(
                Taxel(
                    f"r{row}c{column}k{channel}",
                    (row, column),
                    channel,
                    round(x0 + x, 6),
                    round(y0 + y, 6),
                    sites[channel].coil_distance_mm,
                )
            )
    return tuple(taxels)


def washer_place(site: Site, washer_x_mm: float) -> tuple[float, float]:
    """The washer's axis in mm from the coil axis."""
    x, y = site.origin_mm
    step = washer_x_mm if site.along[0] == "+" else -washer_x_mm
    return (x + step, y) if site.along[1] == "x" else (x, y + step)


def _selectivity(spec: Spec, channels: tuple[Channel, ...]) -> Selectivity:
    resonators = (
        np.array([c.resonance_hz for c in channels]),
        np.array([c.effective_mass_g for c in channels]),
        np.array([c.q for c in channels]),
    )
    even = crosstalk(*resonators, spec.drive.level_law)
    pull = np.array([c.force_constant_n_per_a2 for c in channels])
    placed = crosstalk(*resonators, spec.drive.level_law, pull) if (pull > 0).all() else even
    states, worst = all_states_db(even)
    alone = len(channels) < 2
    return Selectivity(
        drive=spec.drive.scheme,
        level_law=spec.drive.level_law,
        one_hot_db=None if alone else one_hot_db(even),
        all_states_db=None if alone else states,
        worst_state=worst,
        asked_db=decibel(spec.delta_y),
        placed_one_hot_db=None if alone else one_hot_db(placed),
        placed_all_states_db=None if alone else all_states_db(placed)[0],
    )


def _runners_up(spec: Spec, options: list[Layout], chosen: Layout) -> tuple[LayoutOption, ...]:
    """The next layouts that hold as well."""
    others = (layout for layout, _ in sized_layouts(spec, options) if layout is not chosen)
    return tuple(_option(layout) for layout in islice(others, RUNNERS_UP))


def _option(layout: Layout) -> LayoutOption:
    taxels = layout.coils * layout.channels - layout.surplus
    return LayoutOption(layout.rows, layout.columns, layout.channels, taxels, layout.margin_mm)


def _what_limits(spec: Spec, options: list[Layout], layout: Layout, limit: int) -> str:
    """Which limit keeps this pad from more channels per coil, and so from fewer coils."""
    if spec.resonances_hz:
        return "resonances_hz"
    if layout.channels >= limit:
        return "band and Q"
    if layout.coils == 1 or spec.coil.grid:
        return "resolution"
    more = [o for o in options if o.channels > layout.channels and o.coils < layout.coils]
    if not more:
        return "resolution"
    nearest = max(more, key=lambda o: o.margin_mm)
    return LIMITS[nearest.binding[0]] if nearest.margin_mm < 0 else "resonances that print"


LIMITS = {
    "coil": "coil diameter",
    "width": "washer in the sub-cell",
    "length": "beam in the sub-cell",
    "reach": "reach of the coil",
}
