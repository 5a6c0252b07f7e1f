"""Refuse specs whose fields contradict each other."""

from itertools import pairwise
from math import ceil, floor
from typing import Any

from padgen.core.errors import SpecError, at_most, number
from padgen.core.registry import SCHEMES
from padgen.spec.entries import catalogue
from padgen.spec.model import Spec
from padgen.spec.threshold import refuse_threshold

__all__ = ["refuse_contradictions"]

SLACK_MM = 1e-9
"""Rounding by which a sum of fields may exceed its bound."""
MAGNETIC = 2.0
"""Smallest relative permeability of a washer that counts as magnetic."""


def refuse_contradictions(spec: Spec) -> None:
    """Raise `SpecError` for the first contradiction between fields of `spec`."""
    _refuse_band(spec)
    _refuse_parts(spec)
    _refuse_taxel(spec)
    _refuse_plate(spec)
    _refuse_beam(spec)
    refuse_threshold(spec)


def _refuse_band(spec: Spec) -> None:
    low, high = spec.band_hz
    if not low < high:
        raise SpecError(
            f"must run from low to high, got [{number(low)}, {number(high)}] Hz",
            "band_hz",
            [{"band_hz": [high, low]}] if low > high else (),
        )
    bound = spec.delta_y / 4
    if spec.q_min <= bound:
        raise SpecError(
            f"must be above delta_y/4 = {number(bound)} for a coil to hold any channel, got {number(spec.q_min)}",
            "q_min",
            [{"delta_y": float(at_most(2 * spec.q_min))}],
        )
    if spec.coil.sets > 1 and spec.coil.grid == (1, 1):
        raise SpecError(
            "'alternate' needs coils to alternate with, coil.grid is [1, 1]", "coil.reuse", [{"coil.reuse": "same"}]
        )
    tones = spec.resonances_hz or ()
    if len(tones) % spec.coil.sets:
        raise SpecError(
            f"must be an even number with coil.reuse = 'alternate', which gives its two sets one each in turn,"
            f" got {len(tones)}",
            "resonances_hz",
        )
    for lower, upper in pairwise(tones):
        if not lower < upper:
            raise SpecError(
                f"must rise from channel to channel, got {number(lower)} before {number(upper)} Hz", "resonances_hz"
            )
    for tone in tones:
        if not low <= tone <= high:
            raise SpecError(
                f"must lie in the band of {number(low)} … {number(high)} Hz, got {number(tone)} Hz",
                "resonances_hz",
                [{"band_hz": [min(low, tones[0]), max(high, tones[-1])]}],
            )


def _refuse_parts(spec: Spec) -> None:
    if spec.material.process != spec.printer.process:
        raise SpecError(
            f"{spec.material.name!r} is for {spec.material.process} printers, but printer"
            f" {spec.printer.name!r} is {spec.printer.process}",
            "material",
            [{"material": None}],
        )
    if spec.spread.process != spec.printer.process:
        raise SpecError(
            f"{spec.spread.name!r} is of {spec.spread.process} prints, but printer {spec.printer.name!r} is"
            f" {spec.printer.process}",
            "spread",
            [{"spread": None}],
        )
    scheme, amplifier = spec.drive.scheme, spec.amplifier
    if amplifier and amplifier.coupling == "AC" and scheme != "auto" and SCHEMES.get(scheme).CURRENT == "biased":
        raise SpecError(
            f"{scheme!r} has a constant current, which the AC-coupled amplifier {amplifier.name!r} does not pass",
            "drive.scheme",
            [{"drive.scheme": "auto"}, {"amplifier.coupling": "DC"}],
        )
    washer, coil = spec.washer, spec.coil
    if washer.relative_permeability < MAGNETIC:
        raise SpecError(
            f"{washer.name!r} is not magnetic (relative permeability {number(washer.relative_permeability)});"
            " take plain steel or a ferritic or martensitic stainless steel",
            "washer",
        )
    for where, inner, outer in (
        ("washer", washer.inner_diameter_mm, washer.outer_diameter_mm),
        ("coil", coil.inner_diameter_mm, coil.outer_diameter_mm),
    ):
        if not inner < outer:
            raise SpecError(
                f"must be below the outer diameter of {number(outer)} mm, got {number(inner)} mm",
                f"{where}.inner_diameter_mm",
            )
    if coil.gap_mm and coil.gap_mm > coil.outer_diameter_mm:
        raise SpecError(
            f"must be at most the coil's outer diameter of {number(coil.outer_diameter_mm)} mm, beyond which it hardly"
            f" pulls a washer, got {number(coil.gap_mm)} mm",
            "coil.gap_mm",
            [{"coil.gap_mm": coil.outer_diameter_mm}],
        )
    if coil.core_diameter_mm > coil.inner_diameter_mm:
        raise SpecError(
            f"must fit the winding's bore of {number(coil.inner_diameter_mm)} mm,"
            f" got {number(coil.core_diameter_mm)} mm",
            "coil.core_diameter_mm",
            [{"coil.core_diameter_mm": coil.inner_diameter_mm}],
        )


def _refuse_taxel(spec: Spec) -> None:
    taxel, pad, printer = spec.taxel, spec.pad, spec.printer
    depth = spec.recess_depth_mm
    roof = 2 * printer.layer_mm
    if depth + roof > taxel.plate_thickness_mm + SLACK_MM:
        raise SpecError(
            f"must be at least {number(depth + roof)} mm (washer {number(spec.washer.thickness_mm)} mm,"
            f" glue {number(taxel.glue_gap_mm)} mm, up to whole layers, two layers of roof),"
            f" got {number(taxel.plate_thickness_mm)} mm",
            "taxel.plate_thickness_mm",
            _thicker(spec, round(depth + roof, 6)),
        )
    if taxel.plate_thickness_mm > pad.frame_thickness_mm + SLACK_MM:
        raise SpecError(
            f"must not exceed the frame's thickness of {number(pad.frame_thickness_mm)} mm,"
            f" got {number(taxel.plate_thickness_mm)} mm",
            "taxel.plate_thickness_mm",
            [{"pad.frame_thickness_mm": taxel.plate_thickness_mm}],
        )
    boss_height = pad.frame_thickness_mm - taxel.plate_thickness_mm + taxel.boss_protrusion_mm
    edge_bound = min(taxel.boss_diameter_mm / 2, boss_height) * 0.9
    if taxel.boss_edge_mm > edge_bound + SLACK_MM:
        raise SpecError(
            f"must be at most {number(edge_bound)} mm on a boss of {number(taxel.boss_diameter_mm)} mm diameter"
            f" and {number(boss_height)} mm height, got {number(taxel.boss_edge_mm)} mm",
            "taxel.boss_edge_mm",
            [{"taxel.boss_edge_mm": _down(edge_bound)}],
        )
    if pad.rib_mm < printer.line_width_mm - SLACK_MM:
        raise SpecError(
            f"must be at least a line of {number(printer.line_width_mm)} mm, the thinnest wall of {printer.name},"
            f" got {number(pad.rib_mm)} mm",
            "pad.rib_mm",
            [{"pad.rib_mm": printer.line_width_mm}],
        )
    if pad.hole_diameter_mm and pad.hole_diameter_mm + 2 * printer.line_width_mm > pad.border_mm + SLACK_MM:
        most = pad.border_mm - 2 * printer.line_width_mm
        raise SpecError(
            f"must leave a line of wall on both sides in the border of {number(pad.border_mm)} mm, at most"
            f" {number(max(most, 0.0))} mm, got {number(pad.hole_diameter_mm)} mm",
            "pad.hole_diameter_mm",
            [{"pad.hole_diameter_mm": _down(most) if most > 0 else 0}],
        )


def _refuse_plate(spec: Spec) -> None:
    taxel, printer = spec.taxel, spec.printer
    recess = spec.washer.outer_diameter_mm + taxel.washer_clearance_mm
    span = (recess - spec.washer.inner_diameter_mm) / 2 if taxel.centre_post else recess
    if span > printer.longest_bridge_mm + SLACK_MM:
        raise SpecError(
            f"{spec.washer.name!r} needs a recess whose roof spans {number(span)} mm, {printer.name} bridges"
            f" {number(printer.longest_bridge_mm)} mm",
            "washer",
            _bridged(spec),
        )
    walled = spec.washer.outer_diameter_mm + taxel.washer_clearance_mm + 2 * spec.printer.line_width_mm
    bound = max(walled, taxel.boss_diameter_mm)
    for name, value in (("plate_length_mm", taxel.plate_length_mm), ("plate_width_mm", taxel.plate_width_mm)):
        if value is not None and value < bound - SLACK_MM:
            raise SpecError(
                f"must be at least {number(bound)} mm for the washer {spec.washer.name} in its walls and the boss,"
                f" got {number(value)} mm",
                f"taxel.{name}",
                [{f"taxel.{name}": _up(bound)}],
            )


def _thicker(spec: Spec, plate_mm: float) -> list[dict[str, float]]:
    """Return a cure: plates of a thickness in mm, and a frame of the same height if it is lower."""
    frame = {} if plate_mm <= spec.pad.frame_thickness_mm else {"pad.frame_thickness_mm": plate_mm}
    return [{"taxel.plate_thickness_mm": plate_mm, **frame}]


def _bridged(spec: Spec) -> list[dict[str, Any]]:
    """Return cures for a roof too wide to bridge: the largest washer that is not, or a post in the recess."""
    taxel, washer, most_mm = spec.taxel, spec.washer, spec.printer.longest_bridge_mm
    largest = most_mm - taxel.washer_clearance_mm
    sizes = {
        name: entry["outer_diameter_mm"]
        for name, entry in catalogue("washer").items()
        if entry["outer_diameter_mm"] <= largest and entry["relative_permeability"] >= MAGNETIC
    }
    ways: list[dict[str, Any]] = [{"washer": max(sizes, key=lambda name: sizes[name])}] if sizes else []
    if (washer.outer_diameter_mm + taxel.washer_clearance_mm - washer.inner_diameter_mm) / 2 <= most_mm:
        ways.append({"taxel.centre_post": True})
    return ways


def _up(value: float) -> float:
    """Round mm up to a whole micrometre."""
    return ceil(value * 1e3 - SLACK_MM) / 1e3


def _down(value: float) -> float:
    """Round mm down to a whole micrometre."""
    return floor(value * 1e3 + SLACK_MM) / 1e3


def _refuse_beam(spec: Spec) -> None:
    thickness, printer = spec.suspension.thickness_mm, spec.printer
    if thickness is None:
        return
    layers = (thickness - printer.first_layer_mm) / printer.layer_mm + 1
    whole = max(round(layers), printer.smallest_beam_layers)
    if abs(layers - whole) > 1e-6:
        raise SpecError(
            f"must be a whole number of layers (first {number(printer.first_layer_mm)} mm, then"
            f" {number(printer.layer_mm)} mm each), got {number(thickness)} mm",
            "suspension.thickness_mm",
            [{"suspension.thickness_mm": printer.height_mm(whole)}],
        )
    bound = spec.taxel.plate_thickness_mm - printer.layer_mm
    if thickness > bound + SLACK_MM:
        raise SpecError(
            f"must stay a layer below the plate's thickness, at most {number(bound)} mm, got {number(thickness)} mm",
            "suspension.thickness_mm",
            _thicker(spec, round(thickness + printer.layer_mm, 6)),
        )
