"""Contrast over every frame's slot, by an integration of a WAV file's bytes that shares no code with padgen.

The samples are the coils' voltages; the coils and all modes of the taxels are integrated exactly for signals that are
straight between samples. What moves more slowly than half the lowest resonance, the mean pull's share, is no vibration.
A finger feels the boss rise and tilt: the energies of the two add.
"""

import numpy as np
from scipy.io import wavfile
from scipy.signal import butter, cont2discrete, lfilter, sosfiltfilt

END_PERIODS = 6
"""Periods of the lowest resonance at a slot's end over which the figure at its end is taken."""


def slot_contrast_db(plan, frames, seconds, folder):
    """Return contrasts (frames, coils) in dB, over the slots and at their ends, of ``drive.wav`` in `folder`.

    A contrast is the smallest ON over the largest OFF root mean square in a coil, each over the taxel's level and NaN
    where a coil has none of either.
    """
    rate, played = wavfile.read(folder / "drive.wav")
    ohm = plan.spec.coil.resistance_ohm
    henry = plan.spec.coil.inductance_mh * 1e-3
    circuit = cont2discrete(([1.0], [henry, ohm]), 1 / rate, "foh")
    lowest_hz = min(channel.resonance_hz for channel in plan.channels)
    vibration = butter(4, lowest_hz / 2, "high", fs=rate, output="sos")
    level = np.zeros((len(frames), len(plan.taxels)))
    last = np.zeros_like(level)
    for index, taxel in enumerate(plan.taxels):
        channel = plan.channels[taxel.channel]
        samples = played[:, taxel.coil[0] * plan.coils.columns + taxel.coil[1]].astype(float)
        current = lfilter(circuit[0].ravel(), circuit[1], samples)
        motion = felt_motion(channel, plan.spec.taxel.boss_diameter_mm / 2e3, current**2, rate)
        motion = sosfiltfilt(vibration, motion)
        # A line of 1 at the resonance moves the working mode by Q.
        wanted = channel.q * channel.line_a2
        for k in range(len(frames)):
            start = round(k * seconds * rate)
            stop = round((k + 1) * seconds * rate)
            level[k, index] = np.sqrt((motion[:, start:stop] ** 2).mean(1).sum()) / wanted
            held = motion[:, stop - round(END_PERIODS / lowest_hz * rate) : stop]
            last[k, index] = np.sqrt((held**2).mean(1).sum()) / wanted
    coil_of = np.array([taxel.coil[0] * plan.coils.columns + taxel.coil[1] for taxel in plan.taxels])
    found = []
    for figure in (level, last):
        contrast = np.full((len(frames), plan.coils.rows * plan.coils.columns), np.nan)
        for k, frame in enumerate(np.asarray(frames)):
            for coil in np.unique(coil_of):
                in_coil = coil_of == coil
                on = in_coil & (frame > 0)
                off = in_coil & (frame <= 0)
                if on.any() and off.any():
                    contrast[k, coil] = 20 * np.log10((figure[k, on] / frame[on]).min() / figure[k, off].max())
        found.append(contrast)
    return tuple(found)


def felt_motion(channel, boss_radius_m, force, rate):
    """Return the boss' rise and its edge's tilts (3, samples) over the working mode's static rise under a force of 1.

    Modes are normalised to their mass: each is moved by its motion where the washer is pulled, as a resonator.
    """
    shape = np.array(channel.mode_motions)
    omega = 2 * np.pi * np.array(channel.modes_hz)
    static = shape[:, 2:5] * [1.0, boss_radius_m / 2, boss_radius_m / 2]
    static *= (shape @ channel.pull_wrench / omega**2)[:, None]
    static /= np.linalg.norm(static[np.abs(omega / 2 / np.pi - channel.resonance_hz).argmin()])
    motion = np.zeros((3, len(force)))
    for mode_omega, share in zip(omega, static, strict=True):
        mode = cont2discrete(([mode_omega**2], [1.0, mode_omega / channel.q, mode_omega**2]), 1 / rate, "foh")
        motion += share[:, None] * lfilter(mode[0].ravel(), mode[1], force)
    return motion
