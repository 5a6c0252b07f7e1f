"""Make the verdict on a plan: whether the pad does its job, in the sentences that every output begins with.

All that decides is in the plan: its errors (limits of coils, amplifier, gap and beams among them), its frame rate, what
its prints keep of the asked selectivity, and what a finger does to that.
"""

from dataclasses import replace

from padgen.core.errors import Finding, Verdict, as_lines, quieter
from padgen.planner.plan import Plan

__all__ = ["NOT_JUDGED", "judged"]

NOT_JUDGED = Verdict("error", "not judged yet", "", "", "", None)
"""The placeholder in a plan that is not `judged` yet."""
CAUSES = ("selectivity.all_states", "coil.leak", "print.share")
"""Codes of findings that say why prints keep too little, the deepest cause first."""


def judged(plan: Plan, findings: tuple[Finding, ...]) -> Plan:
    """Return `plan` with these findings, errors first, and with the verdict that follows from them and its figures."""
    known = replace(plan, findings=findings)
    errors = [finding for finding in findings if finding.level == "error"]
    verdict = _not_working(known, errors) if errors else _working(known)
    return replace(known, verdict=verdict)


def _not_working(plan: Plan, errors: list[Finding]) -> Verdict:
    first = errors[0]
    more = "" if len(errors) == 1 else f" (the first of {len(errors)} errors)"
    sentence = f"{plan.name} does not work{more}: {first.where}: {first.message}."
    return Verdict("error", sentence, "", first.code, _cure_of(first), None)


def _working(plan: Plan) -> Verdict:
    prints = plan.prints
    asked_db = plan.selectivity.asked_db
    touched = _touched_sentence(plan)
    slow = next((finding for finding in plan.findings if finding.code == "drive.slow"), None)
    short = f"{plan.name} falls short of what is asked, even untouched"
    if prints.print_db is None or prints.planned_db is None:
        if slow:
            return Verdict("short", f"{short}: {slow.message}.", touched, slow.code, _cure_of(slow), None)
        return Verdict("good", f"{plan.name} works untouched: no taxel hears another.", touched, "", "", None)
    share = f"in {plan.spec.print_share:.0%} of prints ON taxels"
    asked = f"(asked: {asked_db:.1f} dB)"
    if slow:
        kept = f"{share} vibrate {_kept(prints.print_db)} than OFF ones {asked}"
        sentence = f"{short}: {slow.message}. Measured and re-tuned, {kept}."
        return Verdict("short", sentence, touched, slow.code, _cure_of(slow), prints.print_db)
    if prints.planned_db >= asked_db:
        sentence = (
            f"{plan.name} works untouched, as printed: driven by the plan's table, {share} vibrate"
            f" {_kept(prints.planned_db)} than OFF ones {asked}."
        )
        return Verdict("good", sentence, touched, "", "", prints.planned_db)
    kept = f"{share} then vibrate {_kept(prints.print_db)} than OFF ones {asked}."
    if prints.good_share >= plan.spec.print_share:
        sentence = f"{plan.name} works untouched, once every taxel is measured and re-tuned: {kept}"
        return Verdict("retune", sentence, touched, "print.spread", "", prints.print_db)
    sentence = f"{short}, measured and re-tuned: {kept}"
    causes = [finding for finding in plan.findings if finding.code in CAUSES]
    cause = min(causes, key=lambda finding: CAUSES.index(finding.code))
    return Verdict("short", sentence, touched, cause.code, _cure_of(cause), prints.print_db)


def _kept(db: float) -> str:
    return f"at {'least' if db > 0 else 'most'} {quieter(-db)}"


def _cure_of(finding: Finding | None) -> str:
    return as_lines(finding.cures[0]) if finding and finding.cures else ""


def _touched_sentence(plan: Plan) -> str:
    """Say what a finger on every taxel of a coil does, by typical skin and without print errors."""
    typical = next((touched for touched in plan.touched if touched.skin == "typical"), None)
    if typical is None:
        return ""
    moved = (
        f"channel 0 then resonates at {typical.resonance_hz[0]:.0f} Hz instead of"
        f" {plan.channels[0].resonance_hz:.0f} Hz, with a Q of {typical.q[0]:.2g}"
    )
    resting = next((push for push in plan.pushed.pushes if push.skin == "typical"), None)
    if resting and any(resting.contact):
        count = f"{sum(resting.contact)} of {len(plan.channels)} channels"
        moved += f"; skin at the height of the frame pushes the washers of {count} onto the coil"
    skin = "with typical skin (a provisional model, no print errors)"
    kept_db = typical.all_states_db
    if kept_db is None:
        return f"Under a finger, {skin}, {moved}."
    heard = f"{skin} OFF taxels vibrate {quieter(kept_db)} than ON ones; {moved}."
    if kept_db >= plan.selectivity.asked_db:
        return f"Under a finger it works, too: {heard}"
    if kept_db > 0:
        return f"Under a finger it keeps less: {heard}"
    return f"Under a finger it does not choose its taxels: {heard}"
