"""Judge a pad from its plan.json alone; this program imports nothing of padgen."""

from math import inf, log10, pi, sqrt
from typing import Any

STRENGTH_OVER_FATIGUE = 4.0
"""Breaking stress over the stress that plastic bears for long: docs/accuracy.md."""
LARGEST_BEND = 0.25
"""Deflection over a beam's length up to which linear beams hold."""
BAND_SLACK = 1e-3
HAND_M_PER_S2 = 5.0
"""Directive 2002/44/EC, eight hours a day, weighted as ISO 5349-1:2001, annex A, has it."""


def at_a_finger_m_per_s2(hz: float, amplitude_m: float) -> float:
    """Return the weighted root mean square of the acceleration of a sine: the filters of ISO 5349-1, table A.1."""
    s = 2j * pi * hz
    low = 2 * pi * 6.310
    high = 2 * pi * 1258.9
    turn = 2 * pi * 15.915
    band = s**2 * high**2 / ((s**2 + low * s / 0.71 + low**2) * (s**2 + high * s / 0.71 + high**2))
    slope = (s + turn) * turn / (s**2 + turn * s / 0.64 + turn**2)
    return abs(band * slope) * abs(s) ** 2 * amplitude_m / sqrt(2)


def broken_limits(plan: dict[str, Any]) -> set[str]:
    """Return the names of the limits that the pad breaks with all taxels on."""
    spec = plan["spec"]
    load = plan["load"]
    coil = spec["coil"]
    amplifier = spec.get("amplifier")
    coils = plan["coils"]["rows"] * plan["coils"]["columns"]
    watts = (load["current_rms_ma"] / 1e3) ** 2 * coil["resistance_ohm"]
    power_w = spec["limits"]["power_w"]
    broken = set()
    if watts > coil["power_limit_w"]:
        broken.add("heat")
    if load["voltage_peak_v"] > spec["drive"]["voltage_limit_v"]:
        broken.add("voltage")
    if amplifier is not None and load["current_peak_ma"] / 1e3 > amplifier["current_a"]:
        broken.add("current")
    if power_w is not None and watts * coils > power_w:
        broken.add("power")
    if load["pull_in_share"] >= 1:
        broken.add("snap")
    if not fits_bed(spec):
        broken.add("bed")
    glass_c = spec["material"]["glass_c"]
    warm = plan["warm"]
    if glass_c is not None and 0.7 * (warm["beam_c"] - warm["room_c"]) > glass_c - 15 - warm["room_c"]:
        broken.add("warmth")
    fatigue_mpa = spec["material"]["fatigue_stress_mpa"]
    low_hz, high_hz = spec["band_hz"]
    for channel in plan["channels"]:
        moved_um = channel["level_um"] + channel["sag_um"] + channel["static_um"]
        swing_mpa = channel["root_stress_mpa"]
        hz = channel["resonance_hz"]
        if moved_um >= coil["gap_mm"] * 1e3:
            broken.add("touches the coil")
        if swing_mpa > fatigue_mpa:
            broken.add("fatigue")
        if swing_mpa * moved_um / channel["level_um"] > STRENGTH_OVER_FATIGUE * fatigue_mpa:
            broken.add("strength")
        if moved_um > LARGEST_BEND * channel["beam"]["length_mm"] * 1e3:
            broken.add("bend")
        if at_a_finger_m_per_s2(hz, channel["level_um"] * 1e-6) > HAND_M_PER_S2:
            broken.add("hand")
        if not low_hz * (1 - BAND_SLACK) <= hz <= high_hz * (1 + BAND_SLACK):
            broken.add("band")
    return broken


def fits_bed(spec: dict[str, Any]) -> bool:
    """Return whether the pad with its border lies on the printer's bed, in either orientation."""
    pad = spec["pad"]
    printer = spec["printer"]
    sides = sorted(pad[f"{side}_mm"] + 2 * pad["border_mm"] for side in ("width", "depth"))
    bed = sorted((printer["bed_x_mm"], printer["bed_y_mm"]))
    return sides[0] <= bed[0] and sides[1] <= bed[1]


def judged_level(plan: dict[str, Any]) -> str:
    """Return 'error', 'short', 'retune' or 'good'."""
    if broken_limits(plan):
        return "error"
    prints = plan["prints"]
    spec = plan["spec"]
    shown = next(one for one in plan["refresh"] if one["scheme"] == plan["selectivity"]["drive"])
    if shown["frames_per_s"] < spec["drive"]["least_frames_per_s"]:
        return "short"
    if prints["print_db"] is None:
        return "short" if recoil_spoils(plan, inf, "in_step_db") else "good"
    if prints["planned_db"] >= 20 * log10(spec["delta_y"]):
        return "short" if recoil_spoils(plan, prints["planned_db"], "in_step_db") else "good"
    if prints["good_share"] < spec["print_share"]:
        return "short"
    return "short" if recoil_spoils(plan, prints["print_db"], "apart_db") else "retune"


def recoil_spoils(plan: dict[str, Any], held_db: float, moving: str) -> bool:
    """Return whether less is kept than is asked on the mount that the spec states, energies added."""
    recoil = plan["recoil"]
    if all(value in (None, "unsaid") for value in plan["spec"]["mount"].values()) or recoil[moving] is None:
        return False
    still = 0.0 if recoil["clamped_db"] is None else 10 ** (-recoil["clamped_db"] / 10)
    energy = 10 ** (-held_db / 10) + max(0.0, 10 ** (-recoil[moving] / 10) - still)
    return energy > 10 ** (-log10(plan["spec"]["delta_y"]) * 2)
