"""Recordings of a shaken or plucked taxel as a bench makes them; shares no code with padgen.

Each mode ``x'' + (ω/Q) x' + ω² x = ω² F`` is integrated exactly for a force that is straight between samples. Recorded
times have their own clock, delay and rate; hum, drift, noise, a high-pass, clipping and steps follow.
"""

import io
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.io import wavfile
from scipy.signal import butter, cont2discrete, lfilter

INNER_HZ = 8000
KINDS: dict[str, dict[str, Any]] = {
    "plain": {},
    "hum": {"hum": 0.05},
    "drift": {"drift": 0.05},
    "drift of 10 %": {"drift": 0.10},
    "coloured noise": {"coloured": 0.1},
    "AC coupling": {"highpass_hz": 5.0},
    "velocity": {"sensor": 1},
    "acceleration": {"sensor": 2},
    "2 kHz": {"rate": 2000, "sensor": 1},
    "48 kHz": {"rate": 48000},
    "16 bits, 1 % clipped": {"bits": 16, "clipped": 0.01},
    "delay": {"delay_s": 0.237},
    "clock": {"delay_s": 0.05, "clock_ppm": 100.0},
    "second mode": {"second": 0.3},
    "all at once": {
        "hum": 0.02, "drift": 0.05, "coloured": 0.03, "highpass_hz": 5.0, "sensor": 1, "delay_s": 0.05,
        "clock_ppm": 100.0, "second": 0.2, "bits": 16, "clipped": 0.002,
    },
}  # fmt: skip
"""Disturbances by name, as arguments of `recorded`."""

TWO_COILS = """
name = "t"
resolution = 4
band_hz = [42, 126]
q_min = 15
delta_y = 5
resonances_hz = [60, 90]
pad = { width_mm = 50, depth_mm = 25 }
coil = { grid = [1, 2], outer_diameter_mm = 24, inner_diameter_mm = 10, core_diameter_mm = 10 }
"""
"""Spec of two coils of two channels, at 60 and 90 Hz."""


class Recording(NamedTuple):
    """Sampling rate, the excitation's current (None for a free decay) and the sensor's signal, both relative."""

    rate: int
    reference: np.ndarray | None
    motion: np.ndarray

    def wav(self) -> bytes:
        """Return a WAV of both, 32-bit floats."""
        columns = [self.motion] if self.reference is None else [self.reference, self.motion]
        out = io.BytesIO()
        wavfile.write(out, self.rate, np.stack([c / np.abs(c).max() for c in columns], 1).astype(np.float32))
        return out.getvalue()


def modal(force, hz, q, sensor, rate=INNER_HZ):
    """Return displacement, velocity or acceleration (`sensor` 0, 1, 2) of a mode at rest before the force."""
    omega = 2 * np.pi * hz
    a = [[0.0, 1.0], [-(omega**2), -omega / q]]
    b = [[0.0], [omega**2]]
    c = [[[1.0, 0.0]], [[0.0, 1 / omega]], [[-1.0, -1 / (omega * q)]]][sensor]
    ad, bd, cd, dd, _ = cont2discrete((np.array(a), np.array(b), np.array(c), [[float(sensor == 2)]]), 1 / rate, "foh")
    den = np.poly(ad)
    num = np.poly(ad - bd @ cd) + (dd[0, 0] - 1) * den
    return lfilter(num, den, force)


def chirp(seconds, low, high, silence=1.0):
    """Return the current of a sweep of the force, even in octaves, after and before silence."""
    time = np.arange(int(seconds * INNER_HZ)) / INNER_HZ
    growth = np.log(high / low) / seconds
    current = np.sin(np.pi * low / growth * np.expm1(growth * time))
    current *= np.clip(time / 0.1, 0, 1) * np.clip((seconds - time) / 0.02, 0, 1)
    pause = np.zeros(int(silence * INNER_HZ))
    return np.concatenate([pause, current, pause])


def noise(rng, seconds, low, high, silence=1.0):
    """Return the root of a constant and noise in a band."""
    count = int(seconds * INNER_HZ)
    frequency = np.fft.rfftfreq(count, 1 / INNER_HZ)
    lines = np.where((frequency > low) & (frequency < high), rng.standard_normal((2, len(frequency))), 0)
    swing = np.fft.irfft(lines[0] + 1j * lines[1], count)
    time = np.arange(count) / INNER_HZ
    fade = np.clip(time / 0.1, 0, 1) * np.clip((seconds - time) / 0.1, 0, 1)
    pause = np.zeros(int(silence * INNER_HZ))
    return np.concatenate([pause, np.sqrt((swing / np.abs(swing.min()) + 1) * fade), pause])


def recorded(
    rng,
    hz=(60.0,),
    q=(15.0,),
    size=(1.0,),
    excitation="chirp",
    seconds=8.0,
    band=(20.0, 400.0),
    rate=8000,
    sensor=0,
    white=0.01,
    hum=0.0,
    mains=50.0,
    drift=0.0,
    coloured=0.0,
    highpass_hz=0.0,
    bits=0,
    clipped=0.0,
    delay_s=0.0,
    clock_ppm=0.0,
    second=0.0,
    polarity=None,
    taps=1,
):
    """Return a recording of modes `hz`, `q`, `size`; disturbances are shares of the motion's peak."""
    if excitation.startswith("pluck"):
        tap = np.sin(np.pi * np.arange(16) / 16)
        rings = np.concatenate([tap, np.zeros(int(seconds * INNER_HZ))])
        hard = [1.0, *rng.uniform(0.6, 1.0, taps - 1)]
        force = np.concatenate([np.zeros(INNER_HZ // 2), *(each * rings for each in hard)])
        current = None
    else:
        current = chirp(seconds, *band) if excitation == "chirp" else noise(rng, seconds, *band)
        force = current**2
    modes = [*zip(hz, q, size, strict=True)] + ([(3.3 * hz[0], 1.5 * q[0], second)] if second else [])
    moved = sum(s * modal(force, f, k, sensor) for f, k, s in modes)
    inner = np.arange(len(moved)) / INNER_HZ
    time = np.arange(int(inner[-1] * rate)) / rate
    motion = CubicSpline(inner, moved)(np.clip((1 + clock_ppm * 1e-6) * time - delay_s, 0, inner[-1]))
    motion *= (rng.choice([-1, 1]) if polarity is None else polarity) / np.abs(motion).max()
    way = rng.choice(3)
    slow = 2 * time / time[-1] - 1
    motion *= 1 + drift / 2 * (slow if way == 0 else -slow if way == 1 else np.cos(np.pi * slow))
    motion += white * rng.standard_normal(len(time))
    if hum:
        own = mains * (1 + 1e-3 * rng.uniform(-1, 1))
        for k, share in ((1, 1.0), (2, 0.3), (3, 0.5), (5, 0.3), (7, 0.2)):
            motion += hum * share * np.cos(2 * np.pi * (k * own * time + rng.uniform()))
    if coloured:
        lines = rng.standard_normal((2, len(time) // 2 + 1)) / np.sqrt(
            np.maximum(np.fft.rfftfreq(len(time), 1 / rate), 1)
        )
        red = np.fft.irfft(lines[0] + 1j * lines[1], len(time))
        motion += coloured * red / red.std()
    reference = None if current is None else CubicSpline(inner, current)(time)
    if highpass_hz:
        b, a = butter(1, highpass_hz, "high", fs=rate)
        motion = lfilter(b, a, motion)
        reference = None if reference is None else lfilter(b, a, reference)
    if clipped:
        top = np.quantile(np.abs(motion), 1 - clipped)
        motion = np.clip(motion / top, -1, 1)
    if bits:
        motion = np.clip(
            np.round(motion / np.abs(motion).max() * 2 ** (bits - 1)) / 2 ** (bits - 1), -1, 1 - 2.0 ** (1 - bits)
        )
    return Recording(rate, reference, motion * 1.0)
