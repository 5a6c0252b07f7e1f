"""A reader of the `.hjif` files that padgen writes, to compare their content with the plan."""

import json
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

TICKS_PER_S = 1000


@dataclass(frozen=True, slots=True)
class HapticDevice:
    """A kind of taxel; fields that the file does not state are None."""

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
    """A taxel: its id, its device's id, and its level (m,) at times (m,), straight in between and 0 outside.

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
    """The content of a file."""

    description: str
    devices: tuple[HapticDevice, ...]
    channels: tuple[HapticChannel, ...]

    def levels_at(self, time_s: np.ndarray) -> np.ndarray:
        """Return the levels (k, channels) at times (k,)."""
        levels = np.zeros((len(time_s), len(self.channels)))
        for k, channel in enumerate(self.channels):
            if len(channel.time_s):
                levels[:, k] = np.interp(time_s, channel.time_s, channel.level, left=0.0, right=0.0)
        return levels


def read_hjif(text: str) -> Hjif:
    """Read back a file that `hjif_text` wrote; other text raises an error."""
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
    time_s = []
    level = []
    hz = 0.0
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
