"""Computes the channels per coil that print, for docs/yield.md and docs/capacity.svg: part of `make pictures`."""

import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from padgen.core.display import COLOURS, plot_bytes, plot_style
from padgen.physics.ladder import LevelLaw
from padgen.physics.schemes import in_order
from padgen.physics.selectivity import Scheme
from padgen.planner.search import largest_counts, printed_count
from tests.planner.test_yield import BAND_HZ, COILS, good_share

PAGE = Path(__file__).with_name("yield.md")
BEGIN = "<!-- made by docs/draw_capacity.py -->\n"
END = "<!-- end -->\n"
SHARE, LAW, PADS = 0.9, LevelLaw(1), 400
QS = (10, 15, 30, 60)
ASKED_DB = (14, 20)
SPREADS = (0.0, 0.01, 0.02, 0.04, 0.08)
MOST = 40
"""Channels up to which random cases are judged."""
DRAWN = [k * 0.0025 for k in range(41)]


def closed(q: float, asked_db: float, name: str, spread: float) -> int:
    """Channels by the closed form; `spread` is of the ratio of two neighbours."""
    return printed_count(BAND_HZ, q, LAW, Scheme(name), asked_db, SHARE, COILS, spread / 2**0.5)


def simulated(q: float, asked_db: float, name: str, spread: float, near: int) -> int:
    """Channels by Monte-Carlo, looked for from three above `near` downwards."""
    most, _ = largest_counts(BAND_HZ, q, LAW, Scheme(name), asked_db)
    asked = q, LAW, Scheme(name), 10 ** (asked_db / 10), spread / 2**0.5, "retuned", PADS
    return next((n for n in range(min(near + 3, most), 1, -1) if good_share(n, *asked) >= SHARE), 1)


def table() -> list[str]:
    lines = [
        f"| Q | asked dB | drive | {' | '.join(f'± {spread:.0%}' for spread in SPREADS)} |",
        "|---|---|---|" + "---|" * len(SPREADS),
    ]
    for q in QS:
        for asked_db in ASKED_DB:
            for name in in_order():
                cells = []
                for spread in SPREADS:
                    found = closed(q, asked_db, name, spread)
                    other = simulated(q, asked_db, name, spread, found) if spread else found
                    cells.append(f"{found}" + (f" ({other})" if other != found else ""))
                lines.append(f"| {q} | {asked_db} | {name} | {' | '.join(cells)} |")
    return lines


def random_cases(cases: int = 150) -> Counter:
    """How often the closed form is how many channels off the Monte-Carlo, biased (True) and otherwise."""
    off = Counter[tuple[bool, int]]()
    rng = np.random.default_rng(5)
    for k in range(cases):
        name = in_order()[k % 4]
        tuned = rng.random() < 0.7
        q = rng.uniform(8, 80)
        asked_db = rng.uniform(12, 24)
        law = LevelLaw(rng.choice([0, 0.5, 1, 2]))
        band_hz = (20.0, float(20 * np.exp(rng.uniform(1, 4))))
        coils = int(rng.choice([1, 4, 16, 64]))
        spreads = (rng.uniform(0.003, 0.06), 0.0) if tuned else (0.0, rng.uniform(0.001, 0.024))
        asked = band_hz, q, law, Scheme(name), asked_db
        found, (most, _) = printed_count(*asked, SHARE, coils, *spreads), largest_counts(*asked)
        if most > MOST:
            continue
        judged = q, law, Scheme(name), 10 ** (asked_db / 10), max(spreads), "retuned" if tuned else "some", PADS
        tried = range(min(found + 4, most), 1, -1)
        other = next((n for n in tried if good_share(n, *judged, band_hz, coils) >= SHARE), 1)
        off[name == "biased", found - other] += 1
    return off


def picture() -> bytes:
    from matplotlib.figure import Figure

    with plot_style():
        figure = Figure(figsize=(9, 3.8), layout="constrained")
        axes = figure.subplots(1, 2, sharey=True)
        for axis, asked_db in zip(axes, ASKED_DB, strict=True):
            for q in QS:
                for name, style in (("spur-free", "-"), ("time-shared", ":")):
                    counts = [closed(q, asked_db, name, spread) for spread in DRAWN]
                    percent = [100 * spread for spread in DRAWN]
                    label = f"Q = {q}" if style == "-" else None
                    axis.plot(percent, counts, style, color=COLOURS[QS.index(q)], drawstyle="steps-mid", label=label)
                for spread in SPREADS[1:]:
                    found = simulated(q, asked_db, "spur-free", spread, closed(q, asked_db, "spur-free", spread))
                    axis.plot([100 * spread], [found], "o", color=COLOURS[QS.index(q)], markersize=4)
            axis.set(xlabel="spread of a ratio of neighbours, %", title=f"{asked_db} dB", yscale="log", ylim=(4, 64))
            axis.set_yticks([4, 8, 16, 32, 64], ["4", "8", "16", "32", "64"])
            axis.minorticks_off()
            axis.grid(alpha=0.25)
        axes[0].set_ylabel("channels per coil")
        axes[1].legend()
        return plot_bytes(figure, "svg")


def main() -> None:
    PAGE.with_name("capacity.svg").write_bytes(picture())
    lines = "\n".join(table())
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    PAGE.write_text(f"{before}{BEGIN}{lines}\n{END}{rest.split(END)[1]}", encoding="utf-8")
    print("random cases by (biased, channels off the Monte-Carlo):", sorted(random_cases().items()))


if __name__ == "__main__":
    main()
