"""Hold every model to what it states in extreme cases, as docs/accuracy.md tells: `python docs/measure_extremes.py`.

Prints a line for each case; names of domains after the command choose among them. Each answer and each reference is
computed in a process of its own, since engines may crash; all take some minutes to a quarter of an hour.
"""

import sys
from collections import Counter
from math import isfinite, nan
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from padgen.core.runner import Runner
from tests.extremes import SETS, CaseSet, answer_of

LIMIT_S = 300.0


def verdict(runner: Runner, cases: CaseSet, place: int) -> tuple[str, str]:
    """Return 'right', 'refused', 'WRONG' (worse than stated, no number, no end) or 'unchecked', and the figures."""
    answer = runner.run(answer_of, cases, place, "solve", time_s=LIMIT_S)
    if answer.kind != "value":
        return "refused" if answer.kind == "refused" else "WRONG", answer.sentence
    truth = runner.run(answer_of, cases, place, "reference", time_s=LIMIT_S)
    if truth.kind != "value":
        return "unchecked", truth.sentence
    return judged_error(
        relative_error(answer.value.values, truth.value.values),
        *(float(solved.stated_error) for solved in (answer.value, truth.value)),
    )


def relative_error(values: np.ndarray, reference: np.ndarray) -> float:
    """Return the largest difference over the largest entry of `reference`; nan for a shape or number that is none."""
    if values.shape != reference.shape or not np.isfinite(reference).all() or not np.isfinite(values).all():
        return nan
    difference, scale = float(np.abs(values - reference).max(initial=0.0)), float(np.abs(reference).max(initial=0.0))
    return difference / scale if scale else difference


def judged_error(error: float, stated: float, allowed: float = 0.0) -> tuple[str, str]:
    """Return the verdict on an error beside the stated one (plus `allowed`, the reference's), and the figures."""
    right = isfinite(stated) and error <= stated + allowed  # nan is not
    return "right" if right else "WRONG", f"off by {error:.2g}, states {stated:.2g}"


def main(domains: list[str]) -> int:
    """Judge all cases of some domains, or of all; the exit code is 1 where one is wrong."""
    counts = Counter[tuple[str, str]]()
    for cases in SETS:
        for place, case in enumerate(cases()):
            if domains and case.domain not in domains:
                continue
            with Runner() as runner:
                found, figures = verdict(runner, cases, place)
            counts[case.domain, found] += 1
            print(f"{found:9}  {case.domain}, {case.model}: {case.name}: {figures} ({case.source})", flush=True)
    for (domain, found), count in counts.items():
        print(f"{domain}: {count} {found}")
    return int(any(found == "WRONG" for _, found in counts))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
