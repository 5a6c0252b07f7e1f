"""A pad that recoils, stepped in time, from plan.json alone: the whole coupled system, nothing of padgen imported.

Unknowns are the pad's six motions about its centre of mass and each taxel's washer against the pad. The equations
``M a + C v + K y = F`` are integrated from rest by the classical Runge-Kutta method of the fourth order until what
began with them has died away. Then sines of the tones are fitted to the last part.

`stepped_wave` takes the coils' voltages from a WAV's bytes: current through R and L, its square, and the same system,
stepped by its matrix exponential for forces that are straight between samples.
"""

import numpy as np
from scipy.io import wavfile
from scipy.signal import cont2discrete, lfilter

ALONG = {"+x": (1, 0), "+y": (0, 1), "-x": (-1, 0), "-y": (0, -1)}
STEPS = 40
"""Steps in a period of the highest frequency: 5e-6 of phase error in each."""
DIED = 14.0
"""Time constants of the slowest taxel before the levels are taken: e^-14 is 1e-6."""
FIT_S = 0.25


def matrices(plan):
    """Return mass, damping and stiffness (6 + n, 6 + n) of a plan (the dict of its JSON), and each taxel's channel."""
    recoil = plan["recoil"]
    taxels = plan["taxels"]
    channels = plan["channels"]
    count = len(taxels)
    centre = np.array(recoil["centre_mm"]) * 1e-3
    mass, damping, stiffness = np.zeros((3, 6 + count, 6 + count))
    mass[:3, :3] = recoil["moving_g"] * 1e-3 * np.eye(3)
    mass[3:6, 3:6] = np.array(recoil["moments_g_mm2"]) * 1e-9
    for i, taxel in enumerate(taxels):
        channel = channels[taxel["channel"]]
        cosine, sine = ALONG[channel["site"]["along"]]
        around = -1 if taxel["turned"] else 1
        turn = np.array([[around * cosine, -around * sine, 0], [around * sine, around * cosine, 0], [0, 0, 1]])
        force = turn @ recoil["momenta_g"][taxel["channel"]] * 1e-3
        place = np.array([taxel["x_mm"] * 1e-3, taxel["y_mm"] * 1e-3, 0.0]) - centre
        moment = turn @ recoil["momenta_g_mm"][taxel["channel"]] * 1e-6 + np.cross(place, force)
        mass[:3, 6 + i] = mass[6 + i, :3] = force
        mass[3:6, 6 + i] = mass[6 + i, 3:6] = moment
        own = channel["effective_mass_g"] * 1e-3
        omega = 2 * np.pi * channel["resonance_hz"]
        mass[6 + i, 6 + i] = own
        damping[6 + i, 6 + i] = own * omega / channel["q"]
        stiffness[6 + i, 6 + i] = own * omega**2
    mount = plan["spec"].get("mount", {})
    if mount.get("stiffness_n_per_m"):
        spring, lossy = layer(plan, mount, np.diag(mass)[:6], centre)
        stiffness[range(6), range(6)] = spring
        damping[range(6), range(6)] = lossy
    return mass, damping, stiffness, np.array([taxel["channel"] for taxel in taxels])


def layer(plan, mount, inertia, centre):
    """Return stiffness and damping (6,) of an even layer at the lowest face of what `recoil.lowest_mm` says."""
    pad = plan["spec"]["pad"]
    wide, deep = ((pad[key] + 2 * pad["border_mm"]) * 1e-3 for key in ("width_mm", "depth_mm"))
    k = mount["stiffness_n_per_m"]
    arm = centre[2] - plan["recoil"]["lowest_mm"] * 1e-3
    # Pressure k/(wide deep) over the area, shear a third of it: integrals of y², x², and of the arm's square.
    tilt = [k * deep**2 / 12 + k / 3 * arm**2, k * wide**2 / 12 + k / 3 * arm**2, k / 3 * (wide**2 + deep**2) / 12]
    spring = np.array([k / 3, k / 3, k, *tilt])
    return spring, np.sqrt(spring * inertia) / (mount.get("q") or 2.0)


def stepped_db(plan, driven):
    """Return the smallest ON over the largest OFF amplitude in dB of an image of signed levels `driven` (n,).

    Each amplitude is over that of the taxel alone on a pad that does not move.
    """
    mass, damping, stiffness, channel_of = matrices(plan)
    channels = plan["channels"]
    count = len(channel_of)
    hz = np.array([channel["resonance_hz"] for channel in channels])
    q = np.array([channel["q"] for channel in channels])
    pull = np.array([channel["force_constant_n_per_a2"] for channel in channels])
    line = np.array([channel["line_a2"] for channel in channels])
    force = np.zeros((len(channels), 6 + count))
    for c in range(len(channels)):
        for i, taxel in enumerate(plan["taxels"]):
            playing = [
                driven[j] * line[c]
                for j, other in enumerate(plan["taxels"])
                if other["coil"] == taxel["coil"] and other["channel"] == c
            ]
            force[c, 6 + i] = pull[channel_of[i]] * sum(playing)
    rates = np.linalg.solve(mass, np.concatenate([-stiffness, -damping], 1))
    push = np.linalg.solve(mass, force.T)
    step = 1 / hz.max() / STEPS
    last = round(FIT_S / step)
    total = round(DIED * (q / np.pi / hz).max() / step) + last
    size = 6 + count
    y = np.zeros(2 * size)
    kept = np.zeros((last, count))
    omega = 2 * np.pi * hz

    def slope(state, at):
        return np.concatenate([state[size:], rates @ state + push @ np.cos(omega * at)])

    for k in range(total):
        at = k * step
        one = slope(y, at)
        two = slope(y + step / 2 * one, at + step / 2)
        three = slope(y + step / 2 * two, at + step / 2)
        four = slope(y + step * three, at + step)
        y = y + step / 6 * (one + 2 * two + 2 * three + four)
        if k >= total - last:
            kept[k - total + last] = y[6:size]
    times = (np.arange(total - last, total) + 1) * step
    waves = np.concatenate([np.cos(np.outer(times, omega)), np.sin(np.outer(times, omega)), np.ones((last, 1))], 1)
    fitted = np.linalg.lstsq(waves, kept, rcond=None)[0]
    amplitude = np.hypot(fitted[: len(hz)], fitted[len(hz) : 2 * len(hz)])
    spring = np.diag(stiffness)[6:]
    unit = pull[channel_of] * line[channel_of] * q[channel_of] / spring
    shares = amplitude / unit
    on = driven != 0
    own = shares[channel_of, np.arange(count)] / np.where(on, np.abs(driven), 1.0)
    shares[channel_of[on], np.flatnonzero(on)] = 0.0
    heard = np.sqrt((shares**2).sum(0))
    return 20 * np.log10(own[on].min() / heard[~on].max())


def stepped_wave(plan, path, full_scale_v):
    """Return the rate of a WAV in Hz and the taxels' motions (n, samples) against the pad, from rest, while it plays.

    Each motion is over the amplitude that the taxel's own line alone gives it on a pad that does not move.
    """
    rate, played = wavfile.read(path)
    volts = played.astype(float) / 2.0**31 * full_scale_v
    coil = plan["spec"]["coil"]
    circuit = cont2discrete(([1.0], [coil.get("inductance_mh", 0.0) * 1e-3, coil["resistance_ohm"]]), 1 / rate, "foh")
    current = lfilter(circuit[0].ravel(), circuit[1], volts, axis=0)
    mass, damping, stiffness, channel_of = matrices(plan)
    size = len(mass)
    q, pull, line = (
        np.array([channel[key] for channel in plan["channels"]])[channel_of]
        for key in ("q", "force_constant_n_per_a2", "line_a2")
    )
    push = np.zeros((size, volts.shape[1]))
    for i, taxel in enumerate(plan["taxels"]):
        push[6 + i, taxel["coil"][0] * plan["coils"]["columns"] + taxel["coil"][1]] = pull[i]
    rates = np.zeros((2 * size, 2 * size))
    rates[:size, size:] = np.eye(size)
    rates[size:] = np.linalg.solve(mass, np.concatenate([-stiffness, -damping], 1))
    enters = np.concatenate([np.zeros(push.shape), np.linalg.solve(mass, push)])
    reads = np.zeros((len(channel_of), 2 * size))
    reads[range(len(channel_of)), range(6, size)] = np.diag(stiffness)[6:] / (pull * line * q)
    steps, forces, out, through, _ = cont2discrete((rates, enters, reads, np.zeros(push[6:].shape)), 1 / rate, "foh")
    entering = current**2 @ forces.T
    state = np.zeros(2 * size)
    kept = np.zeros((len(entering), 2 * size))
    for k, force in enumerate(entering):
        kept[k] = state
        state = steps @ state + force
    return rate, out @ kept.T + through @ (current**2).T
