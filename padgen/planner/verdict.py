"""Make the verdict on a plan: whether the pad does its job, in the sentences that every output begins with.

All that decides is in the plan: its errors (limits of coils, amplifier, gap and beams among them), its frame rate, what
its prints keep of the asked selectivity, and what recoil and a finger do to that. Where the spec does not say how the
pad is held, the verdict is on one that is held still, and says so if recoil would change it.
"""

from dataclasses import replace
from math import inf

from padgen.core.errors import Finding, Verdict, about, as_lines, less_or_more_text, number
from padgen.planner.plan import Plan, Touch

__all__ = ["based_pad_db", "left_by_recoil_db", "moving_pad_db", "recoil_db", "with_verdict", "works_by_table"]

CAUSES = ("selectivity.all_states", "coil.leak", "print.share")
"""Codes of findings that say why prints keep too little, the deepest cause first."""


def moving_pad_db(plan: Plan) -> float | None:
    """Return the dB of ON over OFF that the asked share of prints, re-tuned only if needed, keeps as the pad recoils.

    It is infinite where nothing is heard, and None where prints keep less than is asked even on a pad that does not
    move.
    """
    return left_by_recoil_db(plan, recoil_db(plan))


def based_pad_db(plan: Plan) -> float | None:
    """Return the dB that the asked share of prints keeps with recoil, the pad fixed to a plate of `Recoil.base_g`."""
    return left_by_recoil_db(plan, plan.recoil.based_db)


def left_by_recoil_db(plan: Plan, moving_db: float | None) -> float | None:
    """Return the dB that prints keep with recoil, given `moving_db`, the dB of an error-free print that recoils.

    It is None where prints keep too little even on a pad held still.
    """
    prints = plan.prints
    held_db: float | None = inf
    if prints.print_db is not None:
        works = prints.good_share >= plan.spec.print_share
        retuned_db = prints.print_db if works else None
        held_db = prints.planned_db if works_by_table(plan) else retuned_db
    return None if held_db is None else plan.recoil.kept_db(held_db, moving_db)


def recoil_db(plan: Plan) -> float | None:
    """Return ON over OFF in dB of an error-free pad that recoils: by the driver table if it suffices, else re-tuned."""
    return plan.recoil.in_step_db if works_by_table(plan) else plan.recoil.apart_db


def works_by_table(plan: Plan) -> bool:
    """Return whether prints keep what is asked with the driver table, so that no taxel need be re-tuned."""
    planned_db = plan.prints.planned_db
    return planned_db is None or planned_db >= plan.selectivity.asked_db


def with_verdict(plan: Plan, findings: tuple[Finding, ...]) -> Plan:
    """Return `plan` with `findings` and the verdict that follows: from the first error if any, else the figures."""
    known = replace(plan, findings=findings)
    errors = [finding for finding in findings if finding.level == "error"]
    if errors:
        verdict = _not_working(known, errors)
    elif plan.touch is not None:
        verdict = _under_touch(known, plan.touch)
    else:
        verdict = _working(known)
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
    shakes = next((finding for finding in plan.findings if finding.code == "pad.recoil"), None)
    short = f"{plan.name} falls short of what is asked, even untouched"
    shaken = _shaken_sentence(plan)
    works = _works_untouched(plan, bool(shaken))
    left_db = moving_pad_db(plan) if plan.spec.mount.is_said else None
    if shakes and not slow:
        return Verdict("short", f"{short}: {shakes.message}.", touched, shakes.code, _cure_of(shakes), left_db)
    if prints.print_db is None or prints.planned_db is None:
        heard_db = left_db if left_db is not None and left_db < inf else None
        if slow:
            return Verdict("short", f"{short}: {slow.message}.", touched, slow.code, _cure_of(slow), heard_db)
        sentence = f"{works}: no taxel hears another."
        if heard_db is not None:
            sentence = (
                f"{works}: ON taxels vibrate {_compared_text(heard_db)} OFF ones, which only hear the pad recoil."
            )
        return Verdict("good", sentence, touched, "", "", heard_db, shaken)
    share = f"in {plan.spec.print_share:.0%} of prints ON taxels"
    asked = f"(asked: {asked_db:.1f} dB)"
    print_db = prints.print_db if left_db is None else left_db
    if slow:
        kept = f"{share} vibrate {_compared_text(print_db)} OFF ones {asked}"
        sentence = f"{short}: {slow.message}. Measured and re-tuned, {kept}."
        return Verdict("short", sentence, touched, slow.code, _cure_of(slow), print_db)
    if prints.planned_db >= asked_db:
        planned_db = prints.planned_db if left_db is None else left_db
        kept = f"{share} vibrate {_compared_text(planned_db)} OFF ones {asked}."
        sentence = f"{works}, as printed: driven by the plan's table, {kept}"
        return Verdict("good", sentence, touched, "", "", planned_db, shaken)
    kept = f"{share} then vibrate {_compared_text(print_db)} OFF ones {asked}."
    if prints.good_share >= plan.spec.print_share:
        sentence = f"{works}, once every taxel is measured and re-tuned: {kept}"
        return Verdict("retune", sentence, touched, "print.spread", "", print_db, shaken)
    sentence = f"{short}, measured and re-tuned: {kept}"
    causes = [finding for finding in plan.findings if finding.code in CAUSES]
    cause = min(causes, key=lambda finding: CAUSES.index(finding.code))
    return Verdict("short", sentence, touched, cause.code, _cure_of(cause), print_db)


def _works_untouched(plan: Plan, only_held: bool) -> str:
    """Return a phrase: the pad works untouched, only untouched, or only held still; or it is too faint to be felt."""
    typical = next((touched.all_states_db for touched in plan.touched if touched.skin == "typical"), None)
    only = typical is not None and typical < plan.selectivity.asked_db
    untouched = "only untouched" if only else "untouched"
    if only_held:
        untouched += f"{' and' if only else ''} on a base that holds it still"
    felt_db = plan.felt.on_db
    silent = [k for k, db in enumerate(felt_db) if db < 0]
    if not silent:
        return f"{plan.name} works {untouched}"
    below = f"{-max(felt_db[k] for k in silent):.1f}"
    if len(silent) > 1:
        below += f" to {-min(felt_db[k] for k in silent):.1f}"
    where = ""
    if len(silent) < len(felt_db):
        where = f" on {len(silent)} of {len(felt_db)} channels"
    error_db = max(plan.felt.error_db[k] for k in silent)
    return (
        f"{plan.name} is probably not felt{where} ({below} dB too faint for a fingertip, ± {error_db:.0f} dB) and"
        f" chooses its taxels {untouched}"
    )


def _under_touch(plan: Plan, touch: Touch) -> Verdict:
    """Return the verdict on a pad that is planned under a contact and has no error."""
    hand = "its own contact" if touch.contact == "own" else f"a {touch.contact}"
    asked_db = plan.selectivity.asked_db
    short = f"{plan.name} falls short of what is asked under {hand}"
    untouched = " ".join(filter(None, (_touched_sentence(plan), _untouched_sentence(plan))))
    slow = next((finding for finding in plan.findings if finding.code == "drive.slow"), None)
    if slow:
        return Verdict("short", f"{short}: {slow.message}.", untouched, slow.code, _cure_of(slow), touch.print_db)
    if touch.print_db is None:
        return Verdict("good", f"{plan.name} works under {hand}: no taxel hears another.", untouched, "", "", None)
    share = f"in {plan.spec.print_share:.0%} of {plan.spec.touch.prints_text} ON taxels"
    asked = f"(asked: {asked_db:.1f} dB)"
    shaken = ""
    works = f"{plan.name} works under {hand}"
    if touch.loose_db is not None and touch.loose_db < asked_db:
        works += " on a base that holds it still"
        shaken = (
            f"Lying loose, the pad of {about(plan.recoil.pad_g)} g recoils from its ON taxels and keeps"
            f" {touch.loose_db:.1f} dB under {hand}; fasten it to what does not move."
        )
    if touch.planned_db is not None and touch.planned_db >= asked_db:
        sentence = f"{works}, as printed: {share} vibrate {_compared_text(touch.planned_db)} OFF ones {asked}."
        return Verdict("good", sentence, untouched, "", "", touch.planned_db, shaken)
    kept = f"{share} then vibrate {_compared_text(touch.print_db)} OFF ones {asked}."
    if touch.good_share >= plan.spec.print_share:
        sentence = f"{works}, once every taxel is measured and re-tuned: {kept}"
        return Verdict("retune", sentence, untouched, "touch.spread", "", touch.print_db, shaken)
    cause = next(finding for finding in plan.findings if finding.code == "touch.share")
    sentence = f"{short}, measured and re-tuned: {kept}"
    return Verdict("short", sentence, untouched, cause.code, _cure_of(cause), touch.print_db)


def _untouched_sentence(plan: Plan) -> str:
    """Say what prints of a pad that is planned under a contact keep where nothing touches them."""
    prints = plan.prints
    if prints.print_db is None:
        return ""
    kept = f"ON taxels vibrate {_compared_text(prints.print_db)} OFF ones"
    return (
        f"Untouched, with tones at the untouched resonances, in {plan.spec.print_share:.0%} of re-tuned prints {kept}."
    )


def _shaken_sentence(plan: Plan) -> str:
    """Return a sentence on the dB of a loose pad; empty if they suffice, or if the spec says how it is held."""
    recoil = plan.recoil
    left_db = moving_pad_db(plan)
    based_db = based_pad_db(plan)
    if plan.spec.mount.is_said or left_db is None or left_db >= plan.selectivity.asked_db:
        return ""
    held = "fasten it to what does not move"
    if recoil.base_g is not None and based_db is not None:
        held = f"fastened to a steel plate of {number(recoil.base_g)} g, {based_db:.1f} dB"
    loose = f"the pad of {about(recoil.pad_g)} g recoils from its ON taxels and keeps {left_db:.1f} dB"
    return f"Lying loose, {loose}; {held}."


def _compared_text(db: float) -> str:
    """Return in words how ON taxels compare with OFF ones at `db` of selectivity: 'at least 20.7 dB more than'."""
    if abs(db) < SILENT_DB:
        return "at least as much as"
    return f"at {'least' if db > 0 else 'most'} {less_or_more_text(-db)} than"


SILENT_DB = 0.05
"""Difference below which levels are written as the same."""


def _contact_text(touch: Touch) -> str:
    """Return a phrase that names what lies on the taxels and what is provisional or neglected in its model."""
    if touch.contact == "own":
        return "its own contact (no print errors)"
    return f"a {touch.contact} (typical skin, a provisional model; no print errors)"


def _cure_of(finding: Finding | None) -> str:
    return as_lines(finding.cures[0]) if finding and finding.cures else ""


def _touched_sentence(plan: Plan) -> str:
    """Return a sentence on selectivity and resonance with typical skin on every taxel, without print errors."""
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
        moved += f"; a finger that lies on the frame presses the {plan.spec.mover.kind}s of {count} onto the coil"
    skin = "with typical skin (a provisional model, no print errors)"
    kept_db = typical.all_states_db
    if kept_db is None:
        return f"Under a finger, {skin}, {moved}."
    heard = f"OFF taxels vibrate {less_or_more_text(kept_db)} than ON ones; {moved}."
    if plan.touch is not None and kept_db > 0:
        return f"With {_contact_text(plan.touch)} on every taxel, {heard}"
    heard = f"{skin} {heard}"
    if kept_db >= plan.selectivity.asked_db:
        return f"Under a finger it works, too: {heard}"
    if kept_db > 0:
        return f"Under a finger it keeps less: {heard}"
    return f"Under a finger it does not choose its taxels: {heard}"
