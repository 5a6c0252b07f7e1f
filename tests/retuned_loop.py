"""A print that is recorded, re-tuned and driven, by recordings and an integration that share no code with padgen.

The bytes of the WAV are voltages; coils and taxels are integrated exactly for signals that are straight between
samples. Lines are heard for two seconds, each taxel's working mode alone.
"""

from dataclasses import astuple, replace

import numpy as np
from scipy.io import wavfile
from scipy.signal import cont2discrete, lfilter

import padgen as pg
from padgen.measured.tuning import levels_um, planned_response_um_per_a2
from padgen.planner.printed_pads import Spreads, coils_of, design_of, drawn_prints, spreads_of
from tests.recordings import modal, recorded

HEARD_S = 2.0
RING_TAUS = 8.0
"""Time constants of the slowest taxel from a state's beginning until it is heard."""


def spreads_for(plan, sigma):
    """Return the plan's spreads, scaled by one factor so that ln f of its taxels has a root mean square of `sigma`."""
    spreads = spreads_of(plan.spec)
    drawn = drawn_prints(design_of(plan, None), spreads, 0, 0, 2048).log_x[2]
    scale = sigma / float(np.sqrt((drawn**2).mean()))
    return Spreads(*(value * scale for value in astuple(spreads)))


def record(plan, truth, coils, folder, rng, **how):
    """Write a recording of each taxel of `coils`, named after it; `how` is of `recorded`."""
    hz = [taxel.resonance_hz for taxel in truth.taxels]
    how = {"band": (min(hz) / 3, 3 * max(hz)), "rate": max(2000, round(8 * max(hz))), **how}
    for taxel, place in zip(truth.taxels, plan.taxels, strict=True):
        if place.coil in coils:
            made = recorded(rng, (taxel.resonance_hz,), (taxel.q,), **how)
            (folder / f"{taxel.id}.wav").write_bytes(made.wav())


def by_truth(plan, truth):
    """Return the tuning of who knows f and Q of the print `truth`, and takes the pull for the plan's."""
    taxels = []
    for taxel, place in zip(truth.taxels, plan.taxels, strict=True):
        channel = plan.channels[place.channel]
        response = planned_response_um_per_a2(channel, taxel.resonance_hz, taxel.q)
        taxels.append(replace(taxel, response_um_per_a2=response))
    return replace(truth, taxels=tuple(taxels))


def kept_db(plan, tuning, truth, coils, folder, rate_hz=8000):
    """Return for each of `coils` the smallest ON over the largest OFF level in dB, in all states, on the print `truth`.

    Levels are over those that the plan wants at the taxels' true resonances.
    """
    index = coils_of(plan)
    count = max(len(index[place]) for place in coils)
    states = np.zeros((2**count, len(plan.taxels)))
    for place in coils:
        states[:, index[place]] = (np.arange(2**count)[:, None] >> np.arange(len(index[place]))) & 1
    ring_s = RING_TAUS * max(t.q / (np.pi * t.resonance_hz) for t in truth.taxels)
    seconds = ring_s + HEARD_S
    path = folder / "drive.wav"
    pg.drive(plan, frames=states, seconds=seconds, tuning=tuning, rate_hz=rate_hz).save(path)
    rate, played = wavfile.read(path)
    coil = plan.spec.coil
    num, den, _ = cont2discrete(([1.0], [coil.inductance_mh * 1e-3, coil.resistance_ohm]), 1 / rate, "foh")
    window = np.hanning(int(HEARD_S * rate))
    wanted = levels_um(plan, np.array([t.resonance_hz for t in truth.taxels]))
    kept = []
    for place in coils:
        force = lfilter(num.ravel(), den, played[:, sorted(index).index(place)].astype(float)) ** 2
        on = []
        off = []
        for taxel in index[place]:
            own = truth.taxels[taxel]
            moved = modal(force, own.resonance_hz, own.q, 0, rate) * own.response_um_per_a2 / own.q / wanted[taxel]
            for k, state in enumerate(states):
                stop = int((k + 1) * seconds * rate)
                held = moved[stop - len(window) : stop]
                held = held - np.average(held, weights=window)
                (on if state[taxel] else off).append(np.average(held**2, weights=window))
        kept.append(10 * np.log10(min(on) / max(off)))
    return kept
