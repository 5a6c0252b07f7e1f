"""A second opinion on how many prints work, from plan.json and print_spread.md alone, without any code of padgen.

`python -m tests.print_and_count out/NAME/plan.json [low|typical|high]` prints the share of simulated pads, re-tuned
taxel by taxel, that keep 14 and 20 dB, with and without leakage from the coils around.

Each taxel's resonance follows the rule f ∝ E^½ w^½ t^{3/2} l^{−3/2} m^{−½}; its answer is the sum over the modes that
the plan lists. Only plans of up to two channels a coil can be counted: their spurs fall on no third channel.
"""

import json
import re
import sys
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
}
CORRELATION_MM = {"fdm": 50.0, "resin": 75.0}
WASHER = 0.01 / 2
"""Relative sigma of f by the washer's place: half of the "about 1 %" at the end of the clearance."""


def terms_of(printer: str, level: str) -> dict[str, float]:
    """Return the terms of the table's column for a printer of the catalogue."""
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
    found["common_e"] /= 100
    return found


def kept_db(plan: dict, level: str = "typical", pads: int = 2000, leak: bool = True, seed: int = 0) -> np.ndarray:
    """Return ON over OFF in dB of each pad's worst coil and state (pads,), each taxel driven at its own resonance."""
    spec = plan["spec"]
    channels = plan["channels"]
    taxels = plan["taxels"]
    assert plan["selectivity"]["drive"] in ("tones", "spur-free") and spec["drive"]["threshold_hz"] is None
    terms = terms_of(spec["printer"]["name"], level)
    rng = np.random.default_rng(seed)
    place = np.array([[t["x_mm"], t["y_mm"]] for t in taxels])
    far = np.linalg.norm(place[:, None] - place, axis=-1) / CORRELATION_MM[spec["printer"]["process"]]
    field = np.linalg.cholesky(np.exp(-(far**2)) + 1e-9 * np.eye(len(taxels))) @ rng.standard_normal(
        (len(taxels), pads)
    )
    common_z, common_e = rng.standard_normal((2, pads))
    own = rng.standard_normal((5, len(taxels), pads))
    log_f = np.empty((len(taxels), pads))
    for i, taxel in enumerate(taxels):
        beam = channels[taxel["channel"]]["beam"]
        mass = channels[taxel["channel"]]["effective_mass_g"]
        height = terms["common_z"] * common_z + terms["field"] * field[i] + terms["t"] * own[0, i]
        log_f[i] = 0.5 * terms["common_e"] * common_e + 1.5 * height / beam["thickness_mm"]
        log_f[i] += 0.5 * terms["w"] * own[1, i] / beam["width_mm"] - 1.5 * terms["l"] * own[2, i] / beam["length_mm"]
        log_f[i] -= 0.5 * spec["taxel"]["glue_spread_mg"] * own[3, i] / (1e3 * mass)
        log_f[i] += WASHER * own[4, i]
    worst = np.full(pads, np.inf)
    for coil in {tuple(t["coil"]) for t in taxels}:
        index = [i for i, t in enumerate(taxels) if tuple(t["coil"]) == coil]
        assert len(index) <= 2, "spurs of three channels are not counted here"
        worst = np.minimum(worst, coil_db(plan, [taxels[i] for i in index], np.exp(log_f[index]), leak))
    return worst


def coil_db(plan: dict, taxels: list[dict], x: np.ndarray, leak: bool) -> np.ndarray:
    channels = [plan["channels"][t["channel"]] for t in taxels]
    law = plan["spec"]["drive"]["level_law"]
    tone = np.array([c["resonance_hz"] for c in channels])[:, None] * x

    def answer(i: int, hz: np.ndarray) -> np.ndarray:
        """Return the complex motion of taxel i at `hz` per line of i², all modes scaled with the print."""
        c = channels[i]
        total = np.zeros(hz.shape, complex)
        for mode_hz, share in zip(c["modes_hz"], c["pulled_shares"], strict=True):
            s = hz / (mode_hz * x[i])
            total += share / (1 - s**2 + 1j * s / c["q"])
        return total * c["force_constant_n_per_a2"] / (c["stiffness_n_per_m"] * x[i] ** 2)

    level = tone**-law
    line = [level[j] / np.abs(answer(j, tone[j])) for j in range(len(channels))]
    off = []
    for i in range(len(channels)):
        heard = sum((line[j] * np.abs(answer(i, tone[j]))) ** 2 for j in range(len(channels)) if j != i)
        around = plan["reuse"]["retuned_leaks_db"][channels[i]["index"]] if leak else None
        off.append(heard / level[i] ** 2 + (0.0 if around is None else 10 ** (-around / 10)))
    return -10 * np.log10(np.maximum(np.max(off, axis=0), 1e-30))


if __name__ == "__main__":
    data = json.loads(Path(sys.argv[1]).read_text())
    for which in sys.argv[2:] or ["typical"]:
        for name, leaks in (("with leakage", True), ("within the coil", False)):
            found = kept_db(data, which, 5000, leaks)
            shares = ", ".join(f"{need} dB {np.mean(found >= need):.1%}" for need in (14, 20))
            print(f"{which}, {name}: {shares} of pads; nine in ten keep {np.quantile(found, 0.1):.1f} dB")
