"""Judgement of a pad as a slicer lays it: beams, resonances, and the settings (by slicers' names) that spoil them.

The plan's beam model computes each taxel twice, as drawn and as laid: with the stiffness of the layers that are laid
(their widths and heights at nodes along the beam, as one stack) and the mass of the plate's plastic. The plan's
resonance is scaled by the ratio. G-code does not tell how well strands weld and how far plastic is pressed into the
bed; both are neglected. So is a shift of the edges of frame and plate, which changes a beam's length.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import pi, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import Finding, number, plural
from padgen.core.units import G_PER_CM3, GRAM, MG, MM
from padgen.physics.ladder import slot_half_width
from padgen.planner.plan import Channel, Plan
from padgen.planner.printed_pads import known_print_db
from padgen.planner.printing import IN_ORCA, shaping_profile
from padgen.planner.suspensions import Arrangement, BeamShape
from padgen.planner.taxel_model import TaxelModel, hollows_mm, plate_shape
from padgen.sliced.laid_pad import LaidPad, laid_pads, read_settings

__all__ = ["LaidReport", "check_gcode"]

Wrong = Mapping[str, Mapping[str, str]]
"""Settings to change, by the plan's names: each one's `name` for people, what it `has` and what it `needs` to be."""
LAID_SHARE = 0.25
"""Share of the planned width below which a layer of a beam counts as missing."""
WIDTH_MM = 0.05
DEPTH_MM = 0.02
MASS_SHARE = 0.02
"""Largest differences of a layer's width, a recess's depth and a plate's plastic that are not reported."""
CLOSED_MM = 0.05
NARROW_SHARE = 0.5
"""Width below which a gap between beads counts as closed, and share of the planned gap below which it is reported."""
SETTINGS = {
    "layer_height": "layer_height",
    "first_layer_height": "first_layer_height",
    "elephant_foot_compensation": "elefant_foot_compensation",
    "xy_size_compensation": "xy_size_compensation",
    "infill_overlap": "infill_overlap",
    "thick_bridges": "thick_bridges",
    "wall_generator": "perimeter_generator",
    "infill": "fill_density",
    "supports": "support_material",
    "raft": "raft_layers",
    "nozzle": "nozzle_diameter",
}
"""Settings by the plan's names, with PrusaSlicer's."""
SPOIL_ALL = ("extrusion_multiplier", "ironing", "spiral_vase", "fuzzy_skin", "resolution", "gcode_resolution")
"""Settings by PrusaSlicer's names that may cause any fault."""
SCALE_SHARE = 0.004
"""Difference of the pad's size from the plan's that is reported: it is measured to 0.003."""
SURELY_OTHER_MASS = 0.05
"""Share of a taxel's moving mass by which its plate's plastic may differ: f moves by half of it, as for another pad."""
LOST_DB = 1.0
"""Loss of selectivity, with the planned tones, that is reported."""
NAMED = 3
"""Most taxels that a sentence names."""


@dataclass(frozen=True)
class LaidReport:
    """Figures of the pad as laid, by name (lengths in mm, frequencies in Hz, masses in mg), and the findings."""

    figures: dict[str, Any]
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class _LaidModel(TaxelModel):
    """Beam model of taxels (n,) as they are laid.

    `sections` are the width and thickness (n,) of each beam in mm, `plastic` (n,) the share of the plate's planned
    plastic that is laid.
    """

    sections: tuple[tuple[np.ndarray, np.ndarray], ...]
    plastic: np.ndarray

    @cached_property
    def arrangement(self) -> Arrangement:
        drawn = super().arrangement
        beams = zip(drawn.beams, self.sections, strict=True)
        return drawn._replace(beams=tuple(path._replace(width_mm=w, thickness_mm=t) for path, (w, t) in beams))

    @property
    def plastic_share(self) -> np.ndarray:
        return self.plastic


class _LaidBeam(NamedTuple):
    """One beam of each of a channel's taxels (n,), measured as the slicer lays it.

    `width_mm` and `is_laid` are (layers, n). `section_mm` is the width and thickness (n,) of a rectangle with the same
    stiffness and mass. `broken_mm` and `thin_mm` are distances from the root at which the whole beam, or one layer, is
    missing (nan: nowhere).
    """

    width_mm: np.ndarray
    is_laid: np.ndarray
    thickness_mm: np.ndarray
    section_mm: tuple[np.ndarray, np.ndarray]
    broken_mm: np.ndarray
    thin_mm: np.ndarray


def check_gcode(plan: Plan, path: Path) -> LaidReport:
    """Judge each copy of the pad of `plan` that a G-code file lays; the figures are those of the best match.

    Raises
    ------
    FileError
        The file is not G-code as text, or does not hold the whole of this pad.
    """
    settings = read_settings(path)
    filament_mm = _numeric(settings.get("filament_diameter", ""))
    if settings.get("use_volumetric_e") == "1":  # what is fed is mm³, as of a filament of 1 mm²
        filament_mm = sqrt(4 / pi)
    pads = laid_pads(plan, path, filament_mm)
    needs, names = _needed(plan)
    # The first of its names counts: PrusaSlicer has an ironing_type that says nothing unless there is ironing.
    stated = {name: settings[key] for name, keys in names.items() for key in reversed(keys) if key in settings}
    first, *others = pads[0].all_steps_mm.round(4).tolist()
    usual = max(others, key=others.count, default=first)
    # As far as comments do not state them, as laid.
    has = {"layer_height": f"{number(usual)} mm", "first_layer_height": f"{number(first)} mm"} | stated
    wrong = _wrong(needs, has)
    drawn = known_print_db(plan, np.array([plan.channels[taxel.channel].resonance_hz for taxel in plan.taxels]))
    judged = [_judged(plan, laid, wrong, drawn) for laid in pads]
    figures, findings = judged[0]
    for other, more in judged[1:]:
        x, y = other["centre_mm"]
        beside = f"the pad at ({number(x)}, {number(y)}) mm: "
        findings = [*findings, *(replace(finding, where=beside + finding.where) for finding in more)]
    places = [
        {
            "centre_mm": each["centre_mm"],
            "turned_deg": each["turned_deg"],
            "errors": sum(finding.level == "error" for finding in of_pad),
        }
        for each, of_pad in judged
    ]
    of_the_file = {
        "slicer": settings.get("slicer", "unknown"),
        "layers": len(pads[0].all_steps_mm),
        "height_mm": round(float(pads[0].all_steps_mm.sum()), 4),
        "settings": {name: value for name, value in has.items() if name in SETTINGS},
        "settings_to_change": [*wrong.values()],
        "pads": places,
    }
    return LaidReport(of_the_file | figures, tuple(findings))


def _needed(plan: Plan) -> tuple[dict[str, str], dict[str, tuple[str, ...]]]:
    """Return the settings that the plan counts on, and the names that slicers' comments have for each."""
    profile = shaping_profile(plan.spec) if plan.spec.printer.process == "fdm" else {}
    more = {name: value for name, value in profile.items() if name not in SETTINGS.values()}
    in_prusa = SETTINGS | {name: name for name in more}
    return {**plan.printing, **more}, {name: (prusa, IN_ORCA.get(prusa, prusa)) for name, prusa in in_prusa.items()}


def _judged(
    plan: Plan, laid: LaidPad, wrong: Wrong, drawn: tuple[float, float] | None
) -> tuple[dict[str, Any], list[Finding]]:
    """Return figures and findings of one laid pad; `drawn` are its selectivities in dB if laid as drawn.

    They are with the planned tones and re-tuned, as `known_print_db` returns them.
    """
    beams = [[_beam(plan, c, laid, k) for k in range(len(laid.beams[c.index]))] for c in plan.channels]
    plastic = laid.plate_mm3 / np.array([_plate_mm3(plan, c) for c in plan.channels])[_channels(plan)]
    laid_hz = _resonances(plan, beams, plastic)
    keeps = known_print_db(plan, laid_hz) if (laid_hz > 0).all() else None
    findings = [
        *_of_pad(laid, wrong),
        *_beam_findings(plan, beams, wrong),
        *_of_taxels(plan, laid, plastic, wrong),
        *_resonance_findings(plan, laid_hz),
    ]
    if keeps and drawn and drawn[0] - keeps[0] > LOST_DB:
        sentence = (
            f"laid so it has {_tenths(keeps[0])} dB of ON over OFF with the planned tones (laid as planned:"
            f" {_tenths(drawn[0])} dB), and {_tenths(keeps[1])} dB re-tuned ({_tenths(drawn[1])} dB)"
        )
        level = "warning" if keeps[0] > 0 else "error"
        findings.append(Finding(level, "laid.selectivity", "pad", sentence))
    figures = {
        "centre_mm": [round(laid.placing.x_mm, 3), round(laid.placing.y_mm, 3)],
        "turned_deg": 90 * laid.placing.quarters,
        "match": round(laid.placing.match, 4),
        "scale": _number(laid.scale),
        "filament_mm": laid.filament_mm,
        "drawn_db": round(drawn[0], 2) if drawn else None,
        "planned_db": round(keeps[0], 2) if keeps else None,
        "retuned_db": round(keeps[1], 2) if keeps else None,
        "taxels": _taxel_figures(plan, laid, beams, plastic, laid_hz),
    }
    return figures, findings


def _tenths(level_db: float) -> str:
    """Return decibels as text with one decimal, rounded to two decimals before, as the report's figures are."""
    return f"{round(level_db, 2):.1f}"


def _of_pad(laid: LaidPad, wrong: Wrong) -> Iterator[Finding]:
    """Yield findings on the whole pad: a raft, a wrong size, and objects after it that are not judged."""
    if laid.bottom_mm > DEPTH_MM:
        raft = f"it begins {number(laid.bottom_mm)} mm above the bed; beams and recesses must lie on it, without a raft"
        cause = ": {name} is {has}, must be {needs}".format(**wrong["raft"]) if "raft" in wrong else ""
        yield Finding("error", "laid.raft", "pad", raft + cause)
    if abs(laid.scale - 1) > SCALE_SHARE:
        sentence = f"it is laid at {laid.scale:.1%} of its size in the plane; the slicer must scale it to 100 %"
        yield Finding("error", "laid.scale", "pad", sentence)
    if laid.is_followed:
        sentence = "what is laid after it, object by object, is not judged; export it in a file of its own"
        yield Finding("note", "laid.after", "pad", sentence)


def _channels(plan: Plan) -> np.ndarray:
    return np.array([taxel.channel for taxel in plan.taxels])


def _taxel_indices(plan: Plan, channel: Channel) -> np.ndarray:
    """Return the indices of a channel's taxels."""
    return np.flatnonzero(_channels(plan) == channel.index)


def _beam(plan: Plan, channel: Channel, laid: LaidPad, index: int) -> _LaidBeam:
    laid_beam = laid.beams[channel.index][index]
    beam = channel.beam
    steps = laid.steps_mm
    area = laid.areas_mm2[:, _taxel_indices(plan, channel), laid_beam]
    at = np.linspace(0, beam.length_mm, area.shape[2])
    end = min(beam.fillet_mm + plan.spec.printer.line_width_mm, beam.length_mm / 4)
    between = (at >= end - 1e-9) & (at <= beam.length_mm - end + 1e-9)
    widths = area / steps[:, None, None]
    width = widths[:, :, between].mean(2)
    is_laid = width > LAID_SHARE * beam.width_mm
    broken = area.sum(0) < LAID_SHARE * beam.width_mm * steps[0]
    thin = (widths < LAID_SHARE * beam.width_mm) & is_laid[:, :, None]
    middle = (np.cumsum(steps) - steps / 2)[:, None, None]
    # A pin that stands on the beam lays plastic over it, in layers of its own.
    area = area[:, :, between] * is_laid[:, :, None] + 1e-12
    mean = (area * middle).sum(0) / area.sum(0)
    inertia = (area * (steps[:, None, None] ** 2 / 12 + (middle - mean) ** 2)).sum(0)
    stack = area.sum(0).mean(1)
    inertia = 1 / (1 / inertia).mean(1)
    thickness = np.sqrt(12 * inertia / stack)
    first = [np.where(where.any(-1), at[where.argmax(-1)], np.nan) for where in (broken, thin.any(0))]
    return _LaidBeam(width, is_laid, (is_laid * steps[:, None]).sum(0), (stack / thickness, thickness), *first)


def _plate_mm3(plan: Plan, channel: Channel) -> float:
    """Return the planned volume of plate and boss, less recess and ballast pocket, in mm³."""
    plate = plan.plate
    volume = sum(
        float((b.high_x_mm - b.low_x_mm) * (b.high_y_mm - b.low_y_mm) * b.height_mm)
        for b in plan.arrangement(channel).blocks
    )
    wide = plate.boss_diameter_mm
    edge = plate.boss_edge_mm
    boss = wide**2 * (plate.boss_top_mm - plate.thickness_mm) - edge**2 * (2 * wide - 4 * edge / 3)
    hollow = sum((outer**2 - inner**2) * (high - low) for low, high, outer, inner in hollows_mm(plan.spec))
    return volume + pi / 4 * (max(boss, 0.0) - hollow)


def _mg_of_mm3(plan: Plan) -> float:
    """Return the mass in mg of a cubic millimetre of the pad's plastic."""
    return plan.spec.material.density_g_per_cm3 * G_PER_CM3 * MM**3 / MG


def _resonances(plan: Plan, beams: list[list[_LaidBeam]], plastic: np.ndarray) -> np.ndarray:
    """Return the resonance in Hz of each taxel as laid, nan where a beam is broken."""
    result = np.full(len(plan.taxels), np.nan)
    plate = plate_shape(plan.spec)
    for channel, channel_beams in zip(plan.channels, beams, strict=True):
        taxels = _taxel_indices(plan, channel)
        whole = np.logical_and.reduce([b.is_laid.any(0) & np.isnan(b.broken_mm) for b in channel_beams])
        if not whole.any():
            continue
        drawn = BeamShape(channel.beam.width_mm, channel.beam.thickness_mm, channel.beam.length_mm)
        shape = BeamShape(*(np.full(whole.sum(), side) for side in drawn))
        sections = tuple((b.section_mm[0][whole], b.section_mm[1][whole]) for b in channel_beams)
        model = _LaidModel(plan.spec, channel.beam.topology, plate, shape, sections, plastic[taxels[whole]])
        planned = TaxelModel(plan.spec, channel.beam.topology, plate, drawn)
        result[taxels[whole]] = channel.resonance_hz * model.resonance_hz / planned.resonance_hz
    return result


def _wrong(needs: Mapping[str, str], has: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return the slicer's settings that differ from what the plan needs."""
    wrong = {}
    for name in needs:
        if name not in has or _plain(has[name]) == _plain(needs[name]):
            continue
        unit = " mm" if needs[name].endswith("mm") and "mm" not in has[name] else ""
        shown = {"0": "off", "1": "on"}.get(has[name], has[name]) if needs[name] in ("on", "off") else has[name]
        wrong[name] = {"name": name.replace("_", " "), "has": f"{shown}{unit}", "needs": needs[name]}
    return wrong


def _plain(text: str) -> Any:
    """Return a setting's value in one form, so that two ways of writing it compare equal."""
    text = text.split(",")[0].strip().lower()
    for word in ("arachne", "classic"):
        if word in text:
            return word
    value = {"on": 1.0, "off": 0.0, "none": 0.0, "no ironing": 0.0}.get(text, _numeric(text))
    return text if value is None else value


def _numeric(text: str) -> float | None:
    try:
        return float(text.split(",")[0].replace("%", " ").replace("mm", " ").replace("about", " ").split()[0])
    except (ValueError, IndexError):
        return None


def _fault_finding(
    level: str, code: str, names: Iterable[str], of: str, sentence: str, wrong: Wrong, *causes: str
) -> Iterator[Finding]:
    """Yield one finding that lists the first few of the faulty taxels or beams `names`; nothing where there are none.

    Its sentence ends with those settings that are wrong of `causes`, which may cause the fault, and of `SPOIL_ALL`.
    """
    names = list(names)
    if names:
        more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
        of_these = [wrong[name] for name in (*causes, *SPOIL_ALL) if name in wrong]
        cause = "; ".join("{name} is {has}, must be {needs}".format(**each) for each in of_these)
        sentence = f"{sentence} ({', '.join(names[:NAMED])}{more}){': ' if cause else ''}{cause}"
        yield Finding(level, code, f"{len(names)} of {of}", sentence)


def _range(values: np.ndarray) -> str:
    ends = (number(round(float(end), 3)) for end in (values.min(), values.max())) if values.size else ()
    return " … ".join(dict.fromkeys(ends))


def _beam_findings(plan: Plan, beams: list[list[_LaidBeam]], wrong: Wrong) -> Iterator[Finding]:
    """Yield findings on faults of beams: missing beams, pieces or layers, and wrong thickness or width."""
    each = [
        (channel.beam, f"{plan.taxels[taxel].id}{f' beam {k + 1}' if len(channel_beams) > 1 else ''}", beam, at)
        for channel, channel_beams in zip(plan.channels, beams, strict=True)
        for k, beam in enumerate(channel_beams)
        for at, taxel in enumerate(_taxel_indices(plan, channel))
    ]
    of = f"{len(each)} beams"
    laid = [item for item in each if item[2].is_laid[:, item[3]].any()]
    whole = [item for item in laid if np.isnan(item[2].broken_mm[item[3]])]
    walls = ("wall_generator", "elephant_foot_compensation", "nozzle")
    lost = [name for _, name, b, i in each if not b.is_laid[:, i].any()]
    yield from _fault_finding("error", "laid.beam", lost, of, "are not laid at all", wrong, *walls)
    for items, attribute, sentence in (
        (laid, "broken_mm", "are laid with a piece missing, so far from the root"),
        (whole, "thin_mm", "have a layer with a piece missing, so far from the root"),
    ):
        places = [(name, float(getattr(b, attribute)[i])) for _, name, b, i in items]
        names = [f"{name} at {number(round(at, 2))} mm" for name, at in places if at >= 0]
        yield from _fault_finding("error", "laid.beam", names, of, sentence, wrong, *walls)
    off: dict[tuple[float, int, float, int], list[str]] = {}
    for beam, name, b, i in laid:
        thick = round(float(b.thickness_mm[i]), 4)
        if abs(thick - beam.thickness_mm) > 0.01:
            key = (beam.thickness_mm, beam.layers, thick, int(b.is_laid[:, i].sum()))
            off.setdefault(key, []).append(name)
    for (planned, layers, thick, count), names in sorted(off.items()):
        sentence = (
            f"are laid {number(thick)} mm thick in {count} layer{plural(count)}, instead of {number(planned)} mm"
            f" in {layers}"
        )
        yield from _fault_finding(
            "error", "laid.layers", names, of, sentence, wrong, "layer_height", "first_layer_height"
        )
    for what, part in (("first layer", slice(0, 1)), ("layers above the first", slice(1, None))):
        misses = [((b.width_mm[part, i] - beam.width_mm)[b.is_laid[part, i]], name) for beam, name, b, i in whole]
        for sign, word in ((-1, "narrower"), (1, "wider")):
            names = [name for miss, name in misses if (sign * miss > WIDTH_MM).any()]
            most = _range(np.concatenate([sign * miss[sign * miss > WIDTH_MM] for miss, _ in misses] or [np.zeros(0)]))
            foot = () if sign > 0 or part.start else ("elephant_foot_compensation",)
            sentence = f"in the {what} are laid {most} mm {word} than planned"
            sides = "xy_size_compensation", "wall_generator", "nozzle", "infill_overlap", "fill_pattern", "perimeters"
            yield from _fault_finding("warning", "laid.width", names, of, sentence, wrong, *foot, *sides)


def _of_taxels(plan: Plan, laid: LaidPad, plastic: np.ndarray, wrong: Wrong) -> Iterator[Finding]:
    """Yield findings on faults of gaps, recesses and plates, taxel by taxel."""
    ids = np.array([t.id for t in plan.taxels])
    washer = plan.spec.washer_or_magnet
    plate = plan.plate
    of = f"{len(ids)} taxels"
    depth = hollows_mm(plan.spec)[-1][1]
    hollow = "recess"
    parts = f"the {plan.spec.mover.kind} needs"
    parts_mm = washer.thickness_mm
    if ballast := plan.spec.ballast:
        hollow = "ballast's pocket"
        parts = f"{plan.spec.mover.kind} and ballast need"
        parts_mm = parts_mm + ballast.height_mm
    closed = laid.gap_mm < CLOSED_MM
    narrow = ~closed & (laid.gap_mm < NARROW_SHARE * plate.gap_mm)
    beside = "xy_size_compensation", "elephant_foot_compensation", "nozzle", "infill_overlap"
    for which, level, word in ((closed, "error", "closed"), (narrow, "warning", "narrow")):
        sentence = (
            f"the gap around what moves is {word}: {_range(laid.gap_mm[which])} mm between beads"
            f" instead of {number(plate.gap_mm)} mm"
        )
        yield from _fault_finding(level, "laid.gap", ids[which], of, sentence, wrong, *beside)
    hangs = laid.recess_mm < depth - DEPTH_MM
    deep = laid.recess_mm > depth + DEPTH_MM
    sentence = (
        f"the roof over the {hollow}, laid in strands {_range(laid.strand_mm[hangs])} mm high, sags:"
        f" {_range(laid.recess_mm[hangs])} mm are left of {number(depth)} mm of depth, {parts} {number(parts_mm)} mm"
    )
    level = "warning" if laid.recess_mm.min() >= parts_mm - 1e-6 else "error"
    roof = "thick_bridges", "layer_height", "first_layer_height"
    yield from _fault_finding(level, "laid.recess", ids[hangs], of, sentence, wrong, *roof)
    sentence = f"the {hollow} is {_range(laid.recess_mm[deep])} mm deep instead of {number(depth)} mm"
    yield from _fault_finding("warning", "laid.recess", ids[deep], of, sentence, wrong, *roof)
    tight = laid.room_mm < washer.outer_diameter_mm
    sentence = (
        f"the recess leaves {_range(laid.room_mm[tight])} mm between its beads, the {plan.spec.mover.kind}"
        f" {washer.name} has {number(washer.outer_diameter_mm)} mm"
    )
    sides = "xy_size_compensation", "wall_generator", "layer_height"
    yield from _fault_finding("error", "laid.washer", ids[tight], of, sentence, wrong, *sides)
    off = np.abs(plastic - 1) > MASS_SHARE
    sentence = (
        f"the plastic of the plates is {_range(100 * plastic[off])} % of the plan's, must be within {MASS_SHARE:.0%}"
    )
    fills = (
        "infill",
        "infill_overlap",
        "fill_pattern",
        "perimeters",
        "thick_bridges",
        "wall_transition_angle",
        "xy_size_compensation",
    )
    mg_of_mm3 = _mg_of_mm3(plan)
    moving = [_plate_mm3(plan, c) * mg_of_mm3 / (c.effective_mass_g * GRAM / MG) for c in plan.channels]
    of_moving = np.array(moving)[_channels(plan)]
    level = "error" if (np.abs(plastic - 1) * of_moving).max() > SURELY_OTHER_MASS else "warning"
    yield from _fault_finding(level, "laid.mass", ids[off], of, sentence, wrong, *fills)
    # A raft's own layers are supports, too.
    supported = ids[laid.is_supported & (laid.bottom_mm <= DEPTH_MM)]
    sentence = "supports stand under the plate, in the recess or in gaps, where they cannot be taken out without harm"
    yield from _fault_finding("error", "laid.support", supported, of, sentence, wrong, "supports")


def _resonance_findings(plan: Plan, laid_hz: np.ndarray) -> Iterator[Finding]:
    slot = slot_half_width(plan.spec.q_min, plan.spec.delta_y)
    for channel in plan.channels:
        hz = laid_hz[_taxel_indices(plan, channel)]
        loose = int(np.isnan(hz).sum())
        hz = hz[~np.isnan(hz)]
        off = np.abs(hz / channel.resonance_hz - 1).max(initial=0.0)
        if not loose and off <= plan.spec.model.tolerance:
            continue
        sentences = [f"{loose} would not hang by all of {'its' if loose == 1 else 'their'} beams"] if loose else []
        if len(hz):
            share = 100 * (hz / channel.resonance_hz - 1).round(3)
            sentences.append(
                f"{len(hz)} would resonate at {_range(hz.round(1))} Hz instead of"
                f" {number(round(channel.resonance_hz, 1))} Hz ({_range(share)} %)"
            )
        yield Finding(
            "error" if loose or off > slot else "warning",
            "laid.resonance",
            f"channel {channel.index}",
            f"laid so, of its {len(hz) + loose} taxels {' and '.join(sentences)}"
            + ("" if off <= slot or loose else f"; the band that is kept for it ends {slot:.1%} away"),
        )


def _taxel_figures(
    plan: Plan, laid: LaidPad, beams: list[list[_LaidBeam]], plastic: np.ndarray, laid_hz: np.ndarray
) -> list[dict[str, Any]]:
    """Return what was measured of each taxel as plain data."""
    mg_of_mm3 = _mg_of_mm3(plan)
    taxels: list[Any] = [None] * len(plan.taxels)
    for channel, channel_beams in zip(plan.channels, beams, strict=True):
        planned = _plate_mm3(plan, channel) * mg_of_mm3
        for at, index in enumerate(_taxel_indices(plan, channel)):
            taxels[index] = {
                "id": plan.taxels[index].id,
                "channel": channel.index,
                "planned_hz": channel.resonance_hz,
                "resonance_hz": _number(laid_hz[index]),
                "beams": [
                    {
                        "width_mm": [
                            round(float(w), 4)
                            for w in b.width_mm[: int(np.flatnonzero(b.is_laid[:, at]).max(initial=-1)) + 1, at]
                        ],
                        "layers": int(b.is_laid[:, at].sum()),
                        "thickness_mm": round(float(b.thickness_mm[at]), 4),
                        "broken_at_mm": _number(b.broken_mm[at]),
                        "thin_at_mm": _number(b.thin_mm[at]),
                    }
                    for b in channel_beams
                ],
                "plate_mg": round(float(plastic[index]) * planned, 3),
                "planned_plate_mg": round(planned, 3),
                "recess_depth_mm": _number(laid.recess_mm[index]),
                "recess_room_mm": _number(laid.room_mm[index]),
                "gap_mm": _number(laid.gap_mm[index]),
            }
    return taxels


def _number(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
