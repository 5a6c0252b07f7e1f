"""Cures of findings: changes of the spec. Each is tried by planning the changed spec before it is suggested."""

from collections.abc import Callable
from dataclasses import asdict, replace
from math import inf
from typing import Any

from padgen.core.errors import PadgenError, cured
from padgen.core.finding import LEVELS
from padgen.planner.plan import Plan
from padgen.spec import Spec, make_spec
from padgen.spec.load import CARRIED_HEADROOM, catalogue, laid_over, spread_of, without_none

__all__ = ["Cure", "varied", "with_tried_cures"]

MOST_TRIED = 4
"""Most cures that are tried for one plan."""
LOST_DB = 0.05
"""Loss of the asked selectivity in dB that a cure may cause."""
COUNTED = ("model.", "ladder.", "selectivity.", "coil.leak", "modes.")
"""Kinds of findings about the models, or about a loss of selectivity, which is counted in dB anyway."""

Cure = dict[str, Any]
"""New values of fields of the spec, by the fields' dotted names; None removes a field from the spec."""


def varied(spec: Spec, cure: Cure) -> Spec:
    """Return `spec` with the fields of `cure` as if they were written in its file; raises as `make_spec` does."""
    table = without_none(asdict(spec))
    if "printer" in cure and table["spread"] == catalogue("spread").get(spread_of(spec.printer)):
        del table["spread"]  # the file leaves it to the printer
    own = spec.amplifier
    if own and any(name.startswith("amplifier") for name in cure):
        # What the file leaves to the amplifier is left to the other one.
        for name, value in (("voltage_limit_v", own.voltage_v), ("headroom", CARRIED_HEADROOM)):
            if table["drive"][name] == value:
                del table["drive"][name]
    return make_spec(without_none(laid_over(table, cure)))


def with_tried_cures(plan: Plan, planned: Callable[[Cure], Plan]) -> Plan:
    """Return `plan` with the cures of its findings that hold, each finding's first one, and no others.

    `planned` makes the plan of the spec with a cure. A cure holds where no finding of that kind is left and there are
    no more errors; where there are fewer kinds of findings, or no more of those that are not `COUNTED`; and where as
    much is kept of the selectivity that is asked.
    """
    proposed: dict[str, list[Cure]] = {}
    for finding in plan.findings:
        proposed.setdefault(finding.code, []).extend(finding.cures)
    before, known, holds = _severities(plan), list[tuple[Cure, Plan | None]](), dict[str, list[Cure]]()
    for code, cures in proposed.items():
        for cure in cures:
            if cure not in (tried for tried, _ in known) and len(known) < MOST_TRIED:
                known.append((cure, _planned(planned, cure)))
            again = next((made for tried, made in known if tried == cure), None)
            if again and _is_better(plan, before, again, code):
                holds[code] = [cure]
                break
    findings = (
        replace(f, message=cured(f.message, holds.get(f.code, ())), cures=tuple(holds.get(f.code, ())))
        for f in plan.findings
    )
    return replace(plan, findings=tuple(findings))


def _planned(planned: Callable[[Cure], Plan], cure: Cure) -> Plan | None:
    try:
        return planned(cure)
    except PadgenError:
        return None


def _severities(plan: Plan) -> dict[str, int]:
    """Return the severity (index in `LEVELS`) of the worst finding of each code, notes left out."""
    worst: dict[str, int] = {}
    for f in plan.findings:
        if f.level != "note":
            worst[f.code] = max(worst.get(f.code, 0), LEVELS.index(f.level))
    return worst


def _is_better(plan: Plan, before: dict[str, int], again: Plan, code: str) -> bool:
    after = _severities(again)
    kept = [inf if p.selectivity.kept_db is None else p.selectivity.kept_db for p in (plan, again)]
    errors, others = [], []
    for severities in (after, before):
        errors.append(list(severities.values()).count(LEVELS.index("error")))
        others.append(sum(not code.startswith(COUNTED) for code in severities))
    return (
        code not in after
        and errors[0] <= errors[1]
        and (len(after) < len(before) or others[0] <= others[1])
        and kept[1] >= min(kept[0], plan.selectivity.asked_db) - LOST_DB
    )
