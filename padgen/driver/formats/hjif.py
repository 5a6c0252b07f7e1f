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
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, floor, isfinite, pi, sqrt
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import FileError, SpecError, number
from padgen.core.files import OutputFolder, json_text
from padgen.core.units import GRAM, MH, MM, UM
from padgen.driver.formats import DriveJob
from padgen.driver.frames import taxel_grid
from padgen.driver.timeline import Timeline, blend
from padgen.measured.tuning import TunedTaxel, Tuning, planned_tuning
from padgen.physics.magnetics import impedance
from padgen.planner.plan import Plan
from padgen.planner.settings import level_law

__all__ = [
    "FILE",
    "MADE_OF",
    "ORDER",
    "HapticChannel",
    "HapticDevice",
    "Hjif",
    "hjif_text",
    "read_hjif",
    "write",
]

ORDER, MADE_OF, FILE = 3, "drive", "drive.hjif"
DATE = "1970-01-01T00:00:00+00:00"
TICKS_PER_S = 1000
LOWEST_HZ, HIGHEST_HZ = 1, 10_000
MOST_LEVEL_1 = 128
"""Channels of a perception at level 1 of the profile; level 2 takes 65,536."""
LARGEST_VECTOR = 127
LARGEST_PHASE = 6.28318
PIECES = 10
"""Straight pieces for a smooth step: they leave it by at most 0.011 of its height."""
LONGEST_EFFECT = 60_000
"""Ticks of an effect: the format's binary form counts them in 16 bits."""


@dataclass(frozen=True, slots=True)
class HapticDevice:
    """A kind of taxel; None where the file does not say."""

    id: int
    name: str
    resonance_frequency: float
    minimum_frequency: float
    maximum_frequency: float
    impedance: float
    maximum_voltage: float
    maximum_current: float
    maximum_displacement: float | None
    weight: float
    custom: float


@dataclass(frozen=True, slots=True, eq=False)
class HapticChannel:
    """A taxel by its id, its device's, and its level (m,) at times (m,), straight between and 0 outside.

    `place` is its row and column in `taxel_grid`, None where that is too large for the format.
    """

    taxel: str
    device: int
    place: tuple[int, int] | None
    gain: float
    frequency_hz: float
    time_s: np.ndarray
    level: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Hjif:
    """What a file says."""

    description: str
    devices: tuple[HapticDevice, ...]
    channels: tuple[HapticChannel, ...]

    def levels_at(self, time_s: np.ndarray) -> np.ndarray:
        """Levels (k, channels) at times (k,)."""
        levels = np.zeros((len(time_s), len(self.channels)))
        for k, channel in enumerate(self.channels):
            if len(channel.time_s):
                levels[:, k] = np.interp(time_s, channel.time_s, channel.level, left=0.0, right=0.0)
        return levels


class _Course(NamedTuple):
    """Levels (m, taxels) at ticks (m,), straight between them; the timeline's keyframes are those at `keys`."""

    tick: np.ndarray
    level: np.ndarray
    keys: np.ndarray


def write(out: OutputFolder, job: DriveJob) -> None:
    """Add the file."""
    out.write(FILE, hjif_text(job.plan, job.timeline, job.request.tuning))


def hjif_text(plan: Plan, timeline: Timeline | None = None, tuning: Tuning | None = None) -> str:
    """The text of an `.hjif` file: the pad, as planned or as measured, and what `timeline` shows on it.

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
    devices, device_of = _devices(plan, tuning)
    course = _course(timeline) if timeline else None
    table = {
        "version": "2023",
        "profile": "Simple Parametric",
        "level": 1 if len(plan.taxels) <= MOST_LEVEL_1 else 2,
        "date": DATE,
        "description": _description(plan, timeline),
        "timescale": TICKS_PER_S,
        "avatars": [],
        "perceptions": [
            {
                "id": 0,
                "avatar_id": 0,
                "description": "the pad seen from the touch side",
                "perception_modality": "Vibrotactile",
                "effect_library": [],
                "reference_devices": devices,
                "channels": list(_channels(plan, devices, device_of, course)),
            }
        ],
        "syncs": [],
    }
    text = json_text(table)
    _refuse_difference(read_hjif(text), plan, course)
    return text


def _description(plan: Plan, timeline: Timeline | None) -> str:
    loop = "; the end leads over into the beginning" if timeline and timeline.loops else ""
    return (
        f"{plan.name}: {len(plan.taxels)} taxels. Amplitude 1 is a taxel's ON amplitude. Frequencies of keyframes are"
        f" whole hertz; the exact resonance is the reference device's, whose custom value is Q{loop}."
    )


def _devices(plan: Plan, tuning: Tuning) -> tuple[list[dict[str, Any]], list[int]]:
    """A device for each kind of taxel, and which (index) each taxel is."""
    known: dict[tuple[int, float, float], int] = {}
    devices: list[dict[str, Any]] = []
    device_of = []
    for taxel, tuned in zip(plan.taxels, tuning.taxels, strict=True):
        key = (taxel.channel, tuned.resonance_hz, tuned.q)
        if key not in known:
            known[key] = len(devices)
            devices.append(_device(plan, taxel.channel, tuned, len(devices) + 1))
        device_of.append(known[key])
    return devices, device_of


def _device(plan: Plan, index: int, tuned: TunedTaxel, device_id: int) -> dict[str, Any]:
    channel, coil, hz, q = plan.channels[index], plan.spec.coil, tuned.resonance_hz, tuned.q
    scheme = plan.scheme
    drive_hz = hz if scheme.has_constant else hz / 2
    as_planned = (hz, q) == (channel.resonance_hz, channel.q)
    half = 1 / (2 * q)
    middle = sqrt(1 + half**2)
    device = {
        "id": device_id,
        "name": f"{plan.name} " + (f"channel {index}" if as_planned else tuned.id),
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
        device["maximum_displacement"] = _on_um(plan, hz) / gain * UM / MM
    return device


def _gain(plan: Plan) -> float:
    """ON displacement over the largest that the limits allow; 0 where there is no such limit, or no pull."""
    largest_um = plan.load.reachable_level_um
    return plan.spec.drive.level_um / largest_um if largest_um > 0 and isfinite(largest_um) else 0.0


def _on_um(plan: Plan, resonance_hz: float) -> float:
    law, drive = level_law(plan.spec), plan.spec.drive
    lowest, own = law(np.array([plan.channels[0].resonance_hz, resonance_hz]))
    return float(drive.level_um * own / lowest)


def _channels(
    plan: Plan, devices: list[dict[str, Any]], device_of: list[int], course: _Course | None
) -> Iterator[dict[str, Any]]:
    grid = taxel_grid(plan)
    rows, columns = grid.shape
    place = {int(index): at for at, index in np.ndenumerate(grid) if index >= 0}
    for k, taxel in enumerate(plan.taxels):
        device = devices[device_of[k]]
        channel = {
            "id": k,
            "description": f"{taxel.id} at x = {number(taxel.x_mm)} mm, y = {number(taxel.y_mm)} mm",
            "reference_device_id": device["id"],
            "gain": _gain(plan) or 1.0,
            "mixing_coefficient": 1.0,
            "body_part_mask": 0,
            "direction": {"X": 0, "Y": 0, "Z": LARGEST_VECTOR},
            "bands": [_band(device, course, k)],
        }
        if max(rows, columns) <= LARGEST_VECTOR:
            row, column = place[k]
            channel["body_part_target"] = ["Unknown"]
            channel["actuator_resolution"] = {"X": columns, "Y": rows, "Z": 1}
            channel["actuator_target"] = [{"X": column, "Y": rows - 1 - row, "Z": 0}]
        yield channel


def _band(device: dict[str, Any], course: _Course | None, k: int) -> dict[str, Any]:
    hz = round(device["resonance_frequency"])
    return {
        "band_type": "VectorialWave",
        "lower_frequency_limit": min(floor(device["minimum_frequency"]), hz),
        "upper_frequency_limit": min(max(ceil(device["maximum_frequency"]), hz), HIGHEST_HZ),
        "effects": list(_effects(course, k, hz)) if course else [],
    }


def _course(timeline: Timeline) -> _Course:
    """The smooth steps between the keyframes as straight pieces, on whole ticks."""
    key = np.round(timeline.time_s * TICKS_PER_S).astype(int)
    key = np.maximum.accumulate(key - np.arange(len(key))) + np.arange(len(key))  # no two on one tick
    if np.abs(key / TICKS_PER_S - timeline.time_s).max() > 1.5 / TICKS_PER_S:
        raise SpecError("frames are too short for an .hjif file, which counts in milliseconds", "frames")
    pieces = [key, np.arange(0, int(key[-1]) + 1, LONGEST_EFFECT)]
    for first, last in zip(*_changes(key, timeline.levels), strict=True):
        pieces.append(np.round(np.linspace(first, last, PIECES + 1)).astype(int))
    tick = np.unique(np.concatenate(pieces))
    before = np.clip(np.searchsorted(key, tick, side="right") - 1, 0, len(key) - 2)
    share = blend((tick - key[before]) / (key[before + 1] - key[before]))[:, None]
    level = (1 - share) * timeline.levels[before] + share * timeline.levels[before + 1]
    return _Course(tick, np.round(level, 6), np.searchsorted(tick, key))


def _changes(key: np.ndarray, levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and last ticks of the transitions in which a level changes."""
    changes = (levels[1:] != levels[:-1]).any(axis=1)
    return key[:-1][changes], key[1:][changes]


def _effects(course: _Course, k: int, hz: int) -> Iterator[dict[str, Any]]:
    """The stretches in which a taxel vibrates, cut where they would get too long; the phase leads on."""
    tick, level = course.tick, course.level[:, k]
    cut = tick % LONGEST_EFFECT == 0
    sounds = np.append((level[:-1] > 0) | (level[1:] > 0), False)  # from each tick to the next
    before = np.concatenate([[False], sounds[:-1]])
    bends = np.concatenate([[True], (level[1:-1] != level[:-2]) | (level[1:-1] != level[2:]), [True]])
    ends = np.flatnonzero(before & (cut | ~sounds))
    for first, last in zip(np.flatnonzero(sounds & (cut | ~before)), ends, strict=True):
        points = np.arange(first, last + 1)
        points = points[bends[points] | (points == first) | (points == last)]
        yield _effect(tick[points], level[points], hz)


def _effect(tick: np.ndarray, level: np.ndarray, hz: int) -> dict[str, Any]:
    turns = (hz * int(tick[0]) / TICKS_PER_S) % 1
    frames: list[dict[str, Any]] = [
        {"relative_position": int(at - tick[0]), "amplitude_modulation": float(share)}
        for at, share in zip(tick, level, strict=True)
    ]
    frames[0]["frequency_modulation"] = hz
    return {
        "effect_type": "Basis",
        "position": int(tick[0]),
        "phase": min(2 * pi * turns, LARGEST_PHASE),
        "base_signal": "Sine",
        "keyframes": frames,
    }


def read_hjif(text: str, where: str = "pad.hjif") -> Hjif:
    """Read back a file that `hjif_text` wrote.

    Raises
    ------
    FileError
        The text is no such file.
    """
    try:
        table = json.loads(text)
        (perception,) = table["perceptions"]
        if table["timescale"] != TICKS_PER_S or perception["perception_modality"] != "Vibrotactile":
            raise ValueError("its timescale or its perception is another")
        devices = tuple(_read_device(entry) for entry in perception["reference_devices"])
        channels = tuple(_read_channel(entry) for entry in perception["channels"])
        ids = {device.id for device in devices}
        if any(channel.device not in ids for channel in channels):
            raise ValueError("a channel's reference device is missing")
        return Hjif(str(table["description"]), devices, channels)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise FileError(f"is not a pad's .hjif file ({type(error).__name__}: {error})", where) from error


def _read_device(entry: dict[str, Any]) -> HapticDevice:
    given: dict[str, Any] = {name: entry.get(name) for name in HapticDevice.__dataclass_fields__}
    lacking = [name for name, value in given.items() if value is None and name != "maximum_displacement"]
    if lacking:
        raise KeyError(lacking[0])
    return HapticDevice(**given)


def _read_channel(entry: dict[str, Any]) -> HapticChannel:
    (band,) = entry["bands"]
    if band["band_type"] != "VectorialWave":
        raise ValueError(f"a {band['band_type']} band")
    time_s, level, hz = [], [], 0.0
    for effect in band["effects"]:
        for frame in effect["keyframes"]:
            time_s.append((effect["position"] + frame["relative_position"]) / TICKS_PER_S)
            level.append(float(frame["amplitude_modulation"]))
            hz = float(frame.get("frequency_modulation", hz))
    if any(b < a for a, b in pairwise(time_s)) or not all(0 <= share <= 1 for share in level):
        raise ValueError("keyframes that go back in time, or beyond an amplitude of 1")
    target = entry.get("actuator_target")
    place = (entry["actuator_resolution"]["Y"] - 1 - target[0]["Y"], target[0]["X"]) if target else None
    return HapticChannel(
        entry["description"].split()[0],
        entry["reference_device_id"],
        place,
        float(entry["gain"]),
        hz,
        np.array(time_s),
        np.array(level),
    )


def _refuse_difference(read: Hjif, plan: Plan, course: _Course | None) -> None:
    same = [channel.taxel for channel in read.channels] == [taxel.id for taxel in plan.taxels]
    if course is not None and same:
        # Between two effects that meet, both have the level there.
        levels = read.levels_at(course.tick / TICKS_PER_S)
        same = bool(np.abs(levels - course.level).max() < 1e-6)
    if not same:
        raise FileError("did not read back as it was written; this is a fault of padgen's", "pad.hjif")
