"""`Drive`: frames or on/off states for the coils of a plan, and the folder of files that make a pad play them.

Tables, waveforms, what a microcontroller or another program needs. Made is what was asked for and nothing else; every
file is read back where it can be.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil, inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from padgen.core.errors import FileError, Finding, SpecError, number, shown
from padgen.core.files import OutputFolder, json_text, reason
from padgen.core.registry import FORMATS, names_in
from padgen.driver.ear import SETTLED_TAUS, Heard, ear_findings
from padgen.driver.excitation import SAMPLES_OF_HIGHEST, Excitation, excitation
from padgen.driver.formats import DriveJob, in_order
from padgen.driver.formats.wav import BEYOND_LIMIT, WaveReport, WavWriter
from padgen.driver.formats.wav import FILE as WAV
from padgen.driver.frames import CROSSED, pattern_frames, read_frames, state_frames, text_frames
from padgen.driver.loads import excitation_load, judge_limits, judge_load, judge_warmth
from padgen.driver.outputs import Outputs, needed_outputs
from padgen.driver.signs import PlayedPad, PlayedRecoil, choose_signs, played_recoil
from padgen.driver.slots import FrameContrast, frame_contrast, slot_findings
from padgen.driver.waveform import RATES_HZ, PadDrive, Timeline, brake_of, drive_at, ramp_s, steady, timeline
from padgen.driver.wiring import crossed, crossed_frames, crossed_names
from padgen.measured.shaking import measuring_band_hz
from padgen.measured.tuning import Tuning, planned_tuning
from padgen.physics.resonator import ring_up_time
from padgen.planner.plan import Plan, plan_to_json
from padgen.planner.warm_pad import planned_warmth

__all__ = [
    "DEPTHS",
    "Drive",
    "Driven",
    "levels_of",
    "parse_formats",
    "write_excitation",
]

DEPTHS = ("24", "float")
WAV_AND_TABLES = ("csv", "json", "wav")
"""Formats that go with what only a WAV plays, a brake or taxels crossed: the WAV, and tables, which show no frames."""
UNSIGNED = "has all taxels of a channel in step: with the signs that keep the pad still it"


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """Result of writing a drive: its files and findings, with the contrast, recoil and warming that they predict.

    `contrast` is that of its frames, and `outputs` those that it needs, None where the spec names what feeds the coils.
    `recoil` is what the moving pad keeps of its frames. `beam_rise_k` is the most by which a WAV that is played over
    and over warms the beams over the room: as if each coil had the heat of the one that has most of it.
    """

    folder: Path
    files: tuple[str, ...]
    stale: tuple[str, ...]
    report: WaveReport | None
    heard: Heard | None
    findings: tuple[Finding, ...]
    contrast: FrameContrast | None = None
    outputs: Outputs | None = None
    beam_rise_k: float | None = None
    recoil: PlayedRecoil | None = None


def parse_formats(text: str) -> tuple[str, ...]:
    """Return the format names of a comma-separated list, sorted in the order in which padgen writes their files."""
    return tuple(in_order(names_in(text, FORMATS.names(), "--formats")))


def write_excitation(
    plan: Plan,
    folder: Path,
    kind: str,
    rate_hz: int | None,
    depth: str,
    seconds: float | None,
    together: bool,
) -> tuple[Excitation, tuple[Finding, ...]]:
    """Write ``excitation.wav`` and ``excitation.json``, which shake all taxels while they are measured.

    The findings say where it is beyond a limit, as a spec may make it whatever the level.

    Raises
    ------
    SpecError, FileError
        As `excitation` and `Drive.save` do.
    """
    least_hz = SAMPLES_OF_HIGHEST * measuring_band_hz(plan)[1]
    own_hz = next((rate for rate in RATES_HZ if rate >= least_hz), ceil(least_hz / 1000) * 1000)
    played = excitation(plan, kind, own_hz if rate_hz is None else rate_hz, seconds, together=together)
    findings = tuple(judge_load("excitation.wav", plan, excitation_load(plan, played)))
    scale = plan.spec.drive.voltage_limit_v

    def write(path: Path) -> None:
        beyond = "".join(f"{BEYOND_LIMIT}{finding.message}" for finding in findings)
        comment = f"sample 1 = {scale:g} V; {kind}; channel k is coil k, row by row{beyond}"
        with WavWriter(path, played.rate_hz, len(played.coils), played.samples, depth, comment) as file:
            for block in played.blocks():
                file.write(block / scale)

    with OutputFolder(folder) as out:
        out.write("plan.json", plan_to_json(plan))
        out.write_by("excitation.wav", write)
        out.write(
            "excitation.json",
            json_text(
                {
                    "name": plan.name,
                    "wave": "excitation.wav",
                    "kind": kind,
                    "rate_hz": played.rate_hz,
                    "samples": played.samples,
                    "seconds": played.seconds,
                    "depth": depth,
                    "signal": "voltage",
                    "unit": "V",
                    "full_scale": scale,
                    "peak": float(abs(played.voltage_v).max()),
                    "band_hz": list(played.band_hz),
                    "sweep_s": played.sweep_s,
                    "turn_s": len(played.current_a) / played.rate_hz,
                    "together": played.together,
                    "level_share": played.level_share,
                    "copper_loss_w": played.copper_loss_w,
                    "coils": [{"wav_channel": k, "coil": list(coil)} for k, coil in enumerate(played.coils)],
                }
            ),
        )
        out.commit()
    return played, findings


def _timeline(drive: PadDrive, request: "Drive", frames: np.ndarray, signs: np.ndarray | float = 1.0) -> Timeline:
    plan = request.plan
    seconds = request.seconds
    in_turns = request.plan.scheme.takes_turns
    if not request.loop:
        if seconds is None and request.held:
            known = (request.tuning or planned_tuning(plan)).taxels
            settled = SETTLED_TAUS * max(float(ring_up_time(taxel.resonance_hz, taxel.q)) for taxel in known)
            half_slot = max(ramp_s(plan), settled)
            seconds = 2 * len(plan.sets[0]) * half_slot if in_turns else ramp_s(plan) + settled + drive.period_s
            if request.brake:
                seconds += brake_of(plan, request.tuning).seconds
        return timeline(plan, frames, seconds, request.brake, request.tuning, signs)
    if in_turns:
        raise SpecError("is for drives that play all channels at once, this one takes turns", "--loop")
    seconds = seconds or drive.period_s
    periods = round(seconds / drive.period_s)
    if periods < 1:
        raise SpecError(f"of a loop must be at least {number(drive.period_s)} s, got {number(seconds)} s", "--seconds")
    return steady(frames[0], periods * drive.period_s, signs)


def levels_of(
    plan: Plan, state: str | None, frames: Any = None, text: str | None = None, pattern: str | None = None
) -> np.ndarray | None:
    """Return levels (k, taxels) in 0 … 1 from whichever of state, frames, text and pattern is given; None if none is.

    Raises
    ------
    SpecError, FileError
        Two are given, or the pad cannot show it.
    """
    given = {"state": state, "frames": frames, "text": text, "pattern": pattern}
    named = [name for name, value in given.items() if value is not None]
    if len(named) > 1:
        raise SpecError(f"and {named[1]} are given; one of {', '.join(given)} is shown, not both", named[0])
    makers = {"state": state_frames, "text": text_frames, "pattern": pattern_frames}
    if pattern == CROSSED:
        return crossed_frames(plan)
    for name in named:
        if name in makers:
            return makers[name](plan, given[name])
    if frames is None:
        return None
    if isinstance(frames, (str, Path)) or all(isinstance(frame, (str, Path)) for frame in frames):
        return read_frames(frames, plan).levels
    levels = np.atleast_2d(np.asarray(frames, float))
    if levels.ndim != 2 or levels.shape[1] != len(plan.taxels) or not ((levels >= 0) & (levels <= 1)).all():
        raise SpecError(f"must be (k, {len(plan.taxels)}) levels in 0 … 1, got an array {levels.shape}", "frames")
    return levels


@dataclass(frozen=True, eq=False, repr=False)
class Drive:
    """Frames for the coils of a plan, and the options of their drive; `padgen.drive` makes it and explains the options.

    `frames` (k, taxels) are levels in 0 … 1, None for tables alone; `held` tells that they are states. With `brake`
    a WAV stops taxels that go OFF in counter-phase. Where the pad is driven `warm`, so is the `tuning`. In a `crossed`
    one outputs play the lines of their neighbours, to tell where coils are connected.
    """

    plan: Plan
    frames: np.ndarray | None = None
    seconds: float | None = None
    held: bool = False
    loop: bool = False
    rate_hz: int | None = None
    signal: str = "voltage"
    carrier_hz: float | None = None
    tuning: Tuning | None = None
    progress: Callable[[str], None] = lambda step: None
    brake: bool = False
    warm: bool = False
    crossed: bool = False

    def __repr__(self) -> str:
        shown = "tables" if self.frames is None else f"{len(self.frames)} frames"
        return f"<Drive {self.plan.name}: {shown}, {self.plan.selectivity.drive}>"

    @property
    def played(self) -> tuple[str, ...]:
        """Names of the tones that the pattern 'crossed' plays, one a frame, for `padgen.check_wiring`; else empty."""
        return crossed_names(self.plan) if self.crossed else ()

    def save(
        self,
        path: str | Path,
        formats: Sequence[str] | None = None,
        depth: str = "24",
        hear: bool = False,
        gap: bool = False,
    ) -> Driven:
        """Write the drive to one file or a folder of files, and check it against the limits of coil, amplifier and gap.

        Parameters
        ----------
        path : path
            A file such as ``drive.wav``, whose ending tells its format, or a folder.
        formats : sequence of str, optional
            For a folder: names of `padgen.driver.formats`; by default tables, and a WAV where something is shown.
        depth : {'24', 'float'}
            Of a WAV's samples.
        hear : bool
            Listen to the written WAV: what fingers feel of it, in ``.heard``. `gap`: the pull grows as the gap closes.

        Returns
        -------
        Driven
            ``.files`` and ``.findings``; an error tells which limit is exceeded.

        Raises
        ------
        SpecError
            What is asked for does not go together; nothing is written.
        FileError
            It cannot be written; what was there stays.
        """
        target = Path(path)
        if formats is not None or not target.suffix:
            return self.save_folder(target, formats, depth, hear, gap)
        # Of formats whose files end alike the first one counts, which padgen brings.
        known = reversed(in_order(FORMATS.names()).items())
        endings = {Path(each.FILE).suffix: (name, each.FILE) for name, each in known}
        if target.suffix.lower() not in endings:
            raise SpecError(
                f"must end with one of {', '.join(sorted(endings))}, got {shown(target.suffix)}", str(target)
            )
        name, file = endings[target.suffix.lower()]
        try:
            with TemporaryDirectory(prefix=".padgen-", dir=target.absolute().parent) as aside:
                driven = self.save_folder(Path(aside) / "drive", (name,), depth)
                (driven.folder / file).replace(target)
        except OSError as error:
            raise FileError(f"cannot be written ({reason(error)})", str(target)) from error
        return replace(driven, folder=target.absolute().parent, files=(target.name,))

    def save_folder(
        self, folder: Path, formats: Sequence[str] | None, depth: str = "24", hear: bool = False, gap: bool = False
    ) -> Driven:
        """Write a folder of files; parameters, result and errors are those of `save`."""
        chosen = formats or ("csv", "json", *(() if self.frames is None else ("wav",)))
        written = in_order(names_in(",".join(chosen), FORMATS.names(), "--formats"))
        for name, each in written.items():
            if self.frames is None and each.MADE_OF == "frames":
                raise SpecError(f"{name} needs something to show; add --state or --frames", "--formats")
        if self.seconds is not None and self.frames is None:
            raise SpecError("is how long a frame lasts; add --state or --frames", "--seconds")
        if hear and "wav" not in written:
            if self.frames is None:
                raise SpecError("needs something to show: add --state, --frames, --text or --pattern", "--hear")
            raise SpecError("listens to the WAV: add wav to --formats", "--hear")
        if self.loop and (self.frames is None or len(self.frames) != 1):
            raise SpecError("repeats one state without a seam; add --state with one", "--loop")
        others = [name for name in written if name not in WAV_AND_TABLES]
        if self.brake:
            rules = (
                (self.frames is None, "is of a WAV; add --state or --frames"),
                (self.loop, "is for the end of a frame, a loop has none"),
                (bool(others), f"is in a WAV only; {', '.join(others)} of --formats cannot have it"),
            )
            for broken, sentence in rules:
                if broken:
                    raise SpecError(sentence, "--brake")
        if self.crossed and (hear or others):
            raise SpecError(
                f"{CROSSED!r} is played from a WAV; leave out --hear and formats for other players", "--pattern"
            )
        self.progress("choosing phases and signs")
        drive = drive_at(self.plan, RATES_HZ, self.rate_hz, self.tuning, self.carrier_hz)
        shown = None
        signs: np.ndarray | float = 1.0
        pad = None
        in_step = None
        if self.frames is not None:
            pad = PlayedPad(self.plan, drive, self.tuning)
            in_step = _timeline(drive, self, self.frames)
            held_s = (in_step.frame_s or inf) - ramp_s(self.plan) / 2
            held_s -= brake_of(self.plan, self.tuning).seconds if self.brake else 0.0
            signs = choose_signs(pad, self.frames, held_s, self.plan.scheme.takes_turns)
            shown = _timeline(drive, self, self.frames, signs)
            if self.crossed:
                drive = crossed(self.plan, drive)
        job = DriveJob(self.plan, self, self.progress, drive, shown, depth, hear, gap)
        for each in written.values() if shown else ():
            getattr(each, "refuse", lambda job: None)(job)
        self.progress("judging limits")
        # What a host will send is not known, nor what is made of tables alone.
        played = [each for each in written.values() if each.MADE_OF != "host"]
        where = min(played, key=lambda each: ("frames", "drive", "plan").index(each.MADE_OF), default=None)
        if where and shown:
            job.shown = judge_limits(where.FILE, self.plan, drive, shown, self.tuning)
            # With other signs a spur-free force may need a larger constant.
            if job.shown and in_step and not judge_limits(where.FILE, self.plan, drive, in_step, self.tuning):
                job.findings.append(Finding("note", "signs.limit", where.FILE, f"{UNSIGNED} {job.shown[0].message}"))
                job.timeline = shown = in_step
                job.shown = ()
                signs = 1.0
        elif where and len(played) == len(written):
            job.findings += judge_limits(where.FILE, self.plan, drive, tuning=self.tuning)
        contrast = None
        if shown and self.frames is not None and pad is not None and not self.crossed:
            job.recoil = played_recoil(pad, self.frames, np.broadcast_to(signs, self.frames.shape))
            contrast = frame_contrast(self.plan, drive, shown, self.tuning)
            job.findings += slot_findings(self.plan, drive, self.frames, shown, self.brake, self.tuning, signs)
        with OutputFolder(folder) as out:
            out.write("plan.json", plan_to_json(self.plan))
            for each in written.values():
                each.write(out, job)
            # What was heard of a wave that is written anew does not stay.
            stale = out.commit(remove=["hear.json"] if job.report is not None and job.heard is None else [])
        rise_k = None
        if job.report is not None:
            # A plan's heat is that of coils at 20 °C; the warmth counts what the copper's rise adds.
            cold = self.plan.spec.coil.resistance_ohm / drive.resistance_ohm
            heat = replace(self.plan.load, copper_loss_w=max(job.report.copper_loss_w) * cold)
            rise_k = planned_warmth(replace(self.plan, load=heat)).beam_rise_k
        findings = (*job.findings, *(job.report.findings if job.report else job.shown))
        if rise_k is not None:
            findings += tuple(judge_warmth(WAV, self.plan, rise_k))
        if job.heard:
            findings += tuple(ear_findings(job.heard))
        outputs = None if self.plan.spec.drive_devices else needed_outputs(self.plan, drive, self.tuning)
        return Driven(
            folder,
            out.names,
            tuple(stale),
            job.report,
            job.heard,
            findings,
            contrast=contrast,
            outputs=outputs,
            beam_rise_k=rise_k,
            recoil=job.recoil,
        )
