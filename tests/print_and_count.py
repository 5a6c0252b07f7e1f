"""A second opinion on how many prints work, from plan.json and print_spread.md alone, without any code of padgen.

`python -m tests.print_and_count out/NAME/plan.json [low|typical|high]` prints the share of simulated pads, re-tuned
taxel by taxel, that keep 14 dB, 20 dB and what was asked, with and without leakage from the coils around.

Each taxel's resonance is that of a mass on a straight beam whose ends give way as half a thickness of it, and its pull
goes with a power of its gap; its answer is the sum over all modes that the plan lists, rolling ones too.
Only straight beams are counted, and no channels that take turns.
"""

import json
import re
import sys
from itertools import combinations
from pathlib import Path

import numpy as np

SPREAD = Path(__file__).parent / "reference" / "print_spread.md"
LEVELS = ("low", "typical", "high")
ROWS = {
    "common_z": "common z, mm",
    "common_e": "common E, % (one dry spool)",
    "field": "field of z, bed meshed before the print, mm",
    "t": "taxel's own thickness, mm",
    "w": "taxel's own width, mm",
    "l": "taxel's own length, mm",
    "ratio": "stiffness across beads over along",
    "common_ratio": "common spread of that ratio, %",
    "own_ratio": "taxel's own spread of that ratio, %",
    "common_gap": "common gap, mm",
    "own_gap": "taxel's own gap, mm",
    "common_glue": "common glue, mg",
    "own_glue": "taxel's own glue, mg",
}
PERCENT = ("common_e", "common_ratio", "own_ratio")
CORRELATION_MM = {"fdm": 50.0, "resin": 75.0}


def terms_of(printer: str, level: str | None) -> dict[str, float]:
    """Return the terms of the table's column for a printer of the catalogue; without a `level` none."""
    if level is None:
        return dict.fromkeys(ROWS, 0.0) | {"ratio": 1.0}
    column = 3 if printer.startswith("resin") else 2
    k = LEVELS.index(level)
    table = {
        cells[0].strip(): cells
        for line in SPREAD.read_text().splitlines()
        if len(cells := line.strip("|").split("|")) == 5
    }
    found = {}
    for name, label in ROWS.items():
        text = table[label][column]
        if own := re.search(rf"{printer[-4:].lstrip('-')}: ([^;]*)", text):
            text = own[1]
        found[name] = float(text.replace("*", "").split("/")[k])
    return found | {name: found[name] / 100 for name in PERCENT}


ACROSS = 0.6 * 5 / 8
"""Power of the ratio by which beads make ends softer: of a half-plane, by the share of them that is laid across."""


def stiffness(plan: dict, beam: dict, dw=0.0, dt=0.0, dl=0.0, ratio=1.0) -> np.ndarray:
    """Return the stiffness of a straight beam on elastic ends at the washer, over E/12, in mm; sizes off by dw, dt, dl.

    Under a force at the washer, a beyond a beam of length l, the beam gives l³/3 + l²a + la² over EI; its root, which
    turns as half a thickness of beam does, gives t/2 (l + a)², its tip t/2 a².
    """
    assert beam["topology"] == "cantilever", "twist of bent beams is not counted here"
    length = beam["length_mm"] + dl
    thickness = beam["thickness_mm"] + dt
    arm = plan["plate"]["length_mm"] / 2
    bent = length**3 / 3 + length**2 * arm + length * arm**2
    ends = thickness / 2 * ((length + arm) ** 2 + arm**2) * ratio**-ACROSS
    return (beam["width_mm"] + dw) * thickness**3 / (bent + ends)


def per_mm(plan: dict, channel: dict) -> float:
    """Return by how much of itself f falls for each mm that the washer lies farther out on the plate.

    Its mass then moves by the slope of the beam's end more, as l²/2 + la over l³/3 + l²a + la².
    """
    length = channel["beam"]["length_mm"]
    arm = plan["plate"]["length_mm"] / 2
    slope = (length**2 / 2 + length * arm) / (length**3 / 3 + length**2 * arm + length * arm**2)
    washer = plan["spec"]["washer"]
    area = np.pi / 4 * (washer["outer_diameter_mm"] ** 2 - washer["inner_diameter_mm"] ** 2)
    mass = area * washer["thickness_mm"] * washer["density_g_per_cm3"] / 1e3
    return mass / channel["effective_mass_g"] * slope


def kept_db(
    plan: dict,
    level: str | None = "typical",
    pads: int = 2000,
    leak: bool = True,
    seed: int = 0,
    for_life: bool = False,
) -> np.ndarray:
    """Return ON over OFF in dB of each pad's worst coil and state (pads,), each taxel driven at its own resonance.

    With `for_life` each taxel has a Q of its own, and the pad has aged and is warmer or colder, whichever is worse.
    """
    spec = plan["spec"]
    channels = plan["channels"]
    taxels = plan["taxels"]
    assert plan["selectivity"]["drive"] != "time-shared" and spec["drive"]["threshold_hz"] is None
    terms = terms_of(spec["printer"]["name"], level)
    rng = np.random.default_rng(seed)
    place = np.array([[t["x_mm"], t["y_mm"]] for t in taxels])
    far = np.linalg.norm(place[:, None] - place, axis=-1) / CORRELATION_MM[spec["printer"]["process"]]
    field = np.linalg.cholesky(np.exp(-(far**2)) + 1e-9 * np.eye(len(taxels))) @ rng.standard_normal(
        (len(taxels), pads)
    )
    common_z, common_e, common_ratio, common_gap, common_glue = rng.standard_normal((5, pads))
    own = rng.standard_normal((7, len(taxels), pads))
    log_f = np.empty((len(taxels), pads))
    log_pull = np.empty((len(taxels), pads))
    # In every print the ratio is below 1; a calibration takes its mean effect for the modulus's.
    every = [
        0.5 * np.log(stiffness(plan, c["beam"], ratio=terms["ratio"]) / stiffness(plan, c["beam"])) for c in channels
    ]
    for i, taxel in enumerate(taxels):
        channel = channels[taxel["channel"]]
        beam = channel["beam"]
        height = terms["common_z"] * common_z + terms["field"] * field[i] + terms["t"] * own[0, i]
        ratio = np.exp(terms["common_ratio"] * common_ratio + terms["own_ratio"] * own[5, i])
        stiff = stiffness(plan, beam, terms["w"] * own[1, i], height, terms["l"] * own[2, i], ratio)
        log_f[i] = 0.5 * terms["common_e"] * common_e + 0.5 * np.log(stiff / stiffness(plan, beam))
        log_f[i] += every[channel["index"]] - np.mean(every)
        glue = terms["common_glue"] * common_glue + terms["own_glue"] * own[3, i]
        log_f[i] -= 0.5 * glue / (1e3 * channel["effective_mass_g"])
        log_f[i] -= per_mm(plan, channel) * (spec["taxel"]["washer_clearance_mm"] / 4 if level else 0.0) * own[4, i]
        wider = terms["common_gap"] * common_gap + terms["own_gap"] * own[6, i]
        gap = spec["coil"]["gap_mm"] - channel["sag_um"] / 1e3
        log_f[i] += channel["pull_shift"] * (channel["pull_exponent"] + 1) * wider / gap
        log_pull[i] = -channel["pull_exponent"] * wider / gap
    worst = np.full(pads, np.inf)
    q_ratio = np.ones((len(taxels), pads))
    shifts = [np.ones(pads)]
    if for_life:
        life = spec["life"]
        q_ratio = np.exp(life["common_q"] * rng.standard_normal(pads) + life["q"] * rng.standard_normal(q_ratio.shape))
        aged = np.exp(life["ageing"] * rng.standard_normal(pads))
        per_k = spec["material"]["softening_per_k"] / 2
        shifts = [aged * (1 - per_k * k) for k in (life["temperature_range_k"], -life["temperature_range_k"])]
    for coil in {tuple(t["coil"]) for t in taxels}:
        index = [i for i, t in enumerate(taxels) if tuple(t["coil"]) == coil]
        x, pulled = (np.exp(part[index]) for part in (log_f, log_pull))
        for shift in shifts:
            kept = coil_db(plan, [taxels[i] for i in index], x, pulled, leak, q_ratio[index], shift)
            worst = np.minimum(worst, kept)
    return worst


def coil_db(
    plan: dict,
    taxels: list[dict],
    x: np.ndarray,
    pulled: np.ndarray,
    leak: bool,
    q_ratio: np.ndarray,
    shift: np.ndarray,
) -> np.ndarray:
    """Return ON over OFF in dB (pads,) of a coil whose resonances moved by `shift` after its tones were set."""
    channels = [plan["channels"][t["channel"]] for t in taxels]
    law = plan["spec"]["drive"]["level_law"]
    tone = np.array([c["resonance_hz"] for c in channels])[:, None] * x

    boss = plan["spec"]["taxel"]["boss_diameter_mm"] / 2e3

    def answer(i: int, hz: np.ndarray, moved_to: np.ndarray | float) -> np.ndarray:
        """Return the size of what is felt of taxel i at `hz` per line of i², all modes scaled with the print.

        Its resonance is then `moved_to` times that at re-tuning.

        It is the root mean square over the boss: of a mode's motion up and of half a radius times its tilts. The force
        constant has the working mode's share of the pull already. Modes that only roll have no motion up, and are
        pulled by side force and moment.
        """
        c = channels[i]
        working = int(np.argmax(c["mode_shares"]))
        motions = np.array(c["mode_motions"])
        moved = motions @ c["pull_wrench"] / np.array(c["modes_hz"]) ** 2
        felt = motions[:, 2:5] * [1.0, boss / 2, boss / 2] * moved[:, None] / (motions[working, 2] * moved[working])
        total = np.zeros((3, *hz.shape), complex)
        for mode_hz, part in zip(c["modes_hz"], felt, strict=True):
            s = hz / (mode_hz * x[i] * moved_to)
            total += part[:, None] / (1 - s**2 + 1j * s / (c["q"] * q_ratio[i]))
        size = np.sqrt((np.abs(total) ** 2).sum(0))
        return size * pulled[i] * c["force_constant_n_per_a2"] / (c["stiffness_n_per_m"] * (x[i] * moved_to) ** 2)

    # Levels in m, so that lines are in A².
    level = channels[0]["level_um"] * 1e-6 * (tone / channels[0]["resonance_hz"]) ** -law
    rho = max(c["remanent_ma"] for c in channels) / 1e3
    line = [level[j] / answer(j, tone[j], 1.0) for j in range(len(channels))]
    # All lines of the squared current with their makers: its products are written out by hand.
    many = len(channels)
    made = [({j}, tone[j], line[j]) for j in range(many)]
    drive = plan["selectivity"]["drive"]
    if drive == "biased":
        bias = np.sqrt(plan["spec"]["drive"]["bias_ratio"] * np.max(line, axis=0) / 2)
        current = [each / (2 * bias) for each in line]
        played = tone
        made += [({j}, 2 * tone[j], current[j] ** 2 / 2) for j in range(many)]
    if drive == "tones":
        current = [np.sqrt(2 * each) for each in line]
        played = tone / 2
        # Steel that has kept some magnetisation pulls with i² + ρ i.
        made += [({j}, played[j], rho * current[j]) for j in range(many)]
    for a, b in combinations(range(many), 2) if drive != "spur-free" else ():
        made += [({a, b}, hz, current[a] * current[b]) for hz in (played[a] + played[b], abs(played[a] - played[b]))]
    off = []
    for i in range(many):
        heard = sum((size * answer(i, hz, shift)) ** 2 for makers, hz, size in made if i not in makers)
        around = plan["reuse"]["retuned_leaks_db"][channels[i]["index"]] if leak else None
        off.append(heard / level[i] ** 2 + (0.0 if around is None else 10 ** (-around / 10)))
    on = [(line[j] * answer(j, tone[j], shift) / level[j]) ** 2 for j in range(many)]
    return 10 * np.log10(np.min(on, axis=0) / np.maximum(np.max(off, axis=0), 1e-30))


if __name__ == "__main__":
    data = json.loads(Path(sys.argv[1]).read_text())
    for which in sys.argv[2:] or ["typical"]:
        for name, leaks in (("with leakage", True), ("within the coil", False)):
            found = kept_db(data, which, 5000, leaks)
            asked = data["selectivity"]["asked_db"]
            shares = ", ".join(f"{need:.4g} dB {np.mean(found >= need):.1%}" for need in (14, 20, asked))
            print(f"{which}, {name}: {shares} of pads; nine in ten keep {np.quantile(found, 0.1):.1f} dB")
