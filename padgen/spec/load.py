"""Load a `Spec` from a TOML file or a template, fill in its catalogue entries, and refuse contradictions.

The catalogues hold materials, printers, their spreads, washers, magnets, ballast and coils. The user's curve of
detection thresholds over frequency is a CSV file, or two lists in the spec. The fields also make the JSON schema, with
which editors complete and check spec files.
"""

import csv
import io
import json
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from copy import deepcopy
from dataclasses import MISSING, asdict, fields, is_dataclass, replace
from functools import cache
from itertools import pairwise
from math import floor, inf, log, log10
from pathlib import Path
from typing import Any, get_args

from padgen.core.errors import FileError, SpecError, at_most, number, shown
from padgen.core.files import read_as_one, read_bounded, reason
from padgen.core.registry import COILS, MOVERS, SCHEMES
from padgen.core.rules import Rule, RuleBook, refuse
from padgen.spec.fields import build, choices, optional_type, unknown_name
from padgen.spec.model import (
    MAGNETIC,
    Amplifier,
    Ballast,
    Coil,
    ContactorTable,
    DriveTable,
    GuardTable,
    LifeTable,
    LimitsTable,
    Magnet,
    Material,
    Model,
    MountTable,
    MoverTable,
    PadTable,
    Printer,
    SoundCard,
    Spec,
    Spread,
    SuspensionTable,
    TaxelTable,
    TouchTable,
    Washer,
)

__all__ = [
    "CARRIED_HEADROOM",
    "CATALOGUES",
    "SEARCHED",
    "SHORTHANDS",
    "SPEC_RULES",
    "as_table",
    "catalogue",
    "find_spec",
    "is_resizable",
    "laid_over",
    "load_spec",
    "make_spec",
    "matches_spec",
    "parse_spec",
    "parse_toml",
    "read_table",
    "read_toml",
    "spec_schema",
    "spread_of",
    "still_searched",
    "template_paths",
    "with_threshold",
    "without_none",
]


SLACK_MM = 1e-9
"""Rounding by which a sum of fields may exceed its bound."""


def _q_rule(spec: Spec, is_in_db: bool = False) -> Rule:
    """Return the rule that `q_min` exceeds a quarter of `delta_y`; with `is_in_db` it is worded in decibels."""
    bound = spec.delta_y / 4
    name = IN_DB if is_in_db else "delta_y"
    asked = 20 * log10(spec.delta_y) if is_in_db else spec.delta_y
    most = 20 * log10(2 * spec.q_min) if is_in_db else 2 * spec.q_min
    return Rule(
        spec.q_min > bound,
        "q_min",
        f"must be above {number(bound)} (delta_y/4) for a coil to hold a channel at {name} = {number(asked)}, got"
        f" {number(spec.q_min)}",
        [{name: float(at_most(most))}],
    )


def _band_rules(spec: Spec) -> list[Rule]:
    low, high = spec.band_hz
    tones = spec.resonances_hz or ()
    return [
        Rule(
            low < high,
            "band_hz",
            f"must run from low to high, got [{number(low)}, {number(high)}] Hz",
            [{"band_hz": [high, low]}] if low > high else (),
        ),
        _q_rule(spec),
        Rule(
            spec.coil.sets == 1 or spec.coil.grid != (1, 1),
            "coil.reuse",
            "'alternate' needs coils to alternate with, coil.grid is [1, 1]",
            [{"coil.reuse": "same"}],
        ),
        Rule(
            len(tones) % spec.coil.sets == 0,
            "resonances_hz",
            "must be an even number with coil.reuse = 'alternate', which gives its two sets one each in turn,"
            f" got {len(tones)}",
        ),
        *(
            Rule(
                lower < upper,
                "resonances_hz",
                f"must rise from channel to channel, got {number(lower)} before {number(upper)} Hz",
            )
            for lower, upper in pairwise(tones)
        ),
        *(
            Rule(
                low <= tone <= high,
                "resonances_hz",
                f"must lie in the band of {number(low)} … {number(high)} Hz, got {number(tone)} Hz",
                [{"band_hz": [min(low, tones[0]), max(high, tones[-1])]}],
            )
            for tone in tones
        ),
    ]


def _parts_rules(spec: Spec) -> list[Rule]:
    material = spec.material
    spread = spec.spread
    printer = spec.printer
    moved = spec.washer_or_magnet
    coil = spec.coil
    scheme = spec.drive.scheme
    blocked_by = spec.blocked_by
    return [
        Rule(
            material.process == printer.process,
            "material",
            f"{material.name!r} is for {material.process} printers, but printer {printer.name!r} is {printer.process}",
            [{"material": None}],
        ),
        *(
            Rule(
                not is_planned_by or ratio is not None,
                f"material.{name}_ratio",
                f"is missing, by which material.{name} = true plans {material.name!r}",
                [{f"material.{name}": False}],
            )
            for name, is_planned_by, ratio in (
                ("dynamic", material.dynamic, material.dynamic_ratio),
                ("wet", material.wet, material.wet_ratio),
            )
        ),
        Rule(
            spread.process == printer.process,
            "spread",
            f"{spread.name!r} is of {spread.process} prints, but printer {printer.name!r} is {printer.process}",
            [{"spread": None}],
        ),
        Rule(
            not blocked_by or scheme == "auto" or SCHEMES.get(scheme).CURRENT != "biased",
            "drive.scheme",
            f"{scheme!r} has a constant current, which {blocked_by} does not pass",
            [{"drive.scheme": "auto"}, spec.dc_coupling_change],
        ),
        *_scheme_rules(spec),
        *_sound_card_rules(spec),
        Rule(
            spec.mount.q is None or spec.mount.stiffness_n_per_m is not None,
            "mount.q",
            f"is of the motion on mount.stiffness_n_per_m, which is absent; got {number(spec.mount.q or 0)}",
            [{"mount.q": None}],
        ),
        *_mover_rules(spec),
        *(
            Rule(
                part.inner_diameter_mm < part.outer_diameter_mm,
                f"{where}.inner_diameter_mm",
                f"must be below the outer diameter of {number(part.outer_diameter_mm)} mm, got"
                f" {number(part.inner_diameter_mm)} mm",
            )
            for where, part in ((spec.mover_table_name, moved), ("coil", coil))
        ),
        Rule(
            not coil.gap_mm or coil.gap_mm <= coil.outer_diameter_mm,
            "coil.gap_mm",
            f"must be at most the coil's outer diameter of {number(coil.outer_diameter_mm)} mm, beyond which it hardly"
            f" pulls a {spec.mover.kind}, got {number(coil.gap_mm or 0)} mm",
            [{"coil.gap_mm": coil.outer_diameter_mm}],
        ),
        Rule(
            coil.shape == "round" or coil.kind == "board",
            "coil.shape",
            f"must be 'round' of coils of kind {coil.kind!r}, got {coil.shape!r}",
            [{"coil.shape": "round"}],
        ),
        Rule(
            coil.outer_depth_mm is None or coil.shape == "rectangular",
            "coil.outer_depth_mm",
            f"is of coils whose coil.shape is 'rectangular', got {number(coil.outer_depth_mm or 0)} mm",
            [{"coil.outer_depth_mm": None}],
        ),
        Rule(
            coil.shape == "round" or spec.mover.kind == "magnet",
            "coil.shape",
            f"must be 'round' of coils that pull {spec.mover.kind}s, got {coil.shape!r}: rectangular coils are planned"
            " with magnets",
            [{"coil.shape": "round"}, {"magnet": DEFAULT_PARTS["magnet"], "washer": None}],
        ),
        Rule(
            coil.sizing == "given" or is_resizable(coil),
            "coil.sizing",
            f"must be 'given' of coils of kind {coil.kind!r}, got {coil.sizing!r}",
            [{"coil.sizing": "given"}],
        ),
        Rule(
            coil.core_diameter_mm <= coil.inner_diameter_mm,
            "coil.core_diameter_mm",
            f"must fit the winding's bore of {number(coil.inner_diameter_mm)} mm, got"
            f" {number(coil.core_diameter_mm)} mm",
            [{"coil.core_diameter_mm": coil.inner_diameter_mm}],
        ),
    ]


POWERS = {1: "the current", 2: "the square of the current"}
"""Quantity that a force is proportional to, by its order in the current."""


def _scheme_rules(spec: Spec) -> Iterator[Rule]:
    """Yield the rule that a named drive scheme suits the force: quadratic in current on washers, linear on magnets."""
    scheme = spec.drive.scheme
    if scheme != "auto":
        order = spec.force_order
        yield Rule(
            getattr(SCHEMES.get(scheme), "FORCE_ORDER", 2) == order,
            "drive.scheme",
            f"{scheme!r} is for a force that goes with {POWERS[3 - order]}, that on a {spec.mover.kind} goes with"
            f" {POWERS[order]}",
            [{"drive.scheme": "auto"}],
        )


def _mover_rules(spec: Spec) -> Iterator[Rule]:
    """Yield the rules of the part that the coil moves: a washer is magnetic, a magnet's remanence and ballast fit."""
    if washer := spec.washer:
        yield Rule(
            washer.relative_permeability >= MAGNETIC,
            "washer",
            f"{washer.name!r} is not magnetic (relative permeability {number(washer.relative_permeability)});"
            " take plain steel or a ferritic or martensitic stainless steel",
        )
    if magnet := spec.magnet:
        yield Rule(
            magnet.remanence_low_t <= magnet.remanence_high_t,
            "magnet.remanence_low_t",
            f"must be at most magnet.remanence_high_t = {number(magnet.remanence_high_t)} T, got"
            f" {number(magnet.remanence_low_t)} T",
            [{"magnet.remanence_low_t": magnet.remanence_high_t}],
        )
        yield Rule(
            spec.coil.core_diameter_mm == 0 or spec.ballast is None or not spec.ballast.is_magnetic,
            "ballast",
            f"must not be magnetic over a coil with a core, whose pull on a magnet with steel on it is not known, got"
            f" {spec.ballast.name if spec.ballast else ''!r}",
            [{"coil": "air-10"}],
        )


def _sound_card_rules(spec: Spec) -> Iterator[Rule]:
    """Yield the rules of a sound card's high-pass corner: given if AC coupled, absent if DC, at most `band_hz[0]`."""
    card = spec.sound_card
    low = spec.band_hz[0]
    if card is None:
        return
    where = "sound_card.corner_hz"
    yield Rule(
        card.coupling == "DC" or card.corner_hz is not None,
        where,
        f"is missing, the corner of the high-pass of the AC-coupled sound card {card.name!r}, which its lines are made"
        " good by; measure or ask its maker",
        [{where: min(COMMON_CORNER_HZ, low)}, {"sound_card.coupling": "DC"}],
    )
    yield Rule(
        card.coupling == "AC" or card.corner_hz is None,
        where,
        f"is of a high-pass, which the DC-coupled sound card {card.name!r} has not, got {number(card.corner_hz or 0)}"
        " Hz",
        [{where: None}, {"sound_card.coupling": "AC"}],
    )
    # The lowest line is at half the lowest resonance. There the high-pass takes 7 dB from it at most.
    yield Rule(
        (card.corner_hz or 0.0) <= low,
        where,
        f"must be at most band_hz[0] = {number(low)} Hz, or too little is left of the lowest lines to be made good, got"
        f" {number(card.corner_hz or 0)} Hz",
        [{where: low}, {"sound_card.coupling": "DC", where: None}],
    )


def _ballast_rules(spec: Spec) -> Iterator[Rule]:
    """Yield the rules of ballast: bore below width, no centre post, the roof over it thick and narrow enough."""
    ballast = spec.ballast
    if ballast is None:
        return
    taxel = spec.taxel
    yield Rule(
        ballast.inner_diameter_mm < ballast.width_mm,
        "ballast.inner_diameter_mm",
        f"must be below its width of {number(ballast.width_mm)} mm, got {number(ballast.inner_diameter_mm)} mm",
    )
    yield Rule(
        not taxel.centre_post,
        "taxel.centre_post",
        f"must be false under ballast, since {ballast.name!r} is pressed in through the recess, got true",
        [{"taxel.centre_post": False}],
    )
    least = round(spec.pocket_top_mm + 2 * spec.printer.layer_mm, 6)
    low = spec.pocket_top_mm - ballast.height_mm
    room = taxel.plate_thickness_mm - 2 * spec.printer.layer_mm
    fits = least <= taxel.plate_thickness_mm + SLACK_MM
    yield Rule(
        fits,
        "ballast",
        f"{ballast.name!r} of {number(ballast.height_mm)} mm over the {spec.mover.kind} and glue of {number(low)} mm"
        f" must leave two layers of roof in the plate of {number(taxel.plate_thickness_mm)} mm, which has room for"
        f" {number(max(room - low, 0.0))} mm: a longer part would be pressed out towards the coil",
        () if fits else [*_flatter_ballast(spec, room), *_thicker(spec, least)],
    )
    bridged = spec.printer.longest_bridge_mm
    spans = ballast.corners_mm <= bridged + SLACK_MM
    yield Rule(
        spans,
        "ballast",
        f"{ballast.name!r} needs a pocket whose roof spans {number(ballast.corners_mm)} mm, {spec.printer.name}"
        f" bridges {number(bridged)} mm",
        () if spans else _flatter_ballast(spec, room, bridged),
    )


def _flatter_ballast(spec: Spec, top_mm: float, widest_mm: float = inf) -> list[dict[str, Any]]:
    """Return the change to the heaviest ballast that is at most `widest_mm` wide and ends by `top_mm`; [] if none."""
    fitting = {}
    for name in catalogue("ballast"):
        ballast = _catalogue_entry("ballast", name, OWN)
        other = replace(spec, ballast=ballast)
        if other.pocket_top_mm <= top_mm + SLACK_MM and ballast.corners_mm <= widest_mm:
            fitting[name] = ballast.mass_g
    return [{"ballast": max(fitting, key=lambda name: fitting[name])}] if fitting else []


def _taxel_rules(spec: Spec) -> list[Rule]:
    taxel = spec.taxel
    pad = spec.pad
    printer = spec.printer
    moved = spec.washer_or_magnet
    least = spec.recess_depth_mm + 2 * printer.layer_mm
    boss_height = spec.contact_top_mm - taxel.plate_thickness_mm
    edge_bound = min(taxel.boss_diameter_mm / 2, boss_height) * 0.9
    most = pad.border_mm - 2 * printer.line_width_mm
    recess = moved.outer_diameter_mm + taxel.washer_clearance_mm
    span = (recess - moved.inner_diameter_mm) / 2 if taxel.centre_post else recess
    across = max(recess, spec.ballast.corners_mm if spec.ballast else 0.0)
    along = max(recess, spec.ballast.width_mm if spec.ballast else 0.0)
    boss = spec.contact_diameter_mm if spec.pin_share is None else 0.0
    length, width = (max(side + 2 * printer.line_width_mm, boss) for side in (along, across))
    held = f"{spec.mover.kind} {moved.name}" + (f" and {spec.ballast.name}" if spec.ballast else "")
    return [
        Rule(
            least <= taxel.plate_thickness_mm + SLACK_MM,
            "taxel.plate_thickness_mm",
            f"must be at least {number(least)} mm ({spec.mover.kind} {number(moved.thickness_mm)} mm,"
            f" glue {number(taxel.glue_gap_mm)} mm, up to whole layers, two layers of roof),"
            f" got {number(taxel.plate_thickness_mm)} mm",
            _thicker(spec, round(least, 6)),
        ),
        Rule(
            taxel.plate_thickness_mm <= pad.frame_thickness_mm + SLACK_MM,
            "taxel.plate_thickness_mm",
            f"must not exceed the frame's thickness of {number(pad.frame_thickness_mm)} mm,"
            f" got {number(taxel.plate_thickness_mm)} mm",
            [{"pad.frame_thickness_mm": taxel.plate_thickness_mm}],
        ),
        Rule(
            taxel.boss_edge_mm <= edge_bound + SLACK_MM or spec.contactor != ContactorTable(),
            "taxel.boss_edge_mm",
            f"must be at most {number(edge_bound)} mm on a boss of {number(taxel.boss_diameter_mm)} mm diameter"
            f" and {number(boss_height)} mm height, got {number(taxel.boss_edge_mm)} mm",
            [{"taxel.boss_edge_mm": _down(edge_bound)}],
        ),
        Rule(
            pad.rib_mm >= printer.line_width_mm - SLACK_MM,
            "pad.rib_mm",
            f"must be at least a line of {number(printer.line_width_mm)} mm, the thinnest wall of {printer.name},"
            f" got {number(pad.rib_mm)} mm",
            [{"pad.rib_mm": printer.line_width_mm}],
        ),
        Rule(
            not pad.hole_diameter_mm or pad.hole_diameter_mm <= most + SLACK_MM,
            "pad.hole_diameter_mm",
            f"must leave a line of wall on both sides in the border of {number(pad.border_mm)} mm, at most"
            f" {number(max(most, 0.0))} mm, got {number(pad.hole_diameter_mm)} mm",
            [{"pad.hole_diameter_mm": _down(most) if most > 0 else 0}],
        ),
        Rule(
            span <= printer.longest_bridge_mm + SLACK_MM,
            spec.mover_table_name,
            f"{moved.name!r} needs a recess whose roof spans {number(span)} mm, {printer.name} bridges"
            f" {number(printer.longest_bridge_mm)} mm",
            _bridged(spec),
        ),
        *(
            Rule(
                value is None or value >= side - SLACK_MM,
                f"taxel.{name}",
                f"must be at least {number(side)} mm for the {held} in its walls and the boss,"
                f" got {number(value or 0)} mm",
                [{f"taxel.{name}": -_down(-side)}],
            )
            for name, value, side in (
                ("plate_length_mm", taxel.plate_length_mm, length),
                ("plate_width_mm", taxel.plate_width_mm, width),
            )
        ),
    ]


def _contactor_rules(spec: Spec) -> Iterator[Rule]:
    """Yield the rules of the contactor (boss or pin that meets the skin) and of the guard plate round it."""
    printer = spec.printer
    least_mm = printer.least_pin_mm
    diameter_mm = spec.contact_diameter_mm
    yield Rule(
        spec.contactor == ContactorTable() or diameter_mm >= least_mm - SLACK_MM,
        "contactor.diameter_mm",
        f"must be at least {number(least_mm)} mm, the thinnest pin that {printer.name} prints, got"
        f" {number(diameter_mm)} mm",
        [{"contactor.diameter_mm": least_mm}, *_finer_printers(spec)],
    )
    rise_mm = spec.contact_top_mm - spec.taxel.plate_thickness_mm
    yield Rule(
        spec.contactor.shape == "flat" or diameter_mm / 2 <= rise_mm + SLACK_MM,
        "contactor.shape",
        f"'dome' is half a ball, {number(diameter_mm / 2)} mm high, and this contactor rises {number(rise_mm)} mm above"
        " the plate",
        [
            {"contactor.shape": "flat"},
            {"contactor.protrusion_mm": -_down(-(spec.contact_proud_mm + diameter_mm / 2 - rise_mm))},
        ],
    )
    if not spec.guard.thickness_mm:
        return
    yield Rule(
        spec.contact_proud_mm >= printer.layer_mm - SLACK_MM,
        "contactor.protrusion_mm",
        "must let the pin stand proud of the guard plate by a layer, or a hand that rests on the plate never touches"
        f" it: at least {number(printer.layer_mm)} mm, got {number(spec.contact_proud_mm)} mm",
        [{"contactor.protrusion_mm": printer.layer_mm}],
    )
    hole_mm = spec.guard_hole_mm
    free_mm = diameter_mm + 2 * printer.smallest_gap_mm
    yield Rule(
        hole_mm >= free_mm - SLACK_MM,
        "guard.hole_diameter_mm",
        f"must leave a gap of {number(printer.smallest_gap_mm)} mm round the pin of {number(diameter_mm)} mm, or the"
        f" hole catches it: at least {number(free_mm)} mm, got {number(hole_mm)} mm",
        [{"guard.hole_diameter_mm": -_down(-free_mm)}],
    )


def _finer_printers(spec: Spec) -> Iterator[dict[str, Any]]:
    """Yield spec changes to propose: each catalogue printer that prints the spec's pin, the coarsest first."""
    makers = {
        name: entry["smallest_pin_mm"]
        for name, entry in catalogue("printer").items()
        if (entry["smallest_pin_mm"] or LARGEST_PIN_MM) <= spec.contact_diameter_mm
    }
    for name in sorted(makers, key=lambda name: -makers[name]):
        yield {"printer": name}


LARGEST_PIN_MM = 1e3
"""Diameter of a pin that every printer prints."""


def _thicker(spec: Spec, plate_mm: float) -> list[dict[str, float]]:
    """Return a spec change to propose: plates `plate_mm` thick, and the frame as thick where it is thinner."""
    frame = {} if plate_mm <= spec.pad.frame_thickness_mm else {"pad.frame_thickness_mm": plate_mm}
    return [{"taxel.plate_thickness_mm": plate_mm, **frame}]


def _bridged(spec: Spec) -> list[dict[str, Any]]:
    """Return spec changes for a recess roof too wide to bridge: a smaller washer or magnet, or a post in the recess."""
    taxel = spec.taxel
    moved = spec.washer_or_magnet
    most_mm = spec.printer.longest_bridge_mm
    largest = most_mm - taxel.washer_clearance_mm
    sizes = {
        name: entry["outer_diameter_mm"]
        for name, entry in catalogue(spec.mover_table_name).items()
        if entry["outer_diameter_mm"] <= largest and entry.get("relative_permeability", MAGNETIC) >= MAGNETIC
    }
    ways: list[dict[str, Any]] = [{spec.mover_table_name: max(sizes, key=lambda name: sizes[name])}] if sizes else []
    if (moved.outer_diameter_mm + taxel.washer_clearance_mm - moved.inner_diameter_mm) / 2 <= most_mm:
        ways.append({"taxel.centre_post": True})
    return ways


def _down(value: float) -> float:
    """Round mm down to a whole micrometre."""
    return floor(value * 1e3 + SLACK_MM) / 1e3


WIDEST_LINE = 2.0
HIGHEST_LAYER = 0.8
"""Most width of a line and most height of a layer over the nozzle's diameter: beyond them no plastic reaches."""


def _nozzle_rules(spec: Spec) -> list[Rule]:
    """Return the rules that bound line width and layer height by the nozzle's diameter; none for resin."""
    printer = spec.printer
    if printer.process != "fdm":
        return []
    return [
        Rule(
            value <= share * printer.nozzle_mm + SLACK_MM,
            f"printer.{field}",
            f"must be at most {number(share)} times the nozzle of {number(printer.nozzle_mm)} mm, so"
            f" {number(share * printer.nozzle_mm)} mm, got {number(value)} mm",
            [{f"printer.{field}": round(share * printer.nozzle_mm, 9)}],
        )
        for field, value, share in (
            ("line_width_mm", printer.line_width_mm, WIDEST_LINE),
            ("layer_mm", printer.layer_mm, HIGHEST_LAYER),
            ("first_layer_mm", printer.first_layer_mm, HIGHEST_LAYER),
        )
    ]


LEAST_PRINTED_MM = 0.01
"""Least thickness and width of a beam as it prints, that of the fields for both."""


def _printed_rules(spec: Spec) -> list[Rule]:
    """Return the rules that beams, with printer offsets, still print `LEAST_PRINTED_MM` thick and wide or more."""
    printer = spec.printer
    thickness = spec.suspension.thickness_mm or printer.height_mm(printer.smallest_beam_layers)
    return [
        Rule(
            drawn + offset >= LEAST_PRINTED_MM - SLACK_MM,
            f"printer.{field}",
            f"must leave at least {number(LEAST_PRINTED_MM)} mm of the {what}, {number(drawn)} mm as drawn, so be at"
            f" least {number(LEAST_PRINTED_MM - drawn)} mm, got {number(offset)} mm",
            [{f"printer.{field}": round(LEAST_PRINTED_MM - drawn, 9)}],
        )
        for field, offset, what, drawn in (
            ("z_offset_mm", printer.z_offset_mm, "thickness of the thinnest beam", thickness),
            ("width_offset_mm", printer.width_offset_mm, "width of the narrowest beam", printer.smallest_beam_mm),
        )
    ]


def _beam_rules(spec: Spec) -> list[Rule]:
    thickness = spec.suspension.thickness_mm
    printer = spec.printer
    if thickness is None:
        return []
    bound = spec.taxel.plate_thickness_mm - printer.layer_mm
    layers, most = ((height - printer.first_layer_mm) / printer.layer_mm + 1 for height in (thickness, bound))
    whole = max(min(round(layers), floor(most + 1e-6)), printer.smallest_beam_layers)
    return [
        Rule(
            abs(layers - max(round(layers), printer.smallest_beam_layers)) <= 1e-6,
            "suspension.thickness_mm",
            f"must be a whole number of layers (first {number(printer.first_layer_mm)} mm, then"
            f" {number(printer.layer_mm)} mm each), got {number(thickness)} mm",
            [{"suspension.thickness_mm": printer.height_mm(whole)}],
        ),
        Rule(
            thickness <= bound + SLACK_MM,
            "suspension.thickness_mm",
            f"must stay a layer below the plate's thickness, at most {number(bound)} mm, got {number(thickness)} mm",
            _thicker(spec, round(thickness + printer.layer_mm, 6)),
        ),
    ]


LARGEST_CURVE = 1 << 20
"""Most bytes of a file with a curve."""


def with_threshold(drive: DriveTable, folder: Path) -> DriveTable:
    """Return `drive` with the frequencies and detection thresholds of its CSV file `threshold_file` as two lists.

    Raises
    ------
    FileError
        The file cannot be read, or a line of it is not two numbers.
    SpecError
        The spec has both a file and a list, or a number is out of bounds.
    """
    name = drive.threshold_file
    where = "drive.threshold_file"
    if name is None:
        return drive
    if drive.threshold_hz is not None or drive.threshold_um is not None:
        twice = "gives a threshold that drive.threshold_hz and drive.threshold_um give, too: leave out one or the other"
        raise SpecError(twice, where)
    if not name.strip() or "\0" in name:
        raise SpecError(f"must name a file, got {name!r}", where)
    where = f"{where} {str(folder / name)!r}"
    try:
        text = read_bounded(folder / name, LARGEST_CURVE, "a threshold").decode("utf-8-sig")
    except FileError as error:
        missing = isinstance(error.__cause__, FileNotFoundError)
        raise FileError("there is no such file" if missing else error.message, where) from error
    except UnicodeDecodeError as error:
        raise FileError(f"is not CSV: byte {error.start} is not UTF-8 text", where) from error
    hz, um = zip(*_points(text, name), strict=True)
    lists = {"threshold_hz": list(hz), "threshold_um": list(um)}
    return build(DriveTable, lists, "drive", asdict(replace(drive, threshold_file=None)))


def _points(text: str, where: str) -> list[tuple[float, float]]:
    plain = r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?)\s*"
    points: list[tuple[float, float]] = []
    headings = False
    for line, raw in enumerate(io.StringIO(text, newline=None), start=1):
        raw = raw.rstrip("\n")
        if not raw.strip() or raw.lstrip().startswith("#"):
            continue
        if match := re.fullmatch(f"{plain},{plain}", raw, re.ASCII):
            points.append((float(match[1]), float(match[2])))
        elif points or headings or raw.count(",") != 1 or any(c.isdigit() for c in raw):
            shown = raw if len(raw) <= 40 else raw[:40] + "…"
            raise FileError(f"line {line} must be a frequency in Hz and a threshold in µm, got {shown!r}", where)
        else:
            headings = True
    if not points:
        raise FileError("holds no points; each line must be a frequency in Hz and a threshold in µm", where)
    return points


def _threshold_rules(spec: Spec) -> Iterator[Rule]:
    """Yield the rules of a detection threshold curve: equally long lists, rising frequencies that cover the band.

    A rule is judged only once those before it hold.
    """
    hz = spec.drive.threshold_hz or ()
    um = spec.drive.threshold_um or ()
    where = "drive.threshold_hz"
    if not (hz or um):
        return
    entries = f"must have as many entries as drive.threshold_um, got {len(hz)} and {len(um)}"
    yield Rule(len(hz) == len(um), where, entries)
    yield Rule(len(hz) >= 2, where, f"must have two points or more, got {len(hz)}")
    for low, high in pairwise(hz):
        yield Rule(low < high, where, f"must be positive and rise, got {number(low)} before {number(high)} Hz")
    low, high = spec.band_hz
    common = [max(low, hz[0]), min(high, hz[-1])]
    yield Rule(
        hz[0] <= low and high <= hz[-1],
        where,
        f"must cover the band of {number(low)} … {number(high)} Hz, got {number(hz[0])} … {number(hz[-1])} Hz",
        [{"band_hz": common}] if common[0] < common[1] else (),
    )


SEARCHED = ("mover", "magnet", "washer", "coil", "ballast", "suspension", "contactor", "resonances")
"""Parts that are searched for under touch; mover: magnet or washer. The grid of coils belongs to the resonances."""


def _with_search_parts(touch: TouchTable, given: set[str], kind: str) -> TouchTable:
    """Return `touch` with a `search` of "auto" replaced by the names of the parts to search for, or by "none".

    `given` are the names that the spec has, `kind` is the mover's.
    """
    if touch.is_untouched or touch.search != "auto":
        return touch
    mover = kind if "mover" in given else "mover"
    return replace(
        touch, search=still_searched([mover, "coil", "ballast", "suspension", "contactor", "resonances"], given)
    )


def still_searched(parts: Sequence[str], given: Collection[str]) -> str:
    """Return the `parts` that a spec does not give, joined by "+"; "none" if it gives resonances or the coil grid."""
    if {"resonances_hz", "coil.grid"} & {*given}:
        return "none"
    of_mover = {"mover", "magnet", "washer"} if {"magnet", "washer"} & {*given} else set()
    return "+".join(name for name in parts if name not in given and name not in of_mover)


OWN_CONTACT = ("k_n_per_m", "c_n_s_per_m", "m_g")
"""Figures of a contact of one's own."""


def _touch_rules(spec: Spec) -> Iterator[Rule]:
    """Yield the rules of touch: searched parts exist; figures of a user's contact are complete and cover the band."""
    touch = spec.touch
    hz = touch.hz
    given = [name for name in ("hz", *OWN_CONTACT) if getattr(touch, name) is not None]
    is_own = touch.contact == "own"
    for word in touch.search.split("+") if touch.search not in ("none", "auto") else ():
        if word not in SEARCHED:
            message = unknown_name(word, list(SEARCHED), "part that is searched for", "").message
            yield Rule(False, "touch.search", message, [{"touch.search": "auto"}])
    yield Rule(
        is_own or not given,
        f"touch.{given[0] if given else 'hz'}",
        f"is a figure of touch.contact = 'own', got {touch.contact!r}",
        [{f"touch.{name}": None for name in given}],
    )
    yield Rule(
        not is_own or touch.k_n_per_m is not None,
        "touch.k_n_per_m",
        "is missing, the stiffness of a contact of one's own",
        [{"touch.contact": "fingertip"}],
    )
    yield Rule(
        touch.person is None or touch.people != 0,
        "touch.person",
        f"is one among people who differ, got {number(touch.person or 0)} with touch.people = 0",
        [{"touch.person": None}],
    )
    for name in given[1:] if hz else given:
        count = len(getattr(touch, name))
        allowed = (1, len(hz)) if hz else (1,)
        yield Rule(
            count in allowed,
            f"touch.{name}",
            f"must have {' or '.join(map(str, allowed))} number{'s' if hz else ''}, as touch.hz"
            f" {'has' if hz else 'is absent'}, got {count}",
        )
    for low, high in pairwise(hz or ()):
        yield Rule(low < high, "touch.hz", f"must rise, got {number(low)} before {number(high)} Hz")
    if hz and len(hz) > 1:
        low, high = spec.band_hz
        common = [max(low, hz[0]), min(high, hz[-1])]
        yield Rule(
            hz[0] <= low and high <= hz[-1],
            "touch.hz",
            f"must cover the band of {number(low)} … {number(high)} Hz, got {number(hz[0])} … {number(hz[-1])} Hz",
            [{"band_hz": common}] if common[0] < common[1] else (),
        )


CATALOGUES = {
    "material": (Material, "materials.csv"),
    "printer": (Printer, "printers.csv"),
    "spread": (Spread, "spreads.csv"),
    "washer": (Washer, "washers.csv"),
    "magnet": (Magnet, "magnets.csv"),
    "ballast": (Ballast, "ballasts.csv"),
    "coil": (Coil, "coils.csv"),
    "amplifier": (Amplifier, "amplifiers.csv"),
    "sound_card": (SoundCard, "sound_cards.csv"),
}


def _list(text: str) -> tuple[float, ...]:
    """Return the numbers in a catalogue cell, which are separated by spaces."""
    return tuple(map(float, text.split()))


PARTS: dict[str, tuple[str, dict[str, Any]]] = {
    "board": ("boards.csv", {"clock_mhz": float}),
    "magnet_grade": ("magnet_grades.csv", {f.name: float for f in fields(Magnet) if f.type is float}),
    "skin": ("skins.csv", dict.fromkeys(("modulus_kpa", "layer_mm", "time_ms"), float)),
    "threshold": ("thresholds.csv", {"area_mm2": float, "hz": _list, "db": _list, "error_db": float}),
    "board_house": (
        "board_houses.csv",
        {
            **dict.fromkeys(
                ("track_mm", "space_mm", "drill_mm", "via_mm", "plating_um", "copper_um", "inner_copper_um"), float
            ),
            **dict.fromkeys(("prepreg_mm", "edge_mm", "longest_mm"), float),
            **dict.fromkeys(("layers", "thickness_mm"), _list),
        },
    ),
    "connector": (
        "connectors.csv",
        {
            **dict.fromkeys(("pitch_mm", "drill_mm", "pad_mm", "body_mm"), float),
            **dict.fromkeys(("fewest", "most"), int),
        },
    ),
    "difference": (
        "differences.csv",
        dict.fromkeys(("low_hz", "high_hz", "from_db", "to_db", "smallest", "largest"), float),
    ),
}
"""Catalogues of what a spec has no table for, and which of their columns are numbers.

The processor of a microcontroller board has a floating-point unit. A magnet's grade gives it the columns of the grade.
Of a threshold of feeling, `db` are amplitudes in dB re 1 µm peak at `hz`, through a contactor of that area with that
surround.
"""


@cache
def catalogue(table: str) -> dict[str, dict[str, Any]]:
    """Return the entries of one catalogue by name, with values of their fields' types."""
    if table in PARTS:
        filename, types = PARTS[table]
    else:
        kind, filename = CATALOGUES[table]
        types = {f.name: optional_type(f.type)[0] for f in fields(kind)}
    with open(Path(__file__).with_name("catalogue") / filename, encoding="utf-8", newline="") as lines:
        rows = csv.DictReader(lines)
        return {row["name"]: {key: _entry(types.get(key, str), value) for key, value in row.items()} for row in rows}


def _entry(kind: Any, value: str) -> Any:
    """Return the value of a catalogue's cell; an empty cell of a column of numbers is None."""
    return None if kind is not str and not value else kind(value)


SPEC_RULES: RuleBook[Spec] = RuleBook(
    "spec",
    _band_rules,
    _parts_rules,
    _ballast_rules,
    _taxel_rules,
    _contactor_rules,
    _nozzle_rules,
    _beam_rules,
    _printed_rules,
    _threshold_rules,
    _touch_rules,
)
"""Rules between the fields of a spec; bounds of one field stand with it in `padgen/spec/model.py`."""
LARGEST_TOML = 1 << 20
LARGEST_PLAN = 1 << 25
"""Most bytes of a spec or sweep, and of a plan.json; that of 100,000 taxels takes a third of this."""
DEFAULT_PARTS = {"washer": "iso7092-m1.6", "magnet": "disc-3x1"}
"""The part of each kind of mover."""
OWN = "own"
"""Name of an amplifier or a sound card that a spec gives none."""
COMMON_CORNER_HZ = 3.0
"""Corner of the high-pass of an ordinary AC-coupled sound card: assumed where no maker states one."""
CARRIED_HEADROOM = 1.0
"""Spur-free headroom where an AC-coupled device needs a carrier: lines about it have less room, so bends are blunter
(the largest margin that `padgen.physics.crest.root_margin` tries)."""
CALIBRATED = ("printer", "spread", "material")
"""Tables that the file of a calibrated printer may have."""
WINDING = ("turns", "resistance_ohm", "inductance_mh")
"""Fields that describe one winding and so must be given together."""
DEFAULT_GAP_MM = 1.0
DEFAULT_MATERIALS = {"fdm": "pla", "resin": "tough-resin"}
DEFAULT_PRINTERS = {"fdm": "fdm-0.4", "resin": "resin-0.05"}
PLAIN_TABLES = {
    "pad": PadTable,
    "taxel": TaxelTable,
    "suspension": SuspensionTable,
    "drive": DriveTable,
    "model": Model,
    "limits": LimitsTable,
    "life": LifeTable,
    "mount": MountTable,
    "mover": MoverTable,
    "touch": TouchTable,
    "contactor": ContactorTable,
    "guard": GuardTable,
}


SHORTHANDS = {
    "suspension": "topology",
    "drive": "scheme",
    "model": "structure",
    "mount": "kind",
    "mover": "kind",
    "touch": "contact",
}
"""Tables that a spec may give as one word, and the field that this word sets."""


def template_paths() -> dict[str, Path]:
    """Return the files of the templates by name: at the top of a checkout, inside the package of an installed wheel."""
    here = Path(__file__).resolve().parents[1]
    for folder in (here / "templates", here.parent / "templates"):
        if folder.is_dir():
            return {path.stem: path for path in sorted(folder.glob("*.toml"))}
    return {}


def find_spec(spec: str) -> Path:
    """Return the file of a spec, given by its path or by the name of a template.

    Raises
    ------
    FileError
        There is neither such a file nor such a template.
    """
    path = Path(spec)
    if not spec.strip():
        raise FileError("must name a TOML file or a template, got nothing", "SPEC")
    templates = template_paths()
    try:
        if path.is_dir():
            # A template is often built into a folder of its name.
            if spec in templates:
                return templates[spec]
            raise FileError("is a folder, must be a TOML file or the name of a template", spec)
        if read_as_one(path.parent, path.exists, path.name):
            return path
    except OSError as error:
        raise FileError(f"cannot be read ({reason(error)})", spec) from error
    if spec in templates:
        return templates[spec]
    if path.suffix or len(path.parts) > 1:
        raise FileError("there is no such file", spec)
    raise FileError(unknown_name(spec, list(templates), "file or template", "").message, "spec")


def load_spec(spec: str) -> Spec:
    """Read a `Spec` from a path or the name of a template; from a ``plan.json``, the spec of that plan."""
    path = find_spec(spec)
    return make_spec(read_table(path, spec), path.parent)


def read_table(path: Path, where: str) -> dict[str, Any]:
    """Return the tables of a spec's file, TOML or the ``plan.json`` of a pad; errors name the file `where`."""
    if path.suffix != ".json":
        return read_toml(path, where)
    data = _read(path, LARGEST_PLAN, "a plan.json", where)
    try:
        table = without_none(json.loads(data).get("spec"))
    except (ValueError, AttributeError, RecursionError):
        table = None
    if not isinstance(table, dict):
        raise FileError("is no plan.json, which would have the spec of its pad", where)
    return table


def _read(path: Path, most_bytes: int, what: str, where: str) -> bytes:
    try:
        return read_bounded(path, most_bytes, what)
    except FileError as error:
        raise FileError(error.message, where) from error


def is_resizable(coil: Coil) -> bool:
    """Return whether the search may find the diameter of coils of this kind."""
    return hasattr(COILS.get(coil.kind, "coil.kind"), "resized")


def as_table(spec: Spec) -> dict[str, Any]:
    """Return a spec as its file may give it: fields that follow from others, as those of a board coil, are left out."""
    table = without_none(asdict(spec))
    if given_fields := getattr(COILS.get(spec.coil.kind, "coil.kind"), "given_fields", None):
        table["coil"] = given_fields(spec.coil)
    return table


def without_none(value: Any) -> Any:
    """Return nested tables without entries of None, which TOML cannot write."""
    if isinstance(value, dict):
        return {key: without_none(entry) for key, entry in value.items() if entry is not None}
    return value


def laid_over(base: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """Return a spec's tables `base` with `values`, keyed by dotted field names, set in them."""
    table = deepcopy(base)
    # Whole tables are set first, so that a catalogue entry and one of its fields may both be changed.
    for name, value in sorted(values.items(), key=lambda pair: pair[0].count(".")):
        *path, last = name.split(".")
        inner = table
        for part in path:
            entry = inner.get(part, {})
            # A catalogue entry or a drive scheme may be given as one word.
            inner[part] = entry if isinstance(entry, dict) else {SHORTHANDS.get(part, "name"): entry}
            inner = inner[part]
        if name == "magnet.grade":
            # A plan.json has the figures of the grade that it was planned with, which would hide those of another.
            for key, figure in _of_grade(inner.get("grade")).items():
                if inner.get(key) == figure and f"magnet.{key}" not in values:
                    del inner[key]
        inner[last] = value
        if name in SAME_RATIO:
            table.pop(SAME_RATIO[name], None)
    return table


def parse_spec(text: str, where: str = "spec", folder: Path = Path()) -> Spec:
    """Make a `Spec` from TOML text; `where` names the text in errors, and files that it names lie in `folder`.

    Raises
    ------
    SpecError
        The text is not TOML, or a field is unknown, missing or out of bounds.
    """
    return make_spec(parse_toml(text, where), folder)


def read_toml(path: Path, where: str) -> dict[str, Any]:
    """Return the tables of a TOML file; errors name it `where`."""
    try:
        text = _read(path, LARGEST_TOML, "a TOML file", where).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"is not TOML: byte {error.start} is not UTF-8 text", where) from error
    return parse_toml(text, where)


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Return the tables of TOML text; errors name it `where`."""
    import tomllib

    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise SpecError(f"is not TOML: {error}", where) from error
    except ValueError as error:  # a number with thousands of digits
        raise SpecError(f"is not TOML that can be read: {error}", where) from error
    except RecursionError as error:
        raise SpecError("cannot be read: its values are nested too deeply", where) from error


def _refuse_unknown(table: dict[str, Any]) -> None:
    """Raise SpecError for an unknown key; if it contains "area", name the fields of the pad's size."""
    known = [*(item.name for item in fields(Spec)), IN_DB]
    for key in table:
        if key not in known:
            error = unknown_name(key, known, "key", "spec")
            size = "; the active area is pad.width_mm and pad.depth_mm" if "area" in key.lower() else ""
            raise SpecError(f"{error.message}{size}", error.where)


def make_spec(table: dict[str, Any], folder: Path = Path()) -> Spec:
    """Make a `Spec` from the nested tables of a TOML file; files that the tables name lie in `folder`."""
    table = _with_printer_file(dict(table), folder)
    is_in_db = IN_DB in table
    if is_in_db:
        table["delta_y"] = _ratio_of_db(table.pop(IN_DB), table)
    given = set(table)
    if isinstance(coil := table.get("coil"), dict):
        given |= {f"coil.{name}" for name in coil}
    for name, key in SHORTHANDS.items():
        value = table.get(name, {})
        if isinstance(value, str):
            table[name] = {key: value}
        elif not isinstance(value, dict):
            raise SpecError(f"must be the name of its {key} or a table, got {shown(value)}", name)
    if "mover" not in table and "magnet" in table:
        table["mover"] = {"kind": "magnet"}
    limited = "voltage_limit_v" in table.get("drive", {})
    parts: dict[str, Any] = {name: build(kind, table.pop(name, {}), name) for name, kind in PLAIN_TABLES.items()}
    parts["printer"] = printer = _catalogue_entry("printer", table.pop("printer", {}), DEFAULT_PRINTERS["fdm"])
    kind = parts["mover"].kind
    part = kind if kind in DEFAULT_PARTS else MOVERS.get(kind, "mover.kind").PART
    for other in DEFAULT_PARTS.keys() & table.keys() - {part}:
        raise SpecError(f"is not what mover.kind = {kind!r} moves, which is a {part}", other, [{other: None}])
    defaults = {
        "material": DEFAULT_MATERIALS[printer.process],
        "spread": spread_of(printer),
        "coil": "paper",
        part: DEFAULT_PARTS[part],
    }
    for name, default in defaults.items():
        parts[name] = _catalogue_entry(name, table.pop(name, {}), default)
    if (ballast := table.pop("ballast", None)) is not None:
        parts["ballast"] = _catalogue_entry("ballast", ballast, OWN)
    if (amplifier := table.pop("amplifier", None)) is not None:
        parts["amplifier"] = amplifier = _catalogue_entry("amplifier", amplifier, OWN)
        limit_v = min(parts["drive"].voltage_limit_v if limited else amplifier.voltage_v, amplifier.voltage_v)
        parts["drive"] = replace(parts["drive"], voltage_limit_v=limit_v)
    if (card := table.pop("sound_card", None)) is not None:
        parts["sound_card"] = _sound_card(card)
    parts["drive"] = with_threshold(parts["drive"], folder)
    parts["touch"] = _with_search_parts(parts["touch"], given, kind)
    _refuse_unknown(table)
    spec: Spec = build(Spec, table, "", parts)
    if spec.blocked_by:
        headroom = max(spec.drive.headroom, CARRIED_HEADROOM)
        spec = replace(spec, drive=replace(spec.drive, headroom=headroom))
    if not spec.leaves_layout_free:
        gap_mm = spec.coil.gap_mm or DEFAULT_GAP_MM
        reuse = spec.coil.reuse.replace("auto", "same")
        spec = replace(spec, coil=replace(spec.coil, gap_mm=gap_mm, reuse=reuse))
    if is_in_db:
        refuse(_q_rule(spec, is_in_db))
    SPEC_RULES.refuse(spec)
    return spec


IN_DB = "delta_db"
"""`delta_y` in decibels, as it may stand in a spec's place."""
SAME_RATIO = {"delta_y": IN_DB, IN_DB: "delta_y"}
LEAST_DB = -120.0
MOST_DB = 180.0
"""The bounds of `delta_y`, in decibels."""


def _ratio_of_db(value: Any, table: dict[str, Any]) -> float:
    """Return the ratio of amplitudes that a spec gives in decibels."""
    if "delta_y" in table:
        raise SpecError("says the same as delta_y: leave out one of them", IN_DB, [{IN_DB: None}])
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not is_number or not LEAST_DB <= value <= MOST_DB:
        raise SpecError(f"must be a number from {LEAST_DB:g} to {MOST_DB:g} dB, got {shown(value)}", IN_DB)
    return float(10 ** (value / 20))


def _sound_card(value: Any) -> SoundCard:
    """Return the sound card of a spec; if DC coupled, without the high-pass corner of its catalogue entry."""
    card: SoundCard = _catalogue_entry("sound_card", value, OWN)
    stated = isinstance(value, dict) and "corner_hz" in value
    return card if card.coupling == "AC" or stated else replace(card, corner_hz=None)


def _with_printer_file(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return `table` with printer, spread and material from the file of a calibrated printer, if it names one."""
    name = table.get("printer")
    if not isinstance(name, str) or not name.endswith(".toml"):
        return table
    from_file = read_toml(folder / name, f"printer: {name}")
    if unknown := sorted(set(from_file) - set(CALIBRATED)):
        raise SpecError(f"has no place in a printer's file, which has {', '.join(CALIBRATED)}", f"{name}: {unknown[0]}")
    if "printer" not in from_file:
        raise SpecError("is missing; padgen calibrate writes it", f"{name}: printer")
    for key in ("spread", "material"):
        if key in table and key in from_file and table[key] != from_file[key]:
            raise SpecError(f"is in the printer's file {name} as well; leave it out of one of the two", key)
    return {**table, **from_file}


def matches_spec(recorded: Spec, asked: Spec) -> bool:
    """Return whether a plan's spec `recorded` equals `asked`, but for the model and what `asked` leaves to the search.

    The model may differ, and values that `asked` leaves to the search are taken from the plan.
    """
    recorded_coil = recorded.coil
    coil = replace(
        asked.coil,
        gap_mm=asked.coil.gap_mm or recorded_coil.gap_mm,
        reuse=recorded_coil.reuse if asked.coil.reuse == "auto" else asked.coil.reuse,
    )
    if asked.touch.search not in ("none", "auto"):
        names = ("mover", "washer", "magnet", "ballast", "suspension", "contactor", "resonances_hz", "taxel", "pad")
        decided = {name: getattr(recorded, name) for name in (*names, "coil", "drive", "touch")}
        return replace(recorded, model=asked.model) == replace(asked, **decided)
    drive = replace(asked.drive, scheme=recorded.drive.scheme) if asked.drive.scheme == "auto" else asked.drive
    return replace(recorded, model=asked.model) == replace(asked, coil=coil, drive=drive)


def spread_of(printer: Printer) -> str:
    """Return the catalogue name of a printer's print-to-print spread, or of its process's default printer's spread."""
    typical = f"{printer.name}-typical"
    return typical if typical in catalogue("spread") else f"{DEFAULT_PRINTERS[printer.process]}-typical"


def _catalogue_entry(table: str, value: Any, default: str) -> Any:
    """Return a catalogue entry, given by its name or by a table that may override its fields."""
    kind = CATALOGUES[table][0]
    if table == "coil" and (completed := _completed_by(value)):
        return completed(value)
    entries = catalogue(table)
    overrides = {"name": value} if isinstance(value, str) else value
    if not isinstance(overrides, dict):
        raise SpecError(f"must be a name or a table, got {shown(value)}", table)
    name = overrides.get("name", default)
    given = [key for key in WINDING if key in overrides]
    # A resistance or an inductance alone corrects the catalogue's coil; turns, or two of the three, mean another coil.
    other = len(given) > 1 or given == ["turns"]
    if table == "coil" and "name" not in overrides and other and len(given) < len(WINDING):
        raise SpecError(
            f"needs {', '.join(WINDING)} together for a coil of one's own, got only {', '.join(given)}; to change only"
            " that of a coil in the catalogue, give its name, too",
            table,
        )
    if not isinstance(name, str):
        raise SpecError(f"must be text, got {shown(name)}", f"{table}.name")
    if table == "magnet":
        overrides = {**_of_grade(overrides.get("grade", entries.get(name, {}).get("grade"))), **overrides}
    if name in entries:
        entry = entries[name]
        if table == "printer" and overrides.get("nozzle_mm", entry["nozzle_mm"]) != entry["nozzle_mm"]:
            of_nozzle = _of_nozzle({"process": entry["process"], **overrides})
            entry = {**entry, **{field: of_nozzle[field] for field in (*IN_NOZZLES, "source")}}
        return build(kind, overrides, table, entry)
    optional = {f.name for f in fields(kind) if f.default is not MISSING}
    required = {f.name for f in fields(kind)} & set(next(iter(entries.values()))) - optional
    missing = [f.name for f in fields(kind) if f.name in required - set(overrides) - {"name"}]
    if missing and table == "printer" and "nozzle_mm" in overrides:
        return build(kind, {"name": name, **overrides}, table, _of_nozzle(overrides))
    if not missing or name == OWN:
        return build(kind, {"name": name, **overrides}, table)
    if len(overrides) > 1:
        hint = "; with nozzle_mm the rest is taken for that nozzle" if table == "printer" else ""
        raise SpecError(
            f"there is no {table} {shown(name)} in the catalogue ({', '.join(entries)}), and one of your own lacks"
            f" {', '.join(missing)}{hint}",
            f"{table}.name",
        )
    raise unknown_name(name, list(entries), table, f"{table}.name")


IN_NOZZLES = (
    *("line_width_mm", "smallest_beam_mm", "layer_mm", "first_layer_mm"),
    *("smallest_pin_mm", "smallest_gap_mm", "xy_compensation_mm"),
)
"""Fields of a printer that go with its nozzle, or with its pixel."""


WIDER_THAN_ANY_MM = 1e6
"""A nozzle beyond this is no basis for other fields; it is refused by its bound."""


def _of_nozzle(printer: dict[str, Any]) -> dict[str, Any]:
    """Return default fields of a printer: those of the catalogue printer nearest in nozzle size, scaled to its nozzle.

    What is no nozzle or process is refused where the field is read.
    """
    nozzle_mm = printer["nozzle_mm"]
    every = list(catalogue("printer").values())
    entries = [row for row in every if row["process"] == printer.get("process", "fdm")]
    is_number = isinstance(nozzle_mm, (int, float)) and not isinstance(nozzle_mm, bool)
    if not is_number or not 0 < nozzle_mm < WIDER_THAN_ANY_MM or not entries:
        return every[0]
    nearest = min(entries, key=lambda row: abs(log(row["nozzle_mm"] / nozzle_mm)))
    share = nozzle_mm / nearest["nozzle_mm"]
    in_proportion = {name: round(nearest[name] * share, 4) for name in IN_NOZZLES if nearest[name]}
    source = f"what is not given: {nearest['name']}, in proportion to the nozzle (assumed)"
    return {**nearest, **in_proportion, "source": source}


def _completed_by(coil: Any) -> Callable[[dict[str, Any]], Coil] | None:
    """Return the function that computes the fields a coil of this kind leaves out; None if all must be given."""
    kind = coil.get("kind") if isinstance(coil, dict) else None
    if not isinstance(kind, str) or kind == "solenoid" or kind not in COILS.names():
        return None
    return getattr(COILS.get(kind, "coil.kind"), "completed", None)


def _of_grade(grade: Any) -> dict[str, Any]:
    """Return the material figures of a magnet's grade; an empty table where no grade is named."""
    if grade is None:
        return {}
    if not isinstance(grade, str):
        raise SpecError(f"must be text, got {shown(grade)}", "magnet.grade")
    grades = catalogue("magnet_grade")
    if grade not in grades:
        raise unknown_name(grade, list(grades), "grade of magnets", "magnet.grade")
    return {key: value for key, value in grades[grade].items() if key not in ("name", "source")}


def spec_schema() -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a spec file, made from the fields' metadata."""
    schema = _object(Spec)
    schema["required"] = [f.name for f in fields(Spec) if f.default is MISSING and not is_dataclass(f.type)]
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "padgen spec"
    tables = schema["properties"]
    in_db = "delta_y in decibels, in its place: 14 is a ratio of 5 (dB)"
    tables[IN_DB] = {"type": "number", "minimum": LEAST_DB, "maximum": MOST_DB, "description": in_db}
    words = {name: (sorted(catalogue(name)), "a catalogue name") for name in CATALOGUES}
    for name, (known, _) in words.items():
        tables[name]["properties"]["name"]["examples"] = known
    words |= {name: (tables[name]["properties"][key]["enum"], f"its {key}") for name, key in SHORTHANDS.items()}
    for name, (known, what) in words.items():
        either = [{"type": "string", "enum": known}, tables[name]]
        tables[name] = {"anyOf": either, "description": f"{name}: {what} or a table"}
    return schema


def _object(kind: Any) -> dict[str, Any]:
    properties = {}
    for item in fields(kind):
        meta = item.metadata
        inner = optional_type(item.type)[0]
        if is_dataclass(inner):
            properties[item.name] = _object(inner)
            continue
        unit = meta.get("unit", "")
        description = meta["doc"] + (f" ({unit})" if unit not in ("", "1") else "")
        properties[item.name] = {**_type(inner, meta), "description": description}
        if item.default is not MISSING and item.default is not None:
            properties[item.name]["default"] = item.default
    return {"type": "object", "additionalProperties": False, "properties": properties}


def _type(kind: Any, meta: Any) -> dict[str, Any]:
    if meta.get("words"):
        return {"anyOf": [{"type": "string", "enum": list(meta["words"])}, _type(kind, {**meta, "words": ()})]}
    if kind in (int, float):
        return {"type": "integer" if kind is int else "number", "minimum": meta["low"], "maximum": meta["high"]}
    if kind is bool:
        return {"type": "boolean"}
    if kind is str:
        schema: dict[str, Any] = {"type": "string"}
        if known := choices(meta):
            schema["enum"] = list(known)
        if meta.get("pattern"):
            schema["pattern"] = f"^{meta['pattern']}$"
        return schema
    count = meta["count"]
    sizes = {"minItems": count, "maxItems": count} if count else {"minItems": 1}
    schema = {"type": "array", "items": _type(get_args(kind)[0], meta), **sizes}
    return {"anyOf": [schema["items"], schema]} if meta.get("single") else schema
