"""The simulated ear: what fingers feel when a WAV file is played on a pad. From the file, not from the plan's drive.

Samples → the coil's current through R and L → the pull by i² on each washer → every taxel's motion, all modes, exact
in time (`current`, `motion`) → what is felt on the boss in every state that is held (`tally`). A file
that loops is heard as it is after many rounds, any other from rest. Left out: the coils beside (see `Plan.reuse`),
the voltage that a moving washer induces, and what an amplifier adds. The converter is taken to pass the band-limited
signal through the samples.

A taxel's levels are compared with what it is to be felt at level 1: the planned motion of its working mode, times
what the plan's modal model lets a finger feel beyond that mode's own vertical motion (other modes, rolling).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from padgen.core.errors import FileError
from padgen.core.units import UM
from padgen.driver.ear.hear import CoilHeard, Played, listen
from padgen.driver.ear.motion import heard_taxels
from padgen.driver.ear.score import SETTLED_TAUS, Score, read_score, score_spans
from padgen.driver.ear.tally import Span
from padgen.measured.predict import levels_um
from padgen.measured.tuning import Tuning, planned_tuning
from padgen.planner.plan import Plan

__all__ = ["CoilHeard", "Heard", "Played", "hear"]


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """What is felt in each span (h,) of the file by taxel (n,), as in the plan.

    `level_um` is all that is felt there (`tally`), `tone_um` what of it is at the taxel's own line, `wanted_um`
    (n,) what is to be felt at level 1, `peak_um` the largest motion of the washer from where it hangs, the mean
    pull's share included, `rise_s` how long switching on takes to nine tenths (NaN: it was not), `settled` whether
    it has had its time before its level is taken. `pulled_in` (n,): drawn onto the coil, with the gap only.
    A state that is held for `needs_s` is heard settled, over a whole period of the comb.
    """

    name: str
    ids: tuple[str, ...]
    coil_of: np.ndarray
    spans: tuple[Span, ...]
    wanted_um: np.ndarray
    level_um: np.ndarray
    tone_um: np.ndarray
    peak_um: np.ndarray
    rise_s: np.ndarray
    settled: np.ndarray
    pulled_in: np.ndarray
    coils: tuple[CoilHeard, ...]
    line_hz: np.ndarray
    period_s: float
    needs_s: float
    with_gap: bool
    asked_db: float

    @property
    def shares(self) -> np.ndarray:
        """Levels (h, n) that are played."""
        return np.array([span.levels for span in self.spans])

    @property
    def relative(self) -> np.ndarray:
        """Felt levels (h, n) over what is wanted at level 1."""
        return np.asarray(self.level_um / self.wanted_um)

    @property
    def on(self) -> np.ndarray:
        """Felt levels (h, n) of the taxels that are ON over what is wanted, NaN else."""
        shares = self.shares
        on: np.ndarray = np.divide(self.relative, shares, out=np.full(shares.shape, np.nan), where=shares > 0)
        return on

    @property
    def off(self) -> np.ndarray:
        """Felt levels (h, n) of the taxels that are OFF over what is wanted at level 1, NaN else."""
        return np.where(self.shares > 0, np.nan, self.relative)

    @property
    def selectivity_db(self) -> float | None:
        """Smallest ON over largest OFF in all spans, each over the taxel's own; None where there is none of either."""
        on, off = self.on, self.off
        if np.isnan(on).all() or np.isnan(off).all():
            return None
        loudest = float(np.nanmax(off))
        return float(20 * np.log10(np.nanmin(on) / loudest)) if loudest > 0 else float("inf")


def hear(
    plan: Plan,
    wave: Played,
    sidecar: Mapping[str, Any],
    tuning: Tuning | None = None,
    gap: bool = False,
    where: str = "drive.wav",
) -> Heard:
    """Listen to `wave` on the pad of `plan`, or on the print that `tuning` tells of.

    `sidecar` is the file's (`padgen.driver.formats.wav.wave_json`), read from JSON. With the `gap` the pull
    grows as it closes, which takes longer: the taxels are stepped in time.

    Raises
    ------
    FileError
        The file is not what the sidecar says, the sidecar not of this plan, or no state is held.
    """
    score = read_score(sidecar, plan, f"sidecar of {where}")
    _refuse(wave, score, where)
    known = tuning or planned_tuning(plan)
    resonance = np.array([taxel.resonance_hz for taxel in known.taxels])
    taxels = heard_taxels(plan, levels_um(plan, resonance), tuning)
    tau_s = np.array([taxel.q for taxel in known.taxels]) / (np.pi * resonance)
    spans = score_spans(score, len(plan.sets[0]), float(tau_s.max()))
    if not spans:
        raise FileError("holds no state long enough to listen to", where)
    found = listen(plan, wave, score, spans, taxels, gap, where)
    return Heard(
        name=plan.name,
        ids=tuple(taxel.id for taxel in plan.taxels),
        coil_of=score.channel,
        spans=spans,
        wanted_um=np.array([taxel.wanted_m for taxel in taxels]) / UM,
        level_um=found.level_m / UM,
        tone_um=found.tone_m / UM,
        peak_um=found.peak_m / UM,
        rise_s=np.where(_switched_on(score, spans), found.rise_s, np.nan),
        settled=_settled(score, spans, tau_s),
        pulled_in=found.pulled_in,
        coils=found.coils,
        line_hz=score.line_hz,
        period_s=score.period_s,
        needs_s=SETTLED_TAUS * float(tau_s.max()) + score.period_s,
        with_gap=gap,
        asked_db=plan.selectivity.asked_db,
    )


def _switched_on(score: Score, spans: tuple[Span, ...]) -> np.ndarray:
    """Taxels (h, n) that are ON and were not in the span before; none at the beginning of a loop."""
    on = np.array([span.levels > 0 for span in spans])
    before = np.concatenate([on[:1] if score.loops else np.zeros_like(on[:1]), on[:-1]])
    return np.asarray(on & ~before)


def _settled(score: Score, spans: tuple[Span, ...], tau_s: np.ndarray) -> np.ndarray:
    """Whether each taxel (h, n) has had its time since its coil was last switched, when its level is taken."""
    settled = np.zeros((len(spans), len(tau_s)), bool)
    # A file that does nothing but hold one state, and loops, has done so for ever.
    since_s = np.full(score.channels, -np.inf if score.loops and len(spans) == 1 else 0.0)
    before = spans[0].levels if score.loops else np.zeros(len(tau_s))
    for k, span in enumerate(spans):
        changed = np.bincount(score.channel, span.levels != before, score.channels) > 0
        since_s = np.where(changed, span.start_s, since_s)
        waited_s = span.window_s - since_s[score.channel]
        settled[k] = span.in_turns | (waited_s >= SETTLED_TAUS * tau_s * (1 - 1e-6))
        before = span.levels
    return settled


def _refuse(wave: Played, score: Score, where: str) -> None:
    """Raise unless the file has the channels, the rate and the length that its sidecar says."""
    if wave.channels != score.channels:
        raise FileError(f"has {wave.channels} channels where {score.channels} are due, one for each coil", where)
    if wave.rate_hz != score.rate_hz:
        raise FileError(f"has {wave.rate_hz} samples per second, its sidecar says {score.rate_hz}", where)
    if wave.count != score.count:
        raise FileError(f"has {wave.count} samples in a channel, its sidecar says {score.count}", where)
