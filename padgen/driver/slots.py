"""Ratio of ON to OFF amplitude in a timeline's frames, averaged over a frame and at its end, in closed form.

Each taxel's amplitude under its own line follows the levels (`padgen.physics.switching`); what it hears of its coil's
other lines and spurs follows them without delay, and adds as energy: blends are slow against beats. With modes where
the pad is as planned. Left out: coils beside, and that a line on the comb is not quite at its resonance.
"""

from typing import NamedTuple

import numpy as np

from padgen.core.errors import Finding, about, at_least
from padgen.driver.waveform import CoilDrive, PadDrive, Timeline, braked_s, taus_s, timeline
from padgen.measured.tuning import Tuning, planned_tuning
from padgen.physics.selectivity import Channels, line_energy, own_lines, pair_lines
from padgen.physics.switching import STEPS, blend, course, follow, overlap
from padgen.planner.channels import coil_modes
from padgen.planner.drive_scheme import LONGEST_S, MOST_WITH_SPURS, SLOT_DB
from padgen.planner.plan import Plan

__all__ = ["FrameContrast", "frame_contrast", "slot_findings", "slots_of", "worst_contrast"]

WHERE = "drive.wav"
LONGER = 1.1
"""Factor by which frames are lengthened until they keep what is asked."""


class FrameContrast(NamedTuple):
    """Least contrast in dB of all frames and coils: a coil's smallest ON divided by its largest OFF amplitude.

    `slot_db` is over the frame's whole slot (root mean square of each), in frame `frame` (from 0) on the coil `coil`;
    `end_db` at the ends of frames (None where channels take turns), before a brake. `frame_s` is a frame's length.
    """

    slot_db: float
    end_db: float | None
    frame: int
    coil: tuple[int, int]
    frame_s: float


def slots_of(time_s: np.ndarray, levels: np.ndarray, frame_s: float, turns: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the frame index (k − 1,) of each interval between keyframes, and the levels (f, taxels) of each frame.

    A frame is what it holds, in turns the most that each taxel has. The stretch that leads into silence is in no frame.
    """
    slot = np.floor((time_s[1:] + time_s[:-1]) / 2 / frame_s + 1e-9).astype(int)
    frames = np.zeros((int(slot.max()) + turns, levels.shape[1]))
    for k in range(len(frames)):
        frames[k] = (
            levels[np.flatnonzero(slot == k) + 1].max(0) if turns else levels[_last_held_keyframe(levels, slot, k)]
        )
    return slot, frames


def _last_held_keyframe(levels: np.ndarray, slot: np.ndarray, frame: int) -> int:
    """Return the index of the keyframe up to which the state of frame number `frame` is held, before any brake."""
    inside = np.flatnonzero(slot == frame)
    held = inside[(levels[inside] == levels[inside + 1]).all(1)]
    return int((held if len(held) else inside)[-1]) + 1


def worst_contrast(levels: np.ndarray, energy: np.ndarray, coil_of: np.ndarray) -> tuple[float, int, int] | None:
    """Return the least ON/OFF ratio within a coil in dB, its frame and coil; None if no coil has ON and OFF taxels.

    `levels` (k, taxels) of frames are shares of the ON amplitudes, `energy` (k, taxels) their squares as felt.
    """
    worst = None
    for coil in np.unique(coil_of).tolist():
        is_in_coil = coil_of == coil
        played = levels[:, is_in_coil]
        on = np.where(played > 0, energy[:, is_in_coil] / np.maximum(played, 1e-9) ** 2, np.inf).min(1)
        off = np.where(played > 0, 0.0, energy[:, is_in_coil]).max(1)
        both = np.flatnonzero(np.isfinite(on) & (off > 0))
        if len(both):
            contrast_db = 10 * np.log10(np.maximum(on[both], 1e-30) / off[both])
            least = int(contrast_db.argmin())
            if worst is None or contrast_db[least] < worst[0]:
                worst = float(contrast_db[least]), int(both[least]), coil
    return worst


def frame_contrast(plan: Plan, drive: PadDrive, shown: Timeline, tuning: Tuning | None = None) -> FrameContrast | None:
    """Predict the contrast of a timeline's frames; None without frames, or where no coil has taxels ON and OFF."""
    if shown.frame_s is None:
        return None
    turns = drive.scheme.takes_turns
    slot, levels = slots_of(shown.time_s, shown.levels, shown.frame_s, turns)
    count = len(levels)
    amplitude, energy = follow(shown.time_s, shown.signed, taus_s(plan, tuning))
    played = overlap(shown.time_s, shown.signed, shown.signed)
    size = np.abs(shown.levels)
    slots, power, ends = np.zeros((3, count, len(plan.taxels)))
    for k in range(count):
        slots[k] = energy[slot == k].sum(0) / shown.frame_s
        power[k] = played[slot == k].sum(0) / shown.frame_s
        ends[k] = amplitude[_last_held_keyframe(shown.levels, slot, k)] ** 2
    coil_of = np.zeros(len(plan.taxels), int)
    known: dict[tuple[bytes, bytes], _CoilCrosstalk] = {}
    for index, coil in enumerate(drive.coils):
        coil_of[coil.taxels] = index
        if len(coil.taxels) < 2:
            continue
        key_of = coil.force_hz.tobytes(), coil.line_a2.tobytes()
        if key_of not in known:
            known[key_of] = _coil_crosstalk(plan, drive, coil, tuning)
        heard = known[key_of]
        state = levels[:, coil.taxels]
        slots[:, coil.taxels] += power[:, coil.taxels] @ heard.tones.T
        ends[:, coil.taxels] += state**2 @ heard.tones.T
        if heard.spurs is not None:
            first, second = heard.makers
            both = overlap(shown.time_s, size[:, coil.taxels[first]], size[:, coil.taxels[second]])
            both = np.stack([both[slot == k].sum(0) for k in range(count)])
            product = state[:, first] * state[:, second]
            # A tone has the root of its level, a biased one the level itself.
            once = product if drive.scheme.at_resonance else np.ones(product.shape)
            slots[:, coil.taxels] += (both / shown.frame_s * once) @ heard.spurs.T
            ends[:, coil.taxels] += (product * once) @ heard.spurs.T
        if not turns:
            slots[:, coil.taxels] += _beats(plan, drive, shown, coil, tuning, slot, amplitude) / shown.frame_s
    worst = worst_contrast(levels, slots, coil_of)
    if worst is None:
        return None
    at_end = None if turns else worst_contrast(levels, ends, coil_of)
    place = drive.coils[worst[2]]
    return FrameContrast(worst[0], at_end and at_end[0], worst[1], (place.row, place.column), shown.frame_s)


def _beats(
    plan: Plan,
    drive: PadDrive,
    shown: Timeline,
    coil: CoilDrive,
    tuning: Tuning | None,
    slot: np.ndarray,
    amplitude: np.ndarray,
) -> np.ndarray:
    """Return what beats with a coil's other spectral lines add in transitions to its taxels' ∫ a² dt (frames, n) in s.

    What rings and what is heard of a line beside it have not the time to average out: the sum has their phases. With
    tones the spur of a pair lies between the two, and sounds while one takes the other's place.
    """
    taxels = [(tuning or planned_tuning(plan)).taxels[k] for k in coil.taxels]
    hz = np.array([taxel.resonance_hz for taxel in taxels])
    tau_s = taus_s(plan, tuning)[coil.taxels]
    q = np.array([taxel.q for taxel in taxels])
    line_hz = coil.force_hz
    phase = coil.phase_rad
    line = coil.line_a2
    first = second = np.arange(len(line))
    if not drive.scheme.at_resonance:
        pairs = np.triu_indices(len(line), 1)
        first = np.append(first, pairs[0])
        second = np.append(second, pairs[1])
    made_hz = (line_hz[first] + line_hz[second]) / 2
    made_phase = (phase[first] + phase[second]) / 2
    made = np.sqrt(line[first] * line[second]) * np.where(first == second, 1.0, 2.0)
    answer = 1 / (hz[:, None] ** 2 - made_hz**2 + 1j * made_hz * hz[:, None] / q[:, None])
    # Over the own ON amplitude, and over its phase: a quarter of a period behind the line.
    heard = 1j * answer * made * (hz**2 / q / line)[:, None]
    heard[np.arange(len(line)), np.arange(len(line))] = 0.0
    apart = 2 * np.pi * (made_hz - line_hz[:, None])
    turned = made_phase - phase[:, None]
    share = blend(np.arange(STEPS + 1) / STEPS)[:, None]
    levels = shown.signed[:, coil.taxels]
    count = int(slot.max())
    motion = np.zeros((count, len(line)))
    for k in range(count):
        key = int(np.flatnonzero(slot == k)[0])
        before = levels[key]
        after = levels[key + 1]
        begun = amplitude[key, coil.taxels]
        if np.array_equal(before, after):
            continue
        begin_s = shown.time_s[key]
        seconds = shown.time_s[key + 1] - shown.time_s[key]
        decaying = np.einsum("atn,an->tn", course(tau_s, seconds), np.stack([begun, before, after]))
        # The root of a line, turned by a quarter of its period where that is in counter-phase.
        level = np.sqrt((1 - share) * before + share * after + 0j).conj()
        weight = np.full(STEPS + 1, seconds / STEPS)
        weight[[0, -1]] /= 2
        time_s = begin_s + np.arange(STEPS + 1) * (seconds / STEPS)
        turn = np.exp(1j * (apart * time_s[:, None, None] + turned))
        product = decaying[:, :, None] * (level[:, first] * level[:, second])[:, None, :] * turn
        total = np.einsum("t,tnx->nx", weight, product)
        # Then what was switched rings on, while the others are held.
        rest_s = shown.time_s[key + 2] - shown.time_s[key + 1] if slot[key + 1] == k else 0.0
        rate = 1 / tau_s[:, None] - 1j * apart
        rings = (decaying[-1] - after)[:, None] * (1 - np.exp(-rate * rest_s)) / rate
        total += rings * level[-1, first] * level[-1, second] * turn[-1]
        motion[k] = 2 * (heard * total).real.sum(1)
    return motion


class _CoilCrosstalk(NamedTuple):
    """Energies `tones` (n, n) of a coil's n taxels under lines meant for others, divided by each taxel's ON energy.

    `spurs` (n, l) are of those that the pairs `makers`, two arrays (l,), make together; None where there are none.
    """

    tones: np.ndarray
    spurs: np.ndarray | None
    makers: tuple[np.ndarray, ...]


def _coil_crosstalk(plan: Plan, drive: PadDrive, coil: CoilDrive, tuning: Tuning | None) -> _CoilCrosstalk:
    taxels = [(tuning or planned_tuning(plan)).taxels[k] for k in coil.taxels]
    channels = [plan.channels[plan.taxels[k].channel] for k in coil.taxels]
    which = Channels(np.array([t.resonance_hz for t in taxels]), np.array([t.q for t in taxels]), coil.line_a2)
    modes = coil_modes(plan.spec, channels) if tuning is None else None
    heard = np.concatenate([line_energy(which, part, modes) for part in own_lines(which, drive.scheme)], 2)
    heard[:, 0][np.diag_indices(len(channels))] = 0.0
    if not drive.scheme.has_pair_spurs or len(channels) > MOST_WITH_SPURS:
        return _CoilCrosstalk(heard.sum(1), None, ())
    pairs = pair_lines(which, drive.scheme)
    return _CoilCrosstalk(heard.sum(1), line_energy(which, pairs, modes).sum(1), pairs.makers)


def slot_findings(
    plan: Plan,
    drive: PadDrive,
    frames: np.ndarray,
    shown: Timeline,
    brake: bool,
    tuning: Tuning | None = None,
    signs: np.ndarray | float = 1.0,
) -> tuple[Finding, ...]:
    """Return a warning if frames are too short for the required contrast, naming a sufficient length if there is one.

    Asked is `drive.delta_y`, and no more than `SLOT_DB`.
    """
    asked_db = min(plan.selectivity.asked_db, SLOT_DB)
    contrast = frame_contrast(plan, drive, shown, tuning)
    if contrast is None or contrast.slot_db >= asked_db:
        return ()

    def kept_db(seconds: float | None, braked: bool) -> float:
        one = frame_contrast(plan, drive, timeline(plan, frames, seconds, braked, tuning, signs), tuning)
        assert one is not None
        return one.slot_db

    tried = []
    rate = next(one for one in plan.refresh if one.scheme == plan.selectivity.drive)
    for braked in (brake,) if brake or plan.scheme.takes_turns else (False, True):
        # The plan's rate is for the worst that frames can show.
        planned = rate.braked_frames_per_s if braked else rate.kept_frames_per_s
        least = max(contrast.frame_s, braked_s(plan, tuning) if braked else 0.0)
        seconds = max(least, 1 / planned if planned else 0.0)
        while seconds <= LONGEST_S:
            text = at_least(seconds)
            if kept_db(float(text), braked) >= asked_db:
                way = f"--seconds {text}"
                if braked and not brake:
                    # As long as now, and as long as braked frames are where no length is asked for.
                    suffices = float(text) <= float(at_least(contrast.frame_s)) and kept_db(None, True) >= asked_db
                    way = "--brake" if suffices else f"--brake with {way}"
                tried.append(way)
                break
            seconds *= LONGER
    cure = f"; {' or '.join(tried)} would do" if tried else "; no longer frame that was tried would do"
    row, column = contrast.coil
    return (
        Finding(
            "warning",
            "frames.slot",
            WHERE,
            f"on average over its {about(contrast.frame_s, 3)} s, frame {contrast.frame + 1} has"
            f" {contrast.slot_db:.1f} dB of ON over OFF on coil r{row}c{column} (asked of a frame: {asked_db:.1f} dB),"
            f" since vibration takes time to rise and to die away{cure}",
        ),
    )
