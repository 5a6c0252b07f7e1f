"""MPEG haptics files: they keep the published schemas and the reference decoder's rules, and describe the pad."""

import json

import numpy as np
import pytest

import padgen as pg
from padgen.core.errors import FileError, SpecError
from padgen.driver.formats import hjif
from padgen.driver.formats.hjif import hjif_text
from padgen.driver.frames import state_frames, taxel_grid
from padgen.driver.waveform import Timeline, blend, steady, timeline
from padgen.measured.tuning import TunedTaxel, Tuning, planned_tuning
from padgen.physics.resonator import relative_energy
from padgen.planner import Plan
from padgen.spec import parse_spec
from tests.hjif_reader import read_hjif

SMALL = (
    'name = "t"\nresolution = 7\nband_hz = [50, 400]\nq_min = 15\n'
    "[pad]\nwidth_mm = 25\ndepth_mm = 25\n[coil]\ngrid = [2, 2]\n"
)


def whole(low: int, high: int | None = None) -> dict:
    return {"type": "integer", "minimum": low} | ({} if high is None else {"maximum": high})


def real(low: float, high: float | None = None) -> dict:
    return {"type": "number", "minimum": low} | ({} if high is None else {"maximum": high})


def table(required: dict, **optional: dict) -> dict:
    """Return the schema of an object with these keys only, since any other key would be a mistake."""
    return {
        "type": "object",
        "properties": required | optional,
        "required": list(required),
        "additionalProperties": False,
    }


def rows(of: dict, least: int = 0) -> dict:
    return {"type": "array", "items": of, "minItems": least}


TEXT = {"type": "string"}
VECTOR = table({axis: whole(-127, 127) for axis in "XYZ"})
DEVICE = table(
    {"id": whole(1), "name": TEXT},
    body_part_mask=whole(0, 2**32 - 1),
    type={"enum": ["LRA", "VCA", "ERM", "Piezo", "Unknown"]},
    custom={"type": "number"},
    **{f"{end}_frequency": real(0) for end in ("minimum", "resonance", "maximum")},
    **{f"maximum_{what}": real(0) for what in ("amplitude", "voltage", "current", "displacement")},
    **{what: real(0) for what in ("impedance", "weight", "size")},
)
# Whole hertz and the keys of a basis effect: what the reference decoder asks beyond the schemas.
KEYFRAME = table(
    {"relative_position": whole(0), "amplitude_modulation": real(-1, 1)}, frequency_modulation=whole(0, 10_000)
)
EFFECT = table(
    {
        "effect_type": {"enum": ["Basis"]},
        "position": whole(0),
        "phase": real(0, 6.28318),
        "base_signal": {"enum": ["Sine", "Square", "Triangle", "SawToothUp", "SawToothDown"]},
        "keyframes": rows(KEYFRAME, 2),
    }
)
BAND = table(
    {
        "band_type": {"enum": ["VectorialWave"]},
        "lower_frequency_limit": whole(0, 10_000),
        "upper_frequency_limit": whole(0, 10_000),
        "effects": rows(EFFECT),
    }
)
CHANNEL = table(
    {
        "id": whole(0),
        "description": TEXT,
        "gain": real(0),
        "mixing_coefficient": real(0),
        "body_part_mask": whole(0, 2**32 - 1),
        "bands": rows(BAND, 1),
    },
    reference_device_id=whole(0),
    direction=VECTOR,
    body_part_target=rows({"enum": ["Unknown", "All", "Hand", "Palm", "Finger"]}),
    actuator_resolution=VECTOR,
    actuator_target=rows(VECTOR),
)
PERCEPTION = table(
    {
        "id": whole(0),
        "perception_modality": {"enum": ["Vibrotactile"]},
        "description": TEXT,
        "avatar_id": whole(0),
        "effect_library": rows(EFFECT),
        "channels": rows(CHANNEL, 1),
    },
    reference_devices=rows(DEVICE),
)
SCHEMA = table(
    {
        "version": {"type": "string", "pattern": "^[0-9]{4}(-[0-9])?$"},
        "profile": {"enum": ["Main", "Simple Parametric"]},
        "level": whole(1, 2),
        "date": {"type": "string", "pattern": r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d[+-]\d\d:\d\d$"},
        "description": TEXT,
        "timescale": whole(1),
        "avatars": rows({"type": "object"}),
        "perceptions": rows(PERCEPTION, 1),
        "syncs": rows({"type": "object"}),
    }
)
"""Names, enumerations and bounds of the format that pads use, by ISO/IEC 23090-31 and its schemas (edition 2023).

They are in padgen's own words, since the schemas come without a licence.
"""


def perception(text: str) -> dict:
    return json.loads(text)["perceptions"][0]


def refuse_faults(text: str) -> None:
    """Raise where a file breaks the schemas or the reference decoder's rules for the whole file."""
    import jsonschema  # takes 3 s

    whole_file = json.loads(text)
    jsonschema.validate(whole_file, SCHEMA)
    (own,) = whole_file["perceptions"]
    devices = {device["id"]: device for device in own["reference_devices"]}
    assert len(devices) == len(own["reference_devices"])
    assert [channel["id"] for channel in own["channels"]] == list(range(len(own["channels"])))
    assert whole_file["level"] == (1 if len(own["channels"]) <= 128 else 2) and whole_file["timescale"] == 1000
    for device in devices.values():
        assert device["minimum_frequency"] <= device["resonance_frequency"] <= device["maximum_frequency"]
    for channel in own["channels"]:
        device, (band,) = devices[channel["reference_device_id"]], channel["bands"]
        target = channel["actuator_target"][0]
        size = channel["actuator_resolution"]
        assert all(0 <= target[axis] < size[axis] for axis in "XYZ")
        assert sum(value**2 for value in channel["direction"].values()) == 127**2
        assert band["lower_frequency_limit"] <= device["resonance_frequency"] <= band["upper_frequency_limit"]
        refuse_faulty_effects(band)


def refuse_faulty_effects(band: dict) -> None:
    end = 0
    for effect in band["effects"]:
        places = [frame["relative_position"] for frame in effect["keyframes"]]
        assert effect["position"] >= end and places[0] == 0 and min(np.diff(places)) > 0 and places[-1] <= 65_535
        end = effect["position"] + places[-1]
        first = effect["keyframes"][0]["frequency_modulation"]
        assert band["lower_frequency_limit"] <= first <= band["upper_frequency_limit"]


@pytest.fixture(scope="module")
def small() -> Plan:
    return pg.plan(parse_spec(SMALL))


def frames_of(plan: Plan, count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 3, (count, len(plan.taxels))) / 2


@pytest.mark.sample(3)
@pytest.mark.parametrize("name", ["paper-16", "paper-32", "quad-64", "wide-11", "big-512"])
def test_files_keep_the_formats_rules(name):
    plan = pg.plan(name)
    text = hjif_text(plan, timeline(plan, frames_of(plan, 2)))
    refuse_faults(text)
    refuse_faults(hjif_text(plan))
    assert text == hjif_text(plan, timeline(plan, frames_of(plan, 2)))


@pytest.mark.parametrize("drive", ["time-shared", "biased", "spur-free"])
def test_other_drives_and_two_sets(drive):
    plan = pg.plan(parse_spec(SMALL + f'reuse = "alternate"\n[drive]\nscheme = "{drive}"\n'))
    shown = timeline(plan, state_frames(plan, "all"))
    text = hjif_text(plan, shown)
    refuse_faults(text)
    assert len(read_hjif(text).devices) == 4


def test_devices_are_the_kinds_of_taxel(small):
    """Resonance, half-power frequencies, impedance and limits are written with ten digits."""
    spec = small.spec
    read = read_hjif(hjif_text(small))
    assert [device.name for device in read.devices] == ["t channel 0", "t channel 1"]
    assert [read.devices[c.device - 1].name[-1] for c in read.channels] == list("0101010")
    for device, channel in zip(read.devices, small.channels, strict=True):
        assert device.resonance_frequency == pytest.approx(channel.resonance_hz, rel=1e-9)
        # Half the power is half the velocity's energy; the displacement's is (f₀/f)² of it, 7 % more or less at Q = 15.
        for edge in (device.minimum_frequency, device.maximum_frequency):
            assert relative_energy(edge, channel.resonance_hz, channel.q) == pytest.approx(0.5, abs=0.05)
        width = device.maximum_frequency - device.minimum_frequency
        assert width == pytest.approx(channel.resonance_hz / channel.q, rel=1e-8)
        # Tones: the coil is driven at half the resonance.
        reactance = np.pi * channel.resonance_hz * spec.coil.inductance_mh * 1e-3
        assert device.impedance == pytest.approx(np.hypot(spec.coil.resistance_ohm, reactance), rel=1e-9)
        assert device.maximum_voltage == spec.drive.voltage_limit_v
        assert device.maximum_current**2 * spec.coil.resistance_ohm == pytest.approx(spec.coil.power_limit_w)
        assert device.custom == channel.q and device.weight == pytest.approx(channel.effective_mass_g * 1e-3)
        on_mm = read.channels[channel.index].gain * device.maximum_displacement
        assert on_mm == pytest.approx(channel.level_um * 1e-3, rel=1e-8)
    reachable = small.load.reachable_level_um * 1e-3
    assert read.devices[0].maximum_displacement == pytest.approx(reachable, rel=1e-8)


def test_places_are_those_of_the_image(small):
    grid = taxel_grid(small)
    for k, channel in enumerate(read_hjif(hjif_text(small)).channels):
        assert channel.taxel == small.taxels[k].id and grid[channel.place] == k
    lowest_left = perception(hjif_text(small))["channels"][int(grid[-1, 0])]
    assert lowest_left["actuator_target"] == [{"X": 0, "Y": 0, "Z": 0}]


def test_a_measured_pad_has_a_device_for_each_taxel(small):
    planned = planned_tuning(small).taxels
    tuned = [
        TunedTaxel(t.id, t.resonance_hz * (1 + 0.01 * k), 0.1, 20.0 + k, 0.5, 1.0, 0.1, True, True)
        for k, t in enumerate(planned[:6])
    ]
    text = hjif_text(small, None, Tuning("t", (*tuned, planned[6])))
    refuse_faults(text)
    read = read_hjif(text)
    assert [device.name for device in read.devices] == [*(f"t {t.id}" for t in tuned), "t channel 0"]
    for channel, taxel in zip(read.channels, (*tuned, planned[6]), strict=True):
        device = read.devices[channel.device - 1]
        assert (device.resonance_frequency, device.custom) == pytest.approx((taxel.resonance_hz, taxel.q), rel=1e-9)


def played(band: dict, time_s: np.ndarray) -> np.ndarray:
    """Play a band as the standard's synthesiser does: straight amplitudes times a sine from the effect's phase."""
    signal = np.zeros(len(time_s))
    for effect in band["effects"]:
        frames = effect["keyframes"]
        at = effect["position"] / 1000 + np.array([frame["relative_position"] for frame in frames]) / 1000
        inside = (time_s >= at[0]) & (time_s <= at[-1])
        since = time_s[inside] - at[0]
        hz = frames[0]["frequency_modulation"]
        amplitude = np.interp(time_s[inside], at, [frame["amplitude_modulation"] for frame in frames])
        signal[inside] = amplitude * np.sin(2 * np.pi * hz * since + effect["phase"])
    return signal


def level_of(shown: Timeline, taxel: int, time_s: np.ndarray) -> np.ndarray:
    """Return the timeline's own level, with its smooth steps."""
    key = np.clip(np.searchsorted(shown.time_s, time_s, side="right") - 1, 0, len(shown.time_s) - 2)
    share = (time_s - shown.time_s[key]) / (shown.time_s[key + 1] - shown.time_s[key])
    before = shown.signed[key, taxel]
    after = shown.signed[key + 1, taxel]
    return before + (after - before) * blend(np.clip(share, 0, 1))


@pytest.mark.parametrize("signed", [False, True])
def test_what_is_played_has_the_timelines_levels(small, signed):
    """Within 0.02: straight pieces leave the smooth step by 0.011, and times are rounded to half a millisecond.

    What turns over does so within a millisecond of its time, and is twice as steep.
    """
    frames = frames_of(small, 4)
    signs = np.random.default_rng(2).choice([-1.0, 1.0], frames.shape) if signed else 1.0
    shown = timeline(small, frames, signs=signs)
    channels = perception(hjif_text(small, shown))["channels"]
    time_s = np.arange(0, shown.seconds, 1e-3)
    for k, channel in enumerate(channels):
        (band,) = channel["bands"]
        hz = round(small.channels[small.taxels[k].channel].resonance_hz)
        carrier = np.sin(2 * np.pi * hz * time_s)
        assert np.abs(played(band, time_s) - level_of(shown, k, time_s) * carrier).max() < (0.04 if signed else 0.02)


def test_long_vibrations_are_cut_without_a_seam(small):
    shown = steady(np.array([0.25, 1, 0, 0.5, 1, 1, 1]), 150.0005)
    channels = perception(hjif_text(small, shown))["channels"]
    assert [len(channel["bands"][0]["effects"]) for channel in channels] == [3, 3, 0, 3, 3, 3, 3]
    time_s = np.arange(59.9, 60.1, 1e-4)
    hz = round(small.channels[0].resonance_hz)
    assert np.abs(played(channels[0]["bands"][0], time_s) - 0.25 * np.sin(2 * np.pi * hz * time_s)).max() < 1e-4
    refuse_faults(hjif_text(small, shown))


def test_what_was_written_is_read(small):
    """Levels are exact at the keyframes, whose times are moved by half a millisecond at most."""
    shown = timeline(small, frames_of(small, 5))
    read = read_hjif(hjif_text(small, shown))
    ticks = np.round(shown.time_s * 1000) / 1000
    assert np.abs(read.levels_at(ticks) - shown.levels).max() < 1e-6
    assert np.array_equal(read.levels_at(np.array([shown.seconds + 0.01])), np.zeros((1, 7)))
    assert "leads over" not in read.description
    assert "leads over" in read_hjif(hjif_text(small, steady(np.ones(7), 1.0))).description


def test_a_fault_in_writing_is_seen_in_reading(small, monkeypatch):
    real_effects = hjif._effects
    monkeypatch.setattr(hjif, "_effects", lambda course, *which: real_effects((course[0] + 1, course[1]), *which))
    with pytest.raises(FileError, match="did not read back as it was written"):
        hjif_text(small, timeline(small, frames_of(small, 2)))


def test_short_transitions_do_not_fall_on_one_tick(small):
    shown = Timeline(np.array([0.0, 0.0002, 0.0014, 0.0016, 0.5]), np.eye(5, 7) * 0.5, False)
    text = hjif_text(small, shown)
    refuse_faults(text)
    with pytest.raises(SpecError, match=r"frames are too short for an \.hjif file, which counts in milliseconds"):
        hjif_text(small, Timeline(np.arange(20) * 2e-4, np.zeros((20, 7)), False))


@pytest.mark.parametrize("hz", [0.3, 12_000.0])
def test_resonances_beyond_the_format(small, hz):
    taxels = planned_tuning(small).taxels
    odd = TunedTaxel("r0c0k0", hz, 0.0, 15.0, 0.0, 1.0, 0.0, True, True)
    with pytest.raises(SpecError, match=r"carries 1 … 10000 Hz; r0c0k0 is at (0.3|12000) Hz"):
        hjif_text(small, None, Tuning("t", (odd, *taxels[1:])))


def test_a_pad_without_a_limit_or_a_pull_says_no_largest_displacement(small):
    from dataclasses import replace

    for reachable in (0.0, float("inf")):
        text = hjif_text(replace(small, load=replace(small.load, reachable_level_um=reachable)))
        refuse_faults(text)
        read = read_hjif(text)
        assert read.devices[0].maximum_displacement is None and read.channels[0].gain == 1
