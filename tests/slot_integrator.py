"""Contrast over every frame's slot, by an integration of a WAV file's bytes that shares no code with padgen.

The samples are the coils' voltages; the coils and the taxels' working modes are integrated exactly for signals that are
straight between samples. What moves more slowly than half the lowest resonance, the mean pull's share, is no vibration.
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
        omega = 2 * np.pi * channel.resonance_hz
        mode = cont2discrete(([omega**2], [1.0, omega / channel.q, omega**2]), 1 / rate, "foh")
        motion = sosfiltfilt(vibration, lfilter(mode[0].ravel(), mode[1], current**2))
        # A line of 1 at the resonance moves the taxel by Q.
        wanted = channel.q * channel.line_a2
        for k in range(len(frames)):
            start = round(k * seconds * rate)
            stop = round((k + 1) * seconds * rate)
            level[k, index] = np.sqrt((motion[start:stop] ** 2).mean()) / wanted
            held = motion[stop - round(END_PERIODS / lowest_hz * rate) : stop]
            last[k, index] = np.sqrt((held**2).mean()) / wanted
    coil_of = np.array([taxel.coil[0] * plan.coils.columns + taxel.coil[1] for taxel in plan.taxels])
    found = []
    for figure in (level, last):
        contrast = np.full((len(frames), plan.coils.rows * plan.coils.columns), np.nan)
        for k, frame in enumerate(np.asarray(frames)):
            for coil in np.unique(coil_of):
                own = coil_of == coil
                on = own & (frame > 0)
                off = own & (frame <= 0)
                if on.any() and off.any():
                    contrast[k, coil] = 20 * np.log10((figure[k, on] / frame[on]).min() / figure[k, off].max())
        found.append(contrast)
    return tuple(found)
