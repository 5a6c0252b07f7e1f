"""The pad and what it shows as MPEG haptics: the JSON interchange format `.hjif` of ISO/IEC 23090-31.

A `reference_device` for each kind of taxel says what it is: resonance, half-power frequencies, Q (`custom`),
moving mass (kg), impedance of its coil at the drive frequency, the amplifier's voltage, the rms current that the
coil bears and the displacement (mm) that all limits together allow. A channel for each taxel says where it is
(`actuator_target`: x to the right, y upwards, from 0) and, in one vectorial band, its level in time: a sine with
linear pieces of amplitude, 1 for ON; `gain` is the ON displacement over the device's largest.

Names and bounds are those of the published JSON schemas, edition 2023, simple parametric profile. Positions are
whole milliseconds and frequencies in keyframes whole hertz, since the reference decoder reads no others; exact
resonances are the devices'. The required date is a constant: the same pad makes the same file.
"""

import json
from collections.abc import Iterator
from math import ceil, floor, isfinite, pi, sqrt
from typing import Any

import numpy as np

from padgen.core.errors import FileError, SpecError, number
from padgen.core.files import OutputFolder, json_text
from padgen.core.units import GRAM, MH, MM, UM
from padgen.driver.formats import DriveJob
from padgen.driver.frames import taxel_grid
from padgen.driver.waveform import Timeline, blend
from padgen.measured.tuning import Tuning, planned_tuning, spec_at_coil_temperature
from padgen.physics.magnetics import impedance
from padgen.planner.plan import Plan, level_law

__all__ = [
    "FILE",
    "MADE_OF",
    "ORDER",
    "hjif_text",
    "write",
]

ORDER = 3
MADE_OF = "drive"
FILE = "drive.hjif"
DATE = "1970-01-01T00:00:00+00:00"
TICKS_PER_S = 1000
LOWEST_HZ = 1
HIGHEST_HZ = 10_000
MOST_LEVEL_1 = 128
"""Channels of a perception at level 1 of the profile; level 2 takes 65,536."""
LARGEST_VECTOR = 127
LARGEST_PHASE = 6.28318
PIECES = 10
"""Straight pieces for a smooth step: they leave it by at most 0.011 of its height."""
LONGEST_EFFECT = 60_000
"""Ticks of an effect: the format's binary form counts them in 16 bits."""


Course = tuple[np.ndarray, np.ndarray]
"""Ticks (m,), and levels with their signs (m, taxels) at them, straight between."""


def write(out: OutputFolder, job: DriveJob) -> None:
    """Write the file `drive.hjif`."""
    out.write(FILE, hjif_text(job.plan, job.timeline, job.request.tuning))


def hjif_text(plan: Plan, timeline: Timeline | None = None, tuning: Tuning | None = None) -> str:
    """Return the text of an `.hjif` file: the pad, as planned or as measured, and what `timeline` shows on it.

    Raises
    ------
    SpecError
        A resonance or a transition is beyond what the format can say.
    """
    tuning = tuning or planned_tuning(plan)
    for taxel in tuning.taxels:
        if not LOWEST_HZ <= taxel.resonance_hz <= HIGHEST_HZ:
            raise SpecError(
                f"an .hjif file carries {LOWEST_HZ} … {HIGHEST_HZ} Hz; {taxel.id} is at"
                f" {number(taxel.resonance_hz)} Hz",
                plan.name,
            )
    device_of = list(_devices(plan, tuning))
    course = _course(timeline) if timeline else None
    loop = "; the end leads over into the beginning" if timeline and timeline.loops else ""
    table = {
        "version": "2023",
        "profile": "Simple Parametric",
        "level": 1 if len(plan.taxels) <= MOST_LEVEL_1 else 2,
        "date": DATE,
        "description": (
            f"{plan.name}: {len(plan.taxels)} taxels. Amplitude 1 is a taxel's ON amplitude. Frequencies of keyframes"
            f" are whole hertz; the exact resonance is the reference device's, whose custom value is Q{loop}."
        ),
        "timescale": TICKS_PER_S,
        "avatars": [],
        "perceptions": [
            {
                "id": 0,
                "avatar_id": 0,
                "description": "the pad seen from the touch side",
                "perception_modality": "Vibrotactile",
                "effect_library": [],
                "reference_devices": list({device["id"]: device for device in device_of}.values()),
                "channels": list(_channels(plan, device_of, course)),
            }
        ],
        "syncs": [],
    }
    text = json_text(table)
    tick, levels = course or (np.zeros(0), np.zeros(0))
    channels = json.loads(text)["perceptions"][0]["channels"]
    same = [channel["description"].split()[0] for channel in channels] == [taxel.id for taxel in plan.taxels]
    for k, channel in enumerate(channels if same and course else ()):
        effects = channel["bands"][0]["effects"]
        frames = [(e["position"] + f["relative_position"], f) for e in effects for f in e["keyframes"]]
        # Between two effects that meet, both have the level there.
        at = [tick for tick, _ in frames] or [0]
        level = [f["amplitude_modulation"] for _, f in frames] or [0]
        read = np.interp(tick, at, level, left=0.0, right=0.0)
        same &= bool(np.abs(read - np.abs(levels[:, k])).max() < 1e-6 and (np.diff(at) >= 0).all())
    if not same:
        raise FileError("did not read back as it was written; this is a fault of padgen's", "pad.hjif")
    return text


def _devices(plan: Plan, tuning: Tuning) -> Iterator[dict[str, Any]]:
    """Yield the reference device of each taxel; taxels of one channel, resonance and Q share a device."""
    known: dict[tuple[int, float, float], dict[str, Any]] = {}
    for taxel, tuned in zip(plan.taxels, tuning.taxels, strict=True):
        key = (taxel.channel, tuned.resonance_hz, tuned.q)
        if key not in known:
            channel = plan.channels[taxel.channel]
            coil = spec_at_coil_temperature(plan, tuning.coil_c).coil
            hz = tuned.resonance_hz
            q = tuned.q
            drive_hz = hz if plan.scheme.at_resonance else hz / 2
            as_planned = (hz, q) == (channel.resonance_hz, channel.q)
            half = 1 / (2 * q)
            middle = sqrt(1 + 1 / (2 * q) ** 2)
            known[key] = {
                "id": len(known) + 1,
                "name": f"{plan.name} " + (f"channel {taxel.channel}" if as_planned else tuned.id),
                "type": "LRA",
                "resonance_frequency": hz,
                "minimum_frequency": hz * (middle - half),
                "maximum_frequency": hz * (middle + half),
                "impedance": abs(complex(impedance(coil.resistance_ohm, coil.inductance_mh * MH, drive_hz))),
                "maximum_voltage": plan.spec.drive.voltage_limit_v,
                "maximum_current": sqrt(coil.power_limit_w / coil.resistance_ohm),
                "weight": channel.effective_mass_g * GRAM,
                "custom": q,
            }
            if gain := _gain(plan):
                law = level_law(plan.spec)
                drive = plan.spec.drive
                lowest, level = law(np.array([plan.channels[0].resonance_hz, hz]))
                known[key]["maximum_displacement"] = float(drive.level_um * level / lowest) / gain * UM / MM
        yield known[key]


def _gain(plan: Plan) -> float:
    """Return the ON displacement divided by the largest within all limits; 0 if that largest is infinite or zero."""
    largest_um = plan.load.reachable_level_um
    return plan.spec.drive.level_um / largest_um if largest_um > 0 and isfinite(largest_um) else 0.0


def _channels(plan: Plan, device_of: list[dict[str, Any]], course: Course | None) -> Iterator[dict[str, Any]]:
    grid = taxel_grid(plan)
    rows, columns = grid.shape
    place = {int(index): at for at, index in np.ndenumerate(grid) if index >= 0}
    for k, (taxel, device) in enumerate(zip(plan.taxels, device_of, strict=True)):
        hz = round(device["resonance_frequency"])
        channel = {
            "id": k,
            "description": f"{taxel.id} at x = {number(taxel.x_mm)} mm, y = {number(taxel.y_mm)} mm",
            "reference_device_id": device["id"],
            "gain": _gain(plan) or 1.0,
            "mixing_coefficient": 1.0,
            "body_part_mask": 0,
            "direction": {"X": 0, "Y": 0, "Z": LARGEST_VECTOR},
            "bands": [
                {
                    "band_type": "VectorialWave",
                    "lower_frequency_limit": min(floor(device["minimum_frequency"]), hz),
                    "upper_frequency_limit": min(max(ceil(device["maximum_frequency"]), hz), HIGHEST_HZ),
                    "effects": list(_effects(course, k, hz)) if course else [],
                }
            ],
        }
        if max(rows, columns) <= LARGEST_VECTOR:
            row, column = place[k]
            channel["body_part_target"] = ["Unknown"]
            channel["actuator_resolution"] = {"X": columns, "Y": rows, "Z": 1}
            channel["actuator_target"] = [{"X": column, "Y": rows - 1 - row, "Z": 0}]
        yield channel


def _course(timeline: Timeline) -> Course:
    """Return ticks in ms and the signed levels at them: a timeline with straight pieces for its smooth steps."""
    key = np.round(timeline.time_s * TICKS_PER_S).astype(int)
    key = np.maximum.accumulate(key - np.arange(len(key))) + np.arange(len(key))  # no two on one tick
    if np.abs(key / TICKS_PER_S - timeline.time_s).max() > 1.5 / TICKS_PER_S:
        raise SpecError("frames are too short for an .hjif file, which counts in milliseconds", "frames")
    pieces = [key, np.arange(0, int(key[-1]) + 1, LONGEST_EFFECT)]
    changes = (timeline.levels[1:] != timeline.levels[:-1]).any(axis=1)
    for first, last in zip(key[:-1][changes], key[1:][changes], strict=True):
        pieces.append(np.round(np.linspace(first, last, PIECES + 1)).astype(int))
    share = np.linspace(0.0, 1.0, 1001)
    for stretch, taxel in np.argwhere(timeline.signed[:-1] * timeline.signed[1:] < 0).tolist():
        begin, end = timeline.signed[stretch : stretch + 2, taxel]
        middle = np.interp(begin / (begin - end), blend(share), share)
        pieces.append(np.round(key[stretch] + middle * (key[stretch + 1] - key[stretch])).astype(int)[None])
    tick = np.unique(np.concatenate(pieces))
    before = np.clip(np.searchsorted(key, tick, side="right") - 1, 0, len(key) - 2)
    share = blend((tick - key[before]) / (key[before + 1] - key[before]))[:, None]
    level = np.round((1 - share) * timeline.signed[before] + share * timeline.signed[before + 1], 6)
    # What turns over is silent at the tick that is nearest to it.
    for turn, taxel in np.argwhere(level[1:] * level[:-1] < 0).tolist():
        level[turn + int(np.abs(level[turn : turn + 2, taxel]).argmin()), taxel] = 0.0
    return tick, level


def _effects(course: Course, k: int, hz: int) -> Iterator[dict[str, Any]]:
    """Yield an effect for each stretch in which a taxel vibrates; long ones are cut, with the phase continued.

    They are cut where the taxel turns over, too: its phase is half a turn on while its sign is negative.
    """
    tick = course[0]
    signed = course[1][:, k]
    level = np.abs(signed)
    cut = tick % LONGEST_EFFECT == 0
    cut[1:-1] |= signed[:-2] * signed[2:] < 0
    sounds = np.append((level[:-1] > 0) | (level[1:] > 0), False)  # from each tick to the next
    before = np.concatenate([[False], sounds[:-1]])
    bends = np.concatenate([[True], (level[1:-1] != level[:-2]) | (level[1:-1] != level[2:]), [True]])
    ends = np.flatnonzero(before & (cut | ~sounds))
    for first, last in zip(np.flatnonzero(sounds & (cut | ~before)), ends, strict=True):
        points = np.arange(first, last + 1)
        points = points[bends[points] | (points == first) | (points == last)]
        begin = int(tick[first])
        frames: list[dict[str, Any]] = [
            {"relative_position": at - begin, "amplitude_modulation": share}
            for at, share in zip(tick[points].tolist(), level[points].tolist(), strict=True)
        ]
        frames[0]["frequency_modulation"] = hz
        turns = hz * begin / TICKS_PER_S + (0.5 if signed[first : last + 1].sum() < 0 else 0.0)
        yield {
            "effect_type": "Basis",
            "position": begin,
            "phase": min(2 * pi * (turns % 1), LARGEST_PHASE),
            "base_signal": "Sine",
            "keyframes": frames,
        }
