"""A folder of driver files: tables, waveforms, what a microcontroller or another program needs.

`write_drive` makes what was asked for and nothing else; every file is read back where it can be.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from padgen.core.errors import SpecError, at_most, number
from padgen.core.files import OutputFolder, json_text
from padgen.core.finding import Finding
from padgen.core.units import MS

if TYPE_CHECKING:
    import numpy as np

    from padgen.driver.ear import Heard
    from padgen.driver.excitation import Excitation
    from padgen.driver.formats.wave_files import WaveReport
    from padgen.driver.pad_drive import PadDrive
    from padgen.driver.timeline import Timeline
    from padgen.measured.tuning import Tuning
    from padgen.planner.plan import Plan

__all__ = [
    "DEPTHS",
    "FORMATS",
    "DriveRequest",
    "Driven",
    "parse_formats",
    "write_drive",
    "write_excitation",
]

FORMATS = ("csv", "json", "wav", "c", "hjif", "syntacts")
FILES = {
    "wav": "drive.wav",
    "syntacts": "drive_syntacts.py",
    "hjif": "drive.hjif",
    "csv": "drive.csv",
    "json": "drive.json",
}
PLAYED = ("wav", "syntacts")
"""Formats that need something to show."""
DEPTHS = ("24", "float")
LARGEST_WAVE = 8e9
"""Bytes of a WAV file."""
MOST_HEARD = 25_000_000
"""Samples of a file that is listened to: about 2 GB of memory."""
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class DriveRequest:
    """What is asked for.

    `frames` (k, taxels) are levels in 0 … 1, shown for `seconds_each` (None: as the plan's frame rate has it, or where
    they are `held`, until all taxels have their level); a single one may `loop` without a seam. `rate_hz` None: the
    first of a sound card's that will do.
    """

    formats: tuple[str, ...]
    frames: "np.ndarray | None" = None
    seconds_each: float | None = None
    held: bool = False
    loop: bool = False
    rate_hz: int | None = None
    depth: str = "24"
    signal: str = "voltage"
    carrier_hz: float | None = None
    tuning: "Tuning | None" = None
    hear: bool = False
    gap: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """What was written, and what was seen on the way."""

    folder: Path
    files: tuple[str, ...]
    stale: tuple[str, ...]
    report: "WaveReport | None"
    heard: "Heard | None"
    findings: tuple[Finding, ...]


def parse_formats(text: str) -> tuple[str, ...]:
    """Formats from a comma-separated list, in the order of `FORMATS`."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in FORMATS:
            raise SpecError(f"must be among {', '.join(FORMATS)}, got {name!r}", "--formats")
    if not names:
        raise SpecError(f"must name one or more of {', '.join(FORMATS)}", "--formats")
    return tuple(name for name in FORMATS if name in names)


def write_drive(plan: "Plan", folder: Path, request: DriveRequest, progress: Progress = lambda step: None) -> Driven:
    """Write the driver files of `plan` into `folder`.

    Raises
    ------
    SpecError
        A request that this plan cannot meet; nothing is written.
    FileError
        The folder cannot be written; what was there stays.
    """
    from padgen.planner.plan import plan_to_json

    _refuse(request)
    judged = _judged(plan, request, progress)
    with OutputFolder(folder) as out:
        out.write("plan.json", plan_to_json(plan))
        names = ["plan.json", *_tables(out, plan, request)]
        report = heard = None
        if judged.drive is not None:
            if "wav" in request.formats and judged.timeline is not None:
                report = _wave(out, plan, judged.drive, judged, request, progress)
                names += ["drive.wav", "drive-wave.json"]
            names += _others(out, plan, judged.drive, judged, report, request)
            if request.hear and report is not None:
                progress("listening to the file")
                heard = _heard(out, plan, request)
                names.append("hear.json")
        # What was heard of a wave that is written anew does not stay.
        stale = out.commit(remove=["hear.json"] if report is not None and heard is None else [])
    findings = (*judged.findings, *(report.findings if report else judged.shown))
    findings += _ear_findings(heard) if heard else ()
    return Driven(folder, tuple(names), tuple(stale), report, heard, findings)


def write_excitation(
    plan: "Plan",
    folder: Path,
    kind: str,
    rate_hz: int | None,
    depth: str,
    seconds: float | None,
    together: bool,
    seed: int = 0,
) -> "tuple[Excitation, tuple[Finding, ...]]":
    """Write ``excitation.wav`` and ``excitation.json``, which shake all taxels while they are measured.

    The findings say where it is beyond a limit, as a spec may make it whatever the level.

    Raises
    ------
    SpecError, FileError
        As `excitation` and `write_drive` do.
    """
    from padgen.driver.excitation import excitation
    from padgen.driver.limits import judge_load
    from padgen.driver.loads import excitation_load
    from padgen.driver.rates import RATES_HZ
    from padgen.driver.wav_file import BEYOND_LIMIT, WavWriter
    from padgen.planner.plan import plan_to_json

    played = excitation(plan, kind, RATES_HZ[0] if rate_hz is None else rate_hz, seconds, seed, together)
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
        out.write("excitation.json", json_text(_excitation_table(plan, played, scale, depth)))
        out.commit()
    return played, findings


def _refuse(request: DriveRequest) -> None:
    if request.frames is None:
        for name in PLAYED:
            if name in request.formats:
                raise SpecError(f"{name} needs something to show; add --state or --frames", "--formats")
    if request.seconds_each is not None and request.frames is None:
        raise SpecError("is how long a frame lasts; add --state or --frames", "--seconds")
    if request.hear and "wav" not in request.formats:
        raise SpecError("listens to a WAV; add wav to --formats, and --state or --frames", "--hear")
    if request.loop and (request.frames is None or len(request.frames) != 1):
        raise SpecError("repeats one state without a seam; add --state with one", "--loop")


def _tables(out: OutputFolder, plan: "Plan", request: DriveRequest) -> list[str]:
    from padgen.driver.tables import drive_csv, drive_json
    from padgen.measured.tuned_table import tuned_drive_csv

    names = []
    if "csv" in request.formats:
        out.write("drive.csv", drive_csv(plan))
        names.append("drive.csv")
        if request.tuning is not None:
            out.write("drive-tuned.csv", tuned_drive_csv(plan, request.tuning))
            names.append("drive-tuned.csv")
    if "json" in request.formats:
        out.write("drive.json", drive_json(plan))
        names.append("drive.json")
    return names


def _timeline(plan: "Plan", drive: "PadDrive", request: DriveRequest) -> "Timeline":
    from padgen.driver.ear.score import SETTLED_TAUS
    from padgen.driver.timeline import ramp_s, steady, timeline

    frames = request.frames
    assert frames is not None
    in_turns = plan.selectivity.drive == "time-shared"
    if not request.loop:
        seconds = request.seconds_each
        if seconds is None and request.held:
            settled = SETTLED_TAUS * _slowest_s(plan, request.tuning)
            half_slot = max(ramp_s(plan), settled)
            seconds = 2 * len(plan.sets[0]) * half_slot if in_turns else ramp_s(plan) + settled + drive.period_s
        return timeline(plan, frames, seconds)
    if in_turns:
        raise SpecError("is for drives that play all channels at once, this one takes turns", "--loop")
    seconds = request.seconds_each or drive.period_s
    periods = round(seconds / drive.period_s)
    if periods < 1:
        raise SpecError(f"of a loop must be at least {number(drive.period_s)} s, got {number(seconds)} s", "--seconds")
    return steady(frames[0], periods * drive.period_s)


def _refuse_length(drive: "PadDrive", timeline: "Timeline", request: DriveRequest) -> None:
    bytes_each = 3 if request.depth == "24" else 4
    if "wav" in request.formats:
        longest = LARGEST_WAVE / (bytes_each * len(drive.coils) * drive.rate_hz)
        if timeline.seconds > longest:
            raise SpecError(
                f"of all frames together must be at most {at_most(longest)} s for a file of {LARGEST_WAVE / 1e9:g} GB,"
                f" they are {number(timeline.seconds)} s",
                "--seconds",
            )
    longest = MOST_HEARD / drive.rate_hz
    if request.hear and timeline.seconds > longest:
        raise SpecError(
            f"listens to at most {at_most(longest)} s, the frames last {number(timeline.seconds)} s; fewer or shorter"
            " ones (--seconds), or one state with --loop, would do",
            "--hear",
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Judged:
    """What is to be written, judged before anything is.

    `drive` is None where only tables are asked for of a pad with a washer that no coil pulls, `controller` the
    microcontroller's, None where none is asked for. `shown` are the findings about the timeline, `findings` all others.
    """

    drive: "PadDrive | None"
    controller: "PadDrive | None"
    timeline: "Timeline | None"
    shown: tuple[Finding, ...]
    findings: tuple[Finding, ...]


def _judged(plan: "Plan", request: DriveRequest, progress: Progress) -> _Judged:
    from padgen.driver.limits import judge_limits
    from padgen.driver.rates import CONTROLLER_RATES_HZ, RATES_HZ, drive_at

    unpulled = tuple(finding for finding in plan.findings if finding.code == "coil.force")
    if unpulled and set(request.formats) <= {"csv", "json"}:
        return _Judged(None, None, None, (), unpulled)
    progress("choosing phases")
    asked = request.rate_hz, request.tuning, request.carrier_hz
    drive = drive_at(plan, RATES_HZ, *asked)
    controller = drive_at(plan, CONTROLLER_RATES_HZ, *asked) if "c" in request.formats else None
    timeline = None
    if request.frames is not None:
        timeline = _timeline(plan, drive, request)
        _refuse_length(drive, timeline, request)
    progress("judging limits")
    shown: tuple[Finding, ...] = ()
    if timeline is not None and set(request.formats) != {"c"}:
        shown = judge_limits(_where(request), plan, drive, timeline, request.tuning)
    findings: tuple[Finding, ...] = ()
    # What a host will send is not known, nor what is made of tables alone.
    if controller is not None:
        findings = judge_limits("pad_drive.h", plan, controller, tuning=request.tuning)
    elif timeline is None:
        findings = judge_limits(_where(request), plan, drive, tuning=request.tuning)
    return _Judged(drive, controller, timeline, shown, findings)


def _where(request: DriveRequest) -> str:
    """The first of the files, but for the firmware's, that say what is played."""
    return next(FILES[name] for name in FILES if name in request.formats)


def _slowest_s(plan: "Plan", tuning: "Tuning | None") -> float:
    """The slowest taxel's time constant."""
    from padgen.physics.resonator import ring_up_time

    if tuning is None:
        return max(channel.ring_up_ms for channel in plan.channels) * MS
    return max(float(ring_up_time(taxel.resonance_hz, taxel.q)) for taxel in tuning.taxels)


def _wave(
    out: OutputFolder,
    plan: "Plan",
    drive: "PadDrive",
    judged: _Judged,
    request: DriveRequest,
    progress: Progress,
) -> "WaveReport":
    from padgen.driver.carriers import carrier_text
    from padgen.driver.formats.wave_files import wave_json, write_wave

    timeline = judged.timeline
    assert timeline is not None
    carrier = ""
    if drive.scheme.name == "spur-free" and drive.has_constant and not judged.shown:
        carrier = carrier_text(plan, timeline, request.rate_hz, request.tuning)
    progress(f"writing {timeline.seconds:.3g} s of {len(drive.coils)} coils")
    reports: list[WaveReport] = []

    def write(path: Path) -> None:
        reports.append(write_wave(path, drive, timeline, request.depth, request.signal, judged.shown, carrier))

    out.write_by("drive.wav", write)
    out.write("drive-wave.json", wave_json(plan, drive, timeline, reports[0], tuning=request.tuning))
    return reports[0]


def _others(
    out: OutputFolder,
    plan: "Plan",
    drive: "PadDrive",
    judged: _Judged,
    report: "WaveReport | None",
    request: DriveRequest,
) -> list[str]:
    names: list[str] = []
    timeline = judged.timeline
    if judged.controller is not None:
        from padgen.driver.formats.c_code import c_header, firmware_files

        files = {"pad_drive.h": c_header(plan, judged.controller, request.tuning).encode(), **firmware_files()}
        for name, data in files.items():
            out.write(name, data)
        names += files
    if "hjif" in request.formats:
        from padgen.driver.formats.hjif import hjif_text

        out.write("drive.hjif", hjif_text(plan, timeline, request.tuning))
        names.append("drive.hjif")
    if "syntacts" in request.formats and timeline is not None:
        from padgen.driver.formats.syntacts import syntacts_script

        scale = report.full_scale if report and report.signal == "voltage" else None
        out.write("drive_syntacts.py", syntacts_script(plan, drive, timeline, scale))
        names.append("drive_syntacts.py")
    return names


def _heard(out: OutputFolder, plan: "Plan", request: DriveRequest) -> "Heard":
    import json

    from padgen.driver.ear import hear
    from padgen.driver.wav_file import read_wav

    wave = read_wav(out.path_of("drive.wav"))
    sidecar = json.loads(out.path_of("drive-wave.json").read_text(encoding="utf-8"))
    heard = hear(plan, wave, sidecar, request.tuning, request.gap)
    from padgen.driver.ear.heard_table import heard_table

    out.write("hear.json", json_text(heard_table(heard)))
    return heard


def _ear_findings(heard: "Heard") -> tuple[Finding, ...]:
    from padgen.driver.ear.heard_table import ear_findings

    return ear_findings(heard)


def _excitation_table(plan: "Plan", played: "Excitation", scale: float, depth: str) -> dict[str, Any]:
    return {
        "name": plan.name,
        "wave": "excitation.wav",
        "kind": played.kind,
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
