"""Work out how warm coils, air gap and beams get with all taxels on for good, and how far resonances fall.

The pad lies on its tray or board, on a wooden table or on foam (`mount`), in air at rest (`limits.room_c`). Steel in
the pad is left out; it evens temperatures out. The cold pad's drive table is then off the resonances: `Warm` states the
levels that it leaves.
"""

from math import ceil, pi, prod, sqrt
from typing import NamedTuple

import numpy as np

from padgen.core.units import COPPER_C, COPPER_J_PER_M3_K, COPPER_PER_K, G_PER_CM3, MH, MM
from padgen.physics.board_coil import (
    LAMINATE_ACROSS_W_PER_M_K,
    LAMINATE_J_PER_M3_K,
    LAMINATE_W_PER_M_K,
)
from padgen.physics.magnetics import impedance
from padgen.physics.resonator import relative_energy
from padgen.physics.warmth import (
    AIR_W_PER_M_K,
    WARM_ERROR,
    WarmLayers,
    gap_w_per_m2_k,
    temperatures,
)
from padgen.planner.fixtures import FLOOR_MM, HOLE_SHARE, SOCKET_SHARE
from padgen.planner.pad_mass import PadMass
from padgen.planner.plan import TURNS, Plan, Warm, carrier_hz
from padgen.spec.model import Material

__all__ = ["copper_ohm", "planned_warmth", "warm_layers", "warm_resonance_ratio"]

PLASTIC_W_PER_M_K = 0.2
"""Conductivity of printed plastics: data sheets give 0.13 (PLA) to 0.25 (nylon), prints less across their layers."""
WOOD_W_PER_M_K = 0.15
"""Conductivity of wood and chipboard across the grain: 0.12 to 0.17 (Incropera, table A.3)."""
FOAM_W_PER_M_K = 0.035
"""Conductivity of foamed plastics: 0.025 to 0.04 (Incropera, table A.3)."""
WINDING_W_PER_M_K = 2.0
"""Conductivity across the wires of a winding, copper in varnish and air: 1 to 3."""
CONTACT_M = 2e-4
"""Air between tray and table: assumed."""
BOARD_HELD_M = 2e-3
"""Air between a board and the table, on which it stands with the ends of its screws and pins: assumed."""
TYPICAL_GAP_C = 40.0
"""Mean temperature for the radiation through the air gap; 20 K more are 7 % of the gap's conductance."""
PLASTIC_J_PER_KG_K = 1500.0
"""Heat that a kilogram of plastic takes up per K: 1200 to 1800. Coils count as copper throughout."""
WIDEST_CELL_MM = 4.0
"""Widest cell of the thermal grid: heat spreads some 6 mm along a board before it has left it."""
LEAST_SHARE = 0.1
"""Least share of its resonance that a taxel keeps: of so soft a plastic a slope of stiffness says nothing."""


def planned_warmth(plan: Plan) -> Warm:
    """Return the temperatures of a plan's pad with all taxels on for good at their planned level.

    As if each coil had the heat of the one that has most of it.
    """
    spec = plan.spec
    room_c = spec.limits.room_c
    layers = warm_layers(plan)
    warm_c = temperatures(layers, room_c)
    strips = _strips(plan)
    plates_c = _plates_c(plan, _means_of_strips(warm_c[1], *strips))
    coil_c = float(_means_of_strips(warm_c[0], *strips).max())
    beam_c = float(plates_c.max())
    heat_w = plan.load.copper_loss_w * plan.coils.rows * plan.coils.columns
    stored_j = 4 * float((layers.stored_j_per_k * (warm_c - room_c)).sum())
    channel_rise_k = plates_c.mean((1, 2)) - room_c
    cold_hz = np.array([channel.resonance_hz for channel in plan.channels])
    warm_hz = cold_hz * warm_resonance_ratio(spec.material, channel_rise_k)
    mean_coil_c = coil_c
    if heat_w > 0:
        mean_coil_c = float(np.average(warm_c[0], weights=layers.heat_w))
    left = _left_by_currents(plan, cold_hz, warm_hz)
    left_by_voltages = left * _lines_by_voltages(plan, mean_coil_c)
    level_um = np.array([channel.level_um for channel in plan.channels])
    return Warm(
        room_c=room_c,
        heat_w=heat_w,
        coil_c=coil_c,
        gap_c=(coil_c + beam_c) / 2,
        beam_c=beam_c,
        mean_beam_c=float(plates_c.mean()),
        error=WARM_ERROR,
        warm_up_min=stored_j / heat_w / 60 if heat_w > 0 else 0.0,
        resonance_shift=float(warm_resonance_ratio(spec.material, beam_c - room_c)) - 1,
        resonances_hz=tuple(warm_hz.tolist()),
        mean_coil_c=mean_coil_c,
        levels_um=tuple((level_um * left).tolist()),
        lost_db=tuple((-20 * np.log10(left)).tolist()),
        lost_by_voltage_db=tuple((-20 * np.log10(left_by_voltages)).tolist()),
    )


def warm_resonance_ratio(material: Material, rise_k: np.ndarray | float) -> np.ndarray:
    """Return a taxel's resonance with plastic `rise_k` warmer (negative: colder) divided by that at room temperature.

    Half the relative change of the modulus, which is a slope at room temperature.
    """
    return np.maximum(1 - material.softening_per_k / 2 * np.asarray(rise_k), LEAST_SHARE)


def copper_ohm(ohm: float, copper_c: float) -> float:
    """Return the resistance at the copper temperature `copper_c` in °C of a coil of `ohm` at 20 °C."""
    return ohm * (1 + COPPER_PER_K * (copper_c - COPPER_C))


def _left_by_currents(plan: Plan, cold_hz: np.ndarray, warm_hz: np.ndarray) -> np.ndarray:
    """Return the shares (n,) of the planned levels that taxels of the warm pad reach under the cold pad's currents.

    A softer spring gives way more, and its resonance is no longer where the line is. Q is taken to stay.
    """
    q = np.array([channel.q for channel in plan.channels])
    return np.asarray((cold_hz / warm_hz) ** 2 * np.sqrt(relative_energy(cold_hz, warm_hz, q)))


def _lines_by_voltages(plan: Plan, copper_c: float) -> np.ndarray:
    """Return ratios (n,) of the spectral lines of i² with copper at `copper_c` to those with cold copper, at equal V.

    A line is a tone's square, or the product of a tone and the constant current; so it is for spur-free currents as far
    as their tones are small beside the constant.
    """
    coil = plan.spec.coil
    warm_ohm = copper_ohm(coil.resistance_ohm, copper_c)
    hz = np.array([channel.drive_hz for channel in plan.channels])
    carrier = carrier_hz(plan.spec, plan.scheme, max(channel.resonance_hz for channel in plan.channels))
    if carrier is not None:
        hz = np.full(len(hz), carrier)
    cold_z, warm_z = (np.abs(impedance(ohm, coil.inductance_mh * MH, hz)) for ohm in (coil.resistance_ohm, warm_ohm))
    tone = cold_z / warm_z
    other = tone
    if plan.scheme.has_constant and carrier is None:
        other = np.full(len(hz), coil.resistance_ohm / warm_ohm)
    return np.asarray(tone * other)


def _plates_c(plan: Plan, pad_c: np.ndarray) -> np.ndarray:
    """Return the temperatures (n, r, c) in °C of each channel's plate over each coil, by the coil's row and column.

    `pad_c` are those of the pad over each strip of a quarter, its border included.
    A plate is as warm as the cells below it are on the mean. Turned cells are the mean of both ways.
    """
    columns = plan.coils.columns
    rows = plan.coils.rows
    whole = np.concatenate([pad_c, pad_c[:, ::-1][:, columns % 2 :]], 1)
    whole = np.concatenate([whole, whole[::-1][rows % 2 :]])
    by_coil = whole[1:-1, 1:-1].reshape(rows, 3, columns, 3)
    plates = []
    for channel in plan.channels:
        size_mm = (plan.plate.length_mm, plan.plate.width_mm)
        if TURNS[channel.site.along][0] == 0:
            size_mm = size_mm[::-1]
        shares = [
            _strip_shares(pitch_mm, coil_mm, at_mm, side_mm)
            for pitch_mm, coil_mm, at_mm, side_mm in zip(
                (plan.coils.pitch_x_mm, plan.coils.pitch_y_mm),
                _coil_sides_mm(plan),
                channel.site.washer_mm,
                size_mm,
                strict=True,
            )
        ]
        plates.append(np.einsum("risj,i,j->rs", by_coil, shares[1], shares[0]))
    return np.array(plates)


def _strip_shares(pitch_mm: float, side_mm: float, at_mm: float, long_mm: float) -> np.ndarray:
    """Return fractions (3,) of a plate's length before, above and behind its coil, the mean of cells turned and not."""
    lines_mm = np.array([-pitch_mm, -side_mm, side_mm, pitch_mm]) / 2
    within_mm = np.clip(lines_mm, at_mm - long_mm / 2, at_mm + long_mm / 2)
    shares = np.diff(within_mm) / np.ptp(within_mm)
    return np.asarray((shares + shares[::-1]) / 2)


def _coil_sides_mm(plan: Plan) -> tuple[float, float]:
    """Return the sides in mm of a rectangle as large in area as the coil, but smaller than the coil's cell."""
    coil = plan.spec.coil
    share = sqrt(pi) / 2 if coil.shape == "round" else 1.0
    x_mm, y_mm = (share * side_mm for side_mm in coil.sides_mm)
    pitches_mm = [plan.coils.pitch_x_mm, plan.coils.pitch_y_mm]
    if coil.shape == "round":
        pitches_mm = [min(pitches_mm)] * 2
    return min(x_mm, 0.98 * pitches_mm[0]), min(y_mm, 0.98 * pitches_mm[1])


def warm_layers(plan: Plan) -> WarmLayers:
    """Return the thermal grid of a quarter of a plan's pad with its tray or board; the outermost strips are the border.

    Each coil's cell is divided into three by three strips, the coil being a rectangle of its area in the middle.
    """
    spec = plan.spec
    pad = spec.pad
    frame = pad.frame_thickness_mm * MM
    x, y = _strips(plan)
    width = x.width_m
    depth = y.width_m
    area = depth[:, None] * width
    is_border = np.ones(area.shape, bool)
    is_border[y.border :, x.border :] = False
    is_coil = y.is_coil[:, None] & x.is_coil
    lower_of = _board_layer if spec.coil.kind == "board" else _tray_layer
    lower = lower_of(plan, is_coil, is_border)

    # Windows are holes with plates in them that touch nothing: Maxwell's mixture in two dimensions.
    cell = plan.cell
    window_share = max(1 - pad.rib_mm / cell.width_mm, 0.0) * max(1 - pad.rib_mm / cell.depth_mm, 0.0)
    pad_sheet = PLASTIC_W_PER_M_K * frame * np.where(is_border, 1.0, (1 - window_share) / (1 + window_share))
    through = area / (lower.to_pad + frame / 2 / PLASTIC_W_PER_M_K)

    ground = FOAM_W_PER_M_K if spec.mount.kind == "foam" else WOOD_W_PER_M_K
    below = area / lower.to_table
    coil_m2 = prod(_coil_sides_mm(plan)) * MM**2
    heat = np.where(is_coil, plan.load.copper_loss_w * area / coil_m2, 0.0)

    plastic_j_per_m3_k = spec.material.density_g_per_cm3 * G_PER_CM3 * PLASTIC_J_PER_KG_K
    pad_j_per_m2_k = np.full(area.shape, plastic_j_per_m3_k * frame)
    stored = area * np.stack([lower.stored_j_per_m2_k, pad_j_per_m2_k])
    sheet = np.stack([lower.sheet_w_per_k, pad_sheet])
    heights = np.array([lower.height_m, frame])
    to_top = 2 * PLASTIC_W_PER_M_K / frame
    return WarmLayers(width, depth, heat, sheet, through, below, heights, stored, to_top, ground, *_patches(x, y))


MOST_PATCHES = 600
"""Most patches of the table's surface; on larger pads several strips are one."""


def _patches(x: "_Strips", y: "_Strips") -> tuple[np.ndarray, np.ndarray]:
    """Return which row and column of patches of the table's surface each row and column of cells lies over."""
    strips = 1
    while ceil(len(x.first) / strips) * ceil(len(y.first) / strips) > MOST_PATCHES:
        strips *= 2
    rows, columns = (
        np.repeat(np.arange(len(side.first)), np.diff([*side.first, len(side.width_m)])) // strips for side in (y, x)
    )
    return rows, columns


class _LowerLayer(NamedTuple):
    """A tray or board with its coils as the lower layer of a thermal grid: arrays (r, c) in SI units.

    `sheet_w_per_k` is conductivity times thickness, `to_pad` and `to_table` are resistances in m² K/W from it to the
    pad's underside and to the table, `height_m` is that of its outer sides.
    """

    sheet_w_per_k: np.ndarray
    to_pad: np.ndarray
    to_table: np.ndarray
    stored_j_per_m2_k: np.ndarray
    height_m: float


def _tray_layer(plan: Plan, is_coil: np.ndarray, is_border: np.ndarray) -> _LowerLayer:
    """Return the tray with its wound coils as a layer; its rim touches the pad, and it stands on the table."""
    floor, socket_top, coil_top, height = (value * MM for value in _tray_heights_mm(plan))
    beside = PLASTIC_W_PER_M_K * socket_top + AIR_W_PER_M_K * (height - socket_top)
    sheet = np.where(is_border, PLASTIC_W_PER_M_K * height, beside)
    sheet[is_coil] = PLASTIC_W_PER_M_K * floor + WINDING_W_PER_M_K * (coil_top - floor)
    gap = np.where(
        is_coil,
        gap_w_per_m2_k(max(height - coil_top, CONTACT_M), TYPICAL_GAP_C),
        gap_w_per_m2_k(max(height - socket_top, CONTACT_M), TYPICAL_GAP_C),
    )
    rim = height / 2 / PLASTIC_W_PER_M_K
    within = np.where(is_coil, (coil_top - floor) / 2 / WINDING_W_PER_M_K, 0.0)
    hole_share = np.where(is_coil, HOLE_SHARE**2, 0.0)
    floor_w_per_m2_k = (PLASTIC_W_PER_M_K * (1 - hole_share) + AIR_W_PER_M_K * hole_share) / floor
    plastic_j_per_m3_k = plan.spec.material.density_g_per_cm3 * G_PER_CM3 * PLASTIC_J_PER_KG_K
    tray_j_per_m2_k = plastic_j_per_m3_k * np.where(is_border, height, socket_top)
    coil_j_per_m2_k = plastic_j_per_m3_k * floor + COPPER_J_PER_M3_K * (coil_top - floor)
    return _LowerLayer(
        sheet_w_per_k=sheet,
        to_pad=np.where(is_border, rim, within + 1 / gap),
        to_table=np.where(is_border, rim, within + 1 / floor_w_per_m2_k) + CONTACT_M / AIR_W_PER_M_K,
        stored_j_per_m2_k=np.where(is_coil, coil_j_per_m2_k, tray_j_per_m2_k),
        height_m=height,
    )


def _board_layer(plan: Plan, is_coil: np.ndarray, is_border: np.ndarray) -> _LowerLayer:
    """Return the board with its coils as a layer of laminate between two gaps of air.

    Left out are spacers, pins, the strip beyond the pad, and copper: the tracks to the pins would lower rises by 7 to
    9 % (board-32, fingertip-board-24).
    """
    coil = plan.spec.coil
    board = coil.length_mm * MM
    gap_m = max((coil.gap_mm - plan.spec.mover_low_mm) * MM, CONTACT_M)
    even = np.ones(is_coil.shape)
    across = board / 2 / LAMINATE_ACROSS_W_PER_M_K
    return _LowerLayer(
        sheet_w_per_k=LAMINATE_W_PER_M_K * board * even,
        to_pad=even * (across + 1 / gap_w_per_m2_k(gap_m, TYPICAL_GAP_C)),
        to_table=even * (across + 1 / gap_w_per_m2_k(BOARD_HELD_M, TYPICAL_GAP_C)),
        stored_j_per_m2_k=LAMINATE_J_PER_M3_K * board * even,
        height_m=board,
    )


class _Strips(NamedTuple):
    """Strips of the thermal grid along x or y, from a pad's edge to its middle: border, beside a coil, coil, beside, …

    `width_m` and `is_coil` are those of the cells (n,), of which each strip has one or more; `first` is the index of
    each strip's first cell.
    """

    width_m: np.ndarray
    is_coil: np.ndarray
    first: np.ndarray

    @property
    def border(self) -> int:
        """Number of cells in the border."""
        return int(self.first[1])


def _strips(plan: Plan) -> tuple[_Strips, _Strips]:
    """Return the strips of a plan's thermal grid along x and along y."""
    x_mm, y_mm = _coil_sides_mm(plan)
    grid = plan.coils
    border_mm = plan.spec.pad.border_mm
    return (
        _quarter(grid.columns, grid.pitch_x_mm, x_mm, border_mm),
        _quarter(grid.rows, grid.pitch_y_mm, y_mm, border_mm),
    )


def _quarter(coils: int, pitch_mm: float, side_mm: float, border_mm: float) -> _Strips:
    """Return the strips from edge to middle of a pad, with cells of at most `WIDEST_CELL_MM`."""
    beside_mm = (pitch_mm - side_mm) / 2
    strips_mm = [border_mm, *([beside_mm, side_mm, beside_mm] * coils), border_mm]
    is_coil = [False, *([False, True, False] * coils), False]
    half = (len(strips_mm) + 1) // 2
    if len(strips_mm) % 2:
        strips_mm[half - 1] /= 2
    cells = np.array([max(ceil(strip_mm / WIDEST_CELL_MM), 1) for strip_mm in strips_mm[:half]])
    return _Strips(
        width_m=np.repeat(np.array(strips_mm[:half]) / cells, cells) * MM,
        is_coil=np.repeat(is_coil[:half], cells),
        first=np.cumsum(cells) - cells,
    )


def _means_of_strips(cells: np.ndarray, x: _Strips, y: _Strips) -> np.ndarray:
    """Return the means (r, c) of a grid's cells over each strip's width and depth."""
    by_column = np.add.reduceat(cells * x.width_m, x.first, axis=1) / np.add.reduceat(x.width_m, x.first)
    by_row = np.add.reduceat(by_column * y.width_m[:, None], y.first, axis=0)
    return np.asarray(by_row / np.add.reduceat(y.width_m, y.first)[:, None])


def _tray_heights_mm(plan: Plan) -> tuple[float, float, float, float]:
    """Return the heights in mm of a tray's floor, sockets, coils and rim; typical ones where no tray can be made."""
    tray = PadMass(plan).tray
    if tray is None:
        coil = plan.spec.coil
        height_mm = FLOOR_MM + coil.length_mm + coil.gap_mm - plan.spec.mover_low_mm
        return FLOOR_MM, FLOOR_MM + SOCKET_SHARE * coil.length_mm, FLOOR_MM + coil.length_mm, height_mm
    return tray.floor_mm, tray.socket_top_mm, tray.coil_top_mm, tray.height_mm
