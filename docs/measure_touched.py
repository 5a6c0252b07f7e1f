"""Print the table of docs/contactor.md on measured skin: fingers of a generator of its own, recorded and fitted.

python docs/measure_touched.py [SKINS]    so many skins (10) under each of four pins of the template skin-probe

A skin is drawn between low and high of the survey (E*, a0, τ), its k, c and m under the pin follow from that survey's
formulas, written anew here. Each of the four taxels, of a mass that is off the plan's by 2 % (one sigma of the print),
is swept untouched (once) and under each finger, the skin differing by 3 % from taxel to taxel; recordings have 16 bits,
hum of 2 % and noise of 1 % (`tests/recordings.py`, which shares no code with padgen).
"""

import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.io import wavfile

sys.path.insert(0, str(Path(__file__).parents[1]))
import padgen as pg
from padgen.core.errors import PadgenError
from padgen.measured.fits import fitted
from padgen.measured.read import read_measured
from padgen.measured.touched_skin import fit_finger
from tests.recordings import recorded

DIAMETERS_MM = (0.5, 1.0, 1.5, 2.5)
SPREAD = ((30e3, 80e3, 250e3), (0.1e-3, 0.3e-3, 0.4e-3), (0.4e-3, 0.7e-3, 1.5e-3))
PLACES = 0.03
MASSES = 0.02
GUARD = 1.27
SECONDS = 2.5
RATE = 3000
SEED = 20261126


class Skin(NamedTuple):
    """Stiffness in N/m, mass in kg, and the modulus in Pa, width in m and time in s that damping goes with."""

    k: float
    m: float
    modulus: float
    wide: float
    time: float

    def c(self, hz: float) -> float:
        """Return damping in N s/m: the skin's own loss, and waves that leave the contact."""
        shear = self.modulus / 4 * abs(1 + 2j * np.pi * hz * self.time)
        return float(self.time * self.k + 6.8 * self.wide**2 * np.sqrt(1100 * shear))


def skin_drawn(rng: np.random.Generator, diameter_mm: float) -> Skin:
    """Return the skin of one person under a pin in a hole of twice its size."""
    drawn = []
    for low, middle, high in SPREAD:
        z = float(np.clip(rng.standard_normal(), -1.6, 1.6))
        drawn.append(middle * float(np.exp(z * (np.log(high / middle) if z > 0 else np.log(middle / low)) / 1.645)))
    modulus, layer, time = drawn
    wide = diameter_mm / 2e3 + layer
    return Skin(2 * modulus * wide * GUARD, 4 / 3 * 1100 * wide**3, modulus, wide, time)


def touched_mode(channel: Any, skin: Skin, mass_share: float, place: float) -> tuple[float, float]:
    """Return the resonance in Hz and Q of a taxel under skin that is `place` times as stiff as the person's."""
    mass = channel.effective_mass_g * 1e-3 * mass_share
    omega0 = 2 * np.pi * channel.resonance_hz
    stiffness = mass * omega0**2
    n2 = channel.pin.lever**2 + 2 / 3 * channel.pin.sway**2
    k = stiffness + n2 * place * skin.k
    m = mass + n2 * skin.m
    hz = float(np.sqrt(k / m) / (2 * np.pi))
    c = mass * omega0 / channel.q + n2 * place * skin.c(hz)
    return hz, float(np.sqrt(k * m) / c)


def fits_of(plan: Any, modes: dict[str, tuple[float, float]], rng: np.random.Generator) -> Any:
    """Record a sweep of each taxel, of resonance in Hz and Q by name, and return what padgen fits."""
    with tempfile.TemporaryDirectory() as folder:
        for name, (hz, q) in modes.items():
            wave = recorded(
                rng, hz=(hz,), q=(q,), seconds=SECONDS, band=(40.0, 800.0), rate=RATE, white=0.01, hum=0.02, bits=16
            )
            columns = np.stack([wave.reference / np.abs(wave.reference).max(), wave.motion / np.abs(wave.motion).max()])
            wavfile.write(Path(folder) / f"{name}.wav", wave.rate, np.round(32767 * columns.T).astype(np.int16))
        return fitted(read_measured(Path(folder), plan, sensor="displacement"), plan)[0]


def errors_of(diameter_mm: float, skins: int) -> np.ndarray:
    """Return (n, 4): relative errors of k and c, and how many sigmas each is off.

    All fingers press one print, whose untouched taxels are measured once.
    """
    changed: dict[str, Any] = {"contactor.diameter_mm": diameter_mm}
    plan = pg.plan("skin-probe", **changed)
    channels = {taxel.id: plan.channels[taxel.channel] for taxel in plan.taxels}
    rng = np.random.default_rng((SEED, round(1000 * diameter_mm)))
    bare = fits_of(plan, {name: (c.resonance_hz, c.q) for name, c in channels.items()}, rng)
    rows = []
    for number in range(skins):
        skin = skin_drawn(rng, diameter_mm)
        # One print for each finger, so that its mass is off by chance.
        share = 1 + MASSES * rng.standard_normal()
        places = {name: float(np.exp(PLACES * rng.standard_normal())) for name in channels}
        pressed = {name: touched_mode(c, skin, share, places[name]) for name, c in channels.items()}
        try:
            finger = fit_finger(plan, bare, fits_of(plan, pressed, rng))
        except PadgenError as error:
            print(diameter_mm, number, error, file=sys.stderr)
            continue
        mean = float(np.mean(list(places.values())))
        off_k = finger.k_n_per_m - skin.k * mean
        true_c = float(np.mean([places[name] * skin.c(pressed[name][0]) for name in channels]))
        off_c = finger.c_n_s_per_m - true_c
        off = (off_k / skin.k / mean, off_c / true_c)
        rows.append((*off, off_k / finger.k_error_n_per_m, off_c / finger.c_error_n_s_per_m))
    return np.array(rows)


def main() -> None:
    skins = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    print("| pin mm | fingers fitted | k: median, largest error % | c: median, largest % | within 1.96 sigma: k, c |")
    print("|---|---|---|---|---|")
    every = []
    for diameter in DIAMETERS_MM:
        rows = errors_of(diameter, skins)
        every.append(rows)
        k, c = 100 * np.abs(rows[:, :2]).T
        inside = (np.abs(rows[:, 2:]) < 1.96).mean(0)
        print(
            f"| {diameter} | {len(rows)} of {skins} | {np.median(k):.1f}, {k.max():.1f} | {np.median(c):.1f},"
            f" {c.max():.1f} | {inside[0]:.0%}, {inside[1]:.0%} |",
            flush=True,
        )
    whole = np.concatenate(every)
    print(
        f"all: within 10 %: {(np.abs(whole[:, :2]) < 0.1).mean():.0%}; within 1.96 sigma:"
        f" {(np.abs(whole[:, 2:]) < 1.96).mean():.1%} of {2 * len(whole)}"
    )


if __name__ == "__main__":
    main()
