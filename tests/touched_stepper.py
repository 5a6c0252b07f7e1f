"""A touched coil, stepped in time and drawn by chance from plan.json alone: nothing of padgen imported.

`stepped` integrates ``m x'' + c x' + k x = F cos ωt`` of every taxel under every tone of its coil, by the classical
Runge-Kutta method of the fourth order, with a finger that comes, presses and goes: stiffness, damping and mass of its
skin rise and fall over some periods. Amplitudes are those of sines fitted while it rests on the taxel. `kept_shares`
draws persons, places and prints with a generator of its own and takes amplitudes from complex dynamic stiffness.
"""

import numpy as np

SKINS = {
    "fingertip": ((30e3, 80e3, 250e3), (0.1e-3, 0.3e-3, 0.4e-3), (0.4e-3, 0.7e-3, 1.5e-3)),
    "palm": ((30e3, 60e3, 150e3), (0.1e-3, 0.3e-3, 0.4e-3), (0.4e-3, 0.7e-3, 1.5e-3)),
}
"""E* in Pa, a0 in m and τ in s of low, typical and high skin."""
STEPS = 30
"""Steps in a period of the highest tone."""


def skin(radius, omega, modulus, layer, time):
    """Return stiffness, damping and mass of free skin under a flat disc."""
    wide = radius + layer
    stiffness = 2 * modulus * wide
    waves = 6.8 * wide**2 * np.sqrt(1100 * modulus / 4 * np.abs(1 + 1j * omega * time))
    return stiffness, time * stiffness + waves, 4 / 3 * 1100 * wide**3


def bare(plan, one):
    """Return k, c and m of the bare taxels of one coil's channels."""
    channels = [plan["channels"][k] for k in one]
    k = np.array([c["stiffness_n_per_m"] for c in channels])
    m = np.array([c["effective_mass_g"] for c in channels]) * 1e-3
    q = np.array([c["q"] for c in channels])
    return k, np.sqrt(k * m) / q, m


def forces(plan, one):
    """Return the force (taxel, tone) of every tone of a coil on every taxel over it, from the currents' lines."""
    touch = plan["touch"]
    pull = np.array([plan["channels"][k]["force_constant_n_per_a2"] for k in one])
    force = np.array([touch["force_mn"][k] for k in one]) * 1e-3
    return pull[:, None] / pull * force


def planned_level(plan, one):
    """Return the levels in m that the tones are to give, with what the plan has in hand."""
    touch = plan["touch"]
    tone_hz = np.array(touch["tone_hz"])
    assert plan["spec"]["drive"]["level_law"] == 1.0
    level_um = plan["spec"]["drive"]["level_um"] * tone_hz[0] / tone_hz * 10 ** (touch["in_hand_db"] / 20)
    return level_um[list(one)] * 1e-6


def stepped(plan, one):
    """Return amplitudes in m (taxel, tone) of a coil's taxels while typical skin rests on them, and after."""
    touch = plan["touch"]
    tone = 2 * np.pi * np.array([touch["tone_hz"][k] for k in one])
    k, c, m = (part[:, None] for part in bare(plan, one))
    force = forces(plan, one)
    modulus, layer, time = (row[1] for row in SKINS[touch["contact"]])
    ks, cs, ms = skin(touch["contactor_mm"] * 0.5e-3, tone, modulus, layer, time)
    n = np.array([touch["lever"][j] for j in one])[:, None] ** 2
    slowest = float((2 * m / c).max())
    rise = 0.02
    rests = rise + 6 * slowest
    leaves = rests + 0.05
    gone = leaves + rise + 6 * slowest
    step = 2 * np.pi / tone.max() / STEPS

    def pressing(t):
        """Return how much of the skin is on the taxel: a smooth step up and down."""
        up = np.clip(t / rise, 0, 1)
        down = np.clip((t - leaves) / rise, 0, 1)
        return up * up * (3 - 2 * up) * (1 - down * down * (3 - 2 * down))

    def slope(t, x, v):
        on = pressing(t) * n
        return v, (force * np.cos(tone * t) - (c + on * cs) * v - (k + on * ks) * x) / (m + on * ms)

    x = np.zeros(force.shape)
    v = np.zeros(force.shape)
    times = np.arange(int((gone + 0.05) / step)) * step
    kept = np.empty((len(times), *force.shape))
    for i, t in enumerate(times):
        kept[i] = x
        x1, v1 = slope(t, x, v)
        x2, v2 = slope(t + step / 2, x + step / 2 * x1, v + step / 2 * v1)
        x3, v3 = slope(t + step / 2, x + step / 2 * x2, v + step / 2 * v2)
        x4, v4 = slope(t + step, x + step * x3, v + step * v3)
        x = x + step / 6 * (x1 + 2 * x2 + 2 * x3 + x4)
        v = v + step / 6 * (v1 + 2 * v2 + 2 * v3 + v4)
    return _fitted(times, kept, tone, rests, leaves), _fitted(times, kept, tone, gone, np.inf)


def _fitted(times, kept, tone, first, last):
    part = (times >= first) & (times < last)
    amplitude = np.empty(kept.shape[1:])
    for j, omega in enumerate(tone):
        base = np.stack([np.cos(omega * times[part]), np.sin(omega * times[part])], -1)
        found = np.linalg.lstsq(base, kept[part][:, :, j], rcond=None)[0]
        amplitude[:, j] = np.hypot(*found)
    return amplitude


def leaks(plan, one):
    """Return the energy by which re-tuned coils around shake an OFF taxel, over that of its ON state."""
    leaks_db = [plan["reuse"]["retuned_leaks_db"][k] for k in one]
    return np.array([0.0 if db is None else 10 ** (-db / 10) for db in leaks_db])


def kept_db(plan, one, amplitude):
    """Return the smallest ON over the largest OFF amplitude in dB in all states, each over its planned level."""
    energy = (amplitude / planned_level(plan, one)[:, None]) ** 2
    on = energy.diagonal()
    off = energy.sum(1) - on + leaks(plan, one) * on
    count = len(on)
    return 10 * np.log10(min(on[j] / off[i] for i in range(count) for j in range(count) if i != j))


def kept_figures(plan, pads, seed, for_life=False):
    """Return the selectivity in dB (pads,) of printed pads under drawn skins, re-tuned, by their worst coils.

    For life, they were re-tuned with the Q that they have, and then became as warm and as cold as the plan's `life` has
    it, aged alike; the worse counts.

    Tones follow the printed resonance of each bare taxel, as far as typical skin has it; skin is a person's, 25 % about
    that from taxel to taxel in each of its figures. Other modes are left out. Also the weakest ON taxel.
    """
    rng = np.random.default_rng(seed)
    touch = plan["touch"]
    spread = plan["spec"]["touch"]["places"]
    rows = SKINS[touch["contact"]]
    radius = touch["contactor_mm"] * 0.5e-3
    coils = {}
    for taxel in plan["taxels"]:
        coils.setdefault(tuple(taxel["coil"]), []).append(taxel["channel"])
    person = [rng.standard_normal(pads) for _ in rows]
    ends = [np.ones(pads)]
    common_q = np.zeros(pads)
    if for_life:
        goes = plan["spec"]["life"]
        aged = np.exp(goes["ageing"] * rng.standard_normal(pads))
        ends = [(1 + shift) * aged for shift in plan["life"]["shifts"]]
        common_q = goes["common_q"] * rng.standard_normal(pads)
    worst = np.full(pads, np.inf)
    weakest = np.full(pads, np.inf)
    for members in coils.values():
        one = sorted(members)
        k, c, m = bare(plan, one)
        n = np.array([touch["lever"][j] for j in one]) ** 2
        printed = np.array([plan["channels"][j]["print_spread"] for j in one])
        x = np.exp(printed[:, None] * rng.standard_normal((len(one), pads)))
        stiff = k[:, None] * x**2
        damp = c[:, None] * x
        if for_life:
            damp = damp / np.exp(common_q + goes["q"] * rng.standard_normal(damp.shape))
        mass = np.broadcast_to(m[:, None], stiff.shape)
        # The tone: where the taxel with typical skin resonates, found by putting it back in.
        tone = 2 * np.pi * np.array([touch["tone_hz"][j] for j in one])[:, None] * np.ones(pads)
        typical = [row[1] for row in rows]
        for _ in range(60):
            ks, cs, ms = skin(radius, tone, *typical)
            tone = np.sqrt((stiff + n[:, None] * ks) / (mass + n[:, None] * ms))
        ks, cs, ms = skin(radius, tone, *typical)
        own = stiff + n[:, None] * ks - tone**2 * (mass + n[:, None] * ms) + 1j * tone * (damp + n[:, None] * cs)
        level = tone[0] / tone
        if plan["spec"]["drive"]["level_law"] != 1.0:
            told = np.array([touch["level_um"][j] for j in one])
            level = told[:, None] / told[0] * np.ones(pads)
        force = level * np.abs(own)
        skins = []
        for _ in one:
            drawn = []
            for (low, middle, high), z in zip(rows, person, strict=True):
                wide = np.where(z > 0, np.log(high / middle), np.log(middle / low)) / 1.6449
                drawn.append(middle * np.exp(z * wide + spread * rng.standard_normal(pads)))
            skins.append(drawn)
        for end in ends:
            energy = np.empty((len(one), len(one), pads))
            for i in range(len(one)):
                now = stiff[i] * end**2
                # Q stays, so that the damper goes with the resonance.
                lost = damp[i] * end
                for j in range(len(one)):
                    ks, cs, ms = (part * n[i] for part in skin(radius, tone[j], *skins[i]))
                    whole = now + ks - tone[j] ** 2 * (mass[i] + ms) + 1j * tone[j] * (lost + cs)
                    energy[i, j] = (force[j] / np.abs(whole) / level[i]) ** 2
            on = np.einsum("iip->ip", energy)
            off = energy.sum(1) - on + leaks(plan, one)[:, None] * on
            for i in range(len(one)):
                for j in range(len(one)):
                    if i != j:
                        worst = np.minimum(worst, on[j] / off[i])
            weakest = np.minimum(weakest, on.min(0))
    return 10 * np.log10(worst), 10 * np.log10(weakest)
