"""The samples of `driver/waveform.py` as a WAV file, and beside it what a reader must know: scale, coils, keyframes.

Files are written in blocks: PCM of 24 bits and IEEE floats, any number of channels. With more than two channels or more
than 16 bits the format is WAVE_FORMAT_EXTENSIBLE, here without loudspeaker positions: channel k is coil k.
`padgen.core.wav_reader` reads them.
"""

import json
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from math import floor, log10
from pathlib import Path
from typing import Any

import numpy as np

from padgen.core.errors import FileError, Finding, SpecError, at_most, number
from padgen.core.files import OutputFolder, json_text, reason
from padgen.core.wav_reader import EXTENSIBLE, FLOAT, PCM, SUBFORMAT, read_wav
from padgen.driver.ear import hear, heard_table
from padgen.driver.formats import DriveJob
from padgen.driver.loads import carrier_text
from padgen.driver.signs import PlayedRecoil
from padgen.driver.waveform import PadDrive, Timeline, blocks, coil_lines, sample_count
from padgen.measured.tuning import Tuning, tuning_hash
from padgen.physics.crest import ALIAS_DB
from padgen.physics.schemes import peak_current_a
from padgen.planner.plan import Plan

__all__ = [
    "BEYOND_LIMIT",
    "FILE",
    "LARGEST_24",
    "MADE_OF",
    "ORDER",
    "SIGNALS",
    "WavWriter",
    "WaveReport",
    "full_scale",
    "refuse",
    "wav_header",
    "wave_json",
    "write",
    "write_wave",
]

BEYOND_LIMIT = "; not to be played: "
"""Words in a file's comment before each limit that the file exceeds."""
LARGEST_24 = 1 - 2.0**-23
"""The largest sample that 24 bits hold; the smallest is −1."""
MOST_CHANNELS = 65535
LARGEST_WAVE = 4_000_000_000
"""Bytes of the samples of a WAV file, whose sizes have 32 bits."""


def wav_header(rate_hz: int, channels: int, count: int, depth: str, comment: str = "") -> bytes:
    """Return all bytes before the samples of a file of `count` samples in each channel, `depth` '24' or 'float'.

    Raises
    ------
    FileError
        No or too many channels, or a rate that the format cannot tell.
    """
    if not 1 <= channels <= MOST_CHANNELS:
        raise FileError(f"must have 1 … {MOST_CHANNELS} channels, got {channels}", "WAV")
    width = 3 if depth == "24" else 4
    if channels * width > MOST_CHANNELS or channels * width * rate_hz > LARGEST_WAVE:
        most = min(MOST_CHANNELS // width, LARGEST_WAVE // (width * rate_hz))
        raise FileError(f"of {depth} can have at most {most} channels at {rate_hz} Hz, got {channels}", "WAV")
    data = count * channels * width
    if data > LARGEST_WAVE:
        raise FileError(f"would take {data / 1e9:.3g} GB, at most {LARGEST_WAVE / 1e9:g} GB are written", "WAV")
    code = PCM if depth == "24" else FLOAT
    frame = channels * width
    tag = code
    more = b"\0\0"
    if channels > 2 or depth == "24":
        tag = EXTENSIBLE
        more = struct.pack("<HHIIHH8s", 22, 8 * width, 0, code, *SUBFORMAT)
    chunks = _chunk(b"fmt ", struct.pack("<HHIIHH", tag, channels, rate_hz, frame * rate_hz, frame, 8 * width) + more)
    if depth == "float":
        chunks += _chunk(b"fact", struct.pack("<I", count))
    if comment:
        chunks += _chunk(b"LIST", b"INFO" + _chunk(b"ICMT", comment.encode() + b"\0"))
    riff = struct.pack("<I", 4 + len(chunks) + 8 + data + data % 2)
    return b"RIFF" + riff + b"WAVE" + chunks + b"data" + struct.pack("<I", data)


def _chunk(name: bytes, data: bytes) -> bytes:
    return name + struct.pack("<I", len(data)) + data + b"\0" * (len(data) % 2)


class WavWriter:
    """Context manager that writes a WAV file, of a number of samples given beforehand, block by block.

    `checksum` is the CRC-32 of the samples' bytes.
    """

    def __init__(self, path: Path, rate_hz: int, channels: int, count: int, depth: str, comment: str = "") -> None:
        self.checksum = 0
        self._odd = count * channels * (3 if depth == "24" else 4) % 2
        self._packed = _packed_24 if depth == "24" else _packed_float
        header = wav_header(rate_hz, channels, count, depth, comment)
        try:
            self._file = path.open("wb")
            self._file.write(header)
        except OSError as error:
            raise FileError(f"cannot be written ({reason(error)})", str(path)) from error

    def __enter__(self) -> "WavWriter":
        return self

    def __exit__(self, *error: object) -> None:
        with self._file:
            self._file.write(b"\0" * self._odd)

    def write(self, samples: np.ndarray) -> None:
        """Append samples (s, channels) in −1 … 1.

        Raises
        ------
        ValueError
            A sample would be clipped.
        """
        raw = self._packed(samples).data
        self.checksum = zlib.crc32(raw, self.checksum)
        self._file.write(raw)


def _packed_24(samples: np.ndarray) -> np.ndarray:
    """Return samples (s, channels) in −1 … 1 as little-endian 24-bit integers, rounded, in bytes (s, channels, 3).

    Without dither: the rounding error of a sum of lines is noise-like at this depth (`tests/driver/test_wav.py`).
    """
    scaled = np.rint(samples * 2.0**23)
    if not (scaled.min(initial=0) >= -(2.0**23) and scaled.max(initial=0) < 2.0**23):
        raise ValueError("samples would be clipped")
    whole = scaled.astype("<i4").view(np.uint8).reshape(*samples.shape, 4)
    packed = np.empty((*samples.shape, 3), np.uint8)
    # Three strided copies are several times faster than one of three bytes each.
    for byte in range(3):
        packed[..., byte] = whole[..., byte]
    return packed


def _packed_float(samples: np.ndarray) -> np.ndarray:
    if not np.abs(samples).max(initial=0) <= 1.0:
        raise ValueError("samples would be clipped")
    return np.ascontiguousarray(samples, dtype="<f4")


ORDER = 4
MADE_OF = "frames"
FILE = "drive.wav"
SIDECAR = "drive-wave.json"
HEARD = "hear.json"
SIGNALS = {"voltage": "V", "current": "A"}
"""Quantities of a file's samples, and their units."""
CHECKED_BLOCK = 1 << 12
"""Samples that are compared one by one when a file is read back."""


@dataclass(frozen=True, slots=True)
class WaveReport:
    """Figures of a written wave: a sample of 1.0 is `full_scale`, in V or A (`signal`); WAV channels are the coils.

    `rms_current_a`, `copper_loss_w` are each coil's over the file, `loss_over_tones` what all coils' is over that of
    plain tones with the same lines. `alias_db`: see `PadDrive`.
    """

    rate_hz: int
    count: int
    depth: str
    signal: str
    full_scale: float
    peak: float
    rms_current_a: tuple[float, ...]
    copper_loss_w: tuple[float, ...]
    loss_over_tones: float | None
    period_s: float
    loops: bool
    scheme: str
    carrier_hz: float | None
    alias_db: float | None
    findings: tuple[Finding, ...]

    @property
    def seconds(self) -> float:
        """Length of the file in s."""
        return self.count / self.rate_hz


def refuse(job: DriveJob) -> None:
    """Raise SpecError if all frames together last longer than one WAV file can hold."""
    drive, timeline = job.played()
    bytes_each = 3 if job.depth == "24" else 4
    longest = LARGEST_WAVE / (bytes_each * len(drive.coils) * drive.rate_hz)
    if timeline.seconds > longest:
        raise SpecError(
            f"of all frames together must be at most {at_most(longest)} s for a file of {LARGEST_WAVE / 1e9:g} GB,"
            f" they are {number(timeline.seconds)} s",
            "--seconds",
        )


def write(out: OutputFolder, job: DriveJob) -> None:
    """Write the WAV file, its sidecar and, where asked for, `hear.json`: what a simulated finger feels of it."""
    drive, timeline = job.played()
    request = job.request
    carrier = ""
    if drive.scheme.is_root and drive.has_constant and not job.shown:
        carrier = carrier_text(job.plan, timeline, request.rate_hz, request.tuning)
    job.progress(f"writing {timeline.seconds:.3g} s of {len(drive.coils)} coils")

    def put(path: Path) -> None:
        job.report = write_wave(path, drive, timeline, job.depth, request.signal, job.shown, carrier)

    path = out.write_by(FILE, put)
    assert job.report is not None
    sidecar = wave_json(job.plan, drive, timeline, job.report, request.tuning, job.recoil)
    out.write(SIDECAR, sidecar)
    if job.hear:
        job.progress("listening to the file")
        job.heard = hear(job.plan, read_wav(path), json.loads(sidecar), request.tuning, job.gap)
        out.write(HEARD, json_text(heard_table(job.heard)))


def write_wave(
    path: Path,
    drive: PadDrive,
    timeline: Timeline,
    depth: str = "24",
    signal: str = "voltage",
    judged: Sequence[Finding] = (),
    carrier: str = "",
) -> WaveReport:
    """Write a WAV file, one channel per coil, read it back and compare.

    Sample 1 is the amplifier's limit, or the next round value where the voltage goes above it: nothing is clipped.
    `judged` is what `padgen.driver.loads` found of the timeline; where it found anything, the file's comment says so.
    `carrier` is a clause about carriers for a current with a constant part.

    Raises
    ------
    FileError
        The file cannot be written, or is not on disk what was written.
    """
    scale = full_scale(drive, signal)
    beyond = "".join(f"{BEYOND_LIMIT}{finding.message}" for finding in judged)
    peak, square_a2, checksum, first = _write(path, drive, timeline, depth, signal, scale, beyond)
    if peak > scale * LARGEST_24:
        scale = _round_up(peak / LARGEST_24)
        peak, square_a2, checksum, first = _write(path, drive, timeline, depth, signal, scale, beyond)
    count = sample_count(drive, timeline)
    wave = read_wav(path)
    said = wave.rate_hz, wave.channels, wave.count, wave.kind, wave.bits
    due = drive.rate_hz, len(drive.coils), count, *(("pcm", 24) if depth == "24" else ("float", 32))
    read = 0
    for part in wave.data():
        read = zlib.crc32(part, read)
    # Half a step of 24 bits; a float's rounding is as large, at full scale.
    near = np.abs(wave.read(0, len(first)) - first).max(initial=0) <= 0.5001 * 2.0**-23
    if said != due or read != checksum or not near:
        raise FileError("read back is not what was written; the disk may be full or faulty", str(path))
    mean_square = square_a2 / max(count, 1)
    seconds = np.diff(timeline.time_s)
    strength = np.abs(timeline.levels)
    mean = seconds @ (strength[:-1] + strength[1:]) / 2
    tones_a2 = float(sum((mean[coil.taxels] * coil.line_a2).sum() for coil in drive.coils)) * drive.rate_hz
    if drive.scheme.force_order == 1:
        tones_a2 = 0.0  # tones at half the resonances move no magnet
    return WaveReport(
        rate_hz=drive.rate_hz,
        count=count,
        depth=depth,
        signal=signal,
        full_scale=scale,
        peak=peak,
        rms_current_a=tuple(np.sqrt(mean_square).tolist()),
        copper_loss_w=tuple((drive.resistance_ohm * mean_square).tolist()),
        loss_over_tones=float(square_a2.sum() / tones_a2) if tones_a2 > 0 else None,
        period_s=drive.period_s,
        loops=timeline.loops,
        scheme=drive.scheme.name,
        carrier_hz=drive.carrier_hz,
        alias_db=drive.alias_db,
        findings=(*judged, *_findings(path.name, drive, carrier)),
    )


def full_scale(drive: PadDrive, signal: str = "voltage") -> float:
    """Return the full scale of a file: the amplifier's limit in V, or a round current in A not below the peak."""
    if signal == "voltage":
        return drive.voltage_limit_v
    peak_a = max(peak_current_a(drive.scheme, c.line_a2, float(c.margin.max(initial=0.0))) for c in drive.coils)
    return _round_up(peak_a * (1 if drive.carrier_hz is None else 2**0.5) / LARGEST_24)


def _round_up(value: float) -> float:
    """Round up to 1, 1.5, 2, 3, 5 or 7 times a power of ten; return 1 for 0 and below."""
    if value <= 0:
        return 1.0
    power = floor(log10(value))
    return next(s * 10.0**power for s in (1, 1.5, 2, 3, 5, 7, 10, 15) if s * 10.0**power >= value)


def _write(
    path: Path, drive: PadDrive, timeline: Timeline, depth: str, signal: str, scale: float, beyond: str
) -> tuple[float, np.ndarray, int, np.ndarray]:
    """Write the file in one pass; return the largest sample, sums of i² (coils,), a checksum and the first samples.

    Once a sample would be clipped, silence is written, for another pass.
    """
    count = sample_count(drive, timeline)
    coils = len(drive.coils)
    peak = 0.0
    square = np.zeros(coils)
    first = np.zeros((0, coils))
    comment = f"sample 1 = {scale:g} {SIGNALS[signal]}; channel k is coil k, row by row{beyond}"
    try:
        with WavWriter(path, drive.rate_hz, coils, count, depth, comment) as file:
            for samples, square_a2 in blocks(drive, timeline, signal=signal):
                peak = max(peak, float(samples.max()), -float(samples.min()))
                square += square_a2
                samples *= 1 / scale if peak <= scale * LARGEST_24 else 0.0
                file.write(samples)
                if not len(first):
                    first = samples[:CHECKED_BLOCK].copy()
    except OSError as error:
        raise FileError(f"cannot be written ({reason(error)})", str(path)) from error
    return peak, square, file.checksum, first


def _findings(name: str, drive: PadDrive, carrier: str) -> Iterator[Finding]:
    if drive.has_constant:
        yield Finding("note", "wave.dc", name, f"has a constant part, so the amplifier must pass 0 Hz{carrier}")
    if drive.alias_db is not None and drive.alias_db > ALIAS_DB:
        cure = "a higher --rate would do" if drive.carrier_hz is None else "a higher --carrier lowers them"
        yield Finding(
            "warning",
            "wave.alias",
            name,
            f"its voltage has parts above what the amplifier passes, only {-drive.alias_db:.1f} dB below its largest"
            f" line (needed: {-ALIAS_DB:g} dB); {cure}",
        )


def wave_json(
    plan: Plan,
    drive: PadDrive,
    timeline: Timeline,
    report: WaveReport,
    tuning: Tuning | None = None,
    recoil: PlayedRecoil | None = None,
) -> str:
    """Return JSON that describes the WAV file: scale, coils in the order of its channels, spectral lines, keyframes.

    `tuning` is the one that `drive` was made with, `recoil` what the pad keeps when it moves.
    """
    figures: dict[str, Any] = {key: value for key, value in asdict(report).items() if key != "findings"}
    figures["seconds"] = report.seconds
    taxels: dict[int, dict[str, Any]] = {}
    for wav_channel, coil in enumerate(drive.coils):
        drive_hz = coil_lines(drive, coil)[0] / drive.period_s
        for j, index in enumerate(coil.taxels.tolist()):
            taxels[index] = {
                "id": plan.taxels[index].id,
                "wav_channel": wav_channel,
                "force_hz": float(coil.force_hz[j]),
                "drive_hz": float(drive_hz[j]),
                "line_a2": float(coil.line_a2[j]),
                "phase_rad": float(coil.phase_rad[j]),
            }
    table = {
        "name": plan.name,
        "wave": FILE,
        "tuned_to": None if tuning is None else tuning_hash(tuning),
        "unit": SIGNALS[report.signal],
        **figures,
        "resistance_ohm": drive.resistance_ohm,
        "inductance_mh": drive.inductance_h * 1e3,
        **({"corner_hz": drive.corner_hz} if drive.corner_hz else {}),
        "findings": [asdict(finding) for finding in report.findings],
        "coils": [{"wav_channel": k, "coil": [c.row, c.column]} for k, c in enumerate(drive.coils)],
        "taxels": [taxels[index] for index in sorted(taxels)],
        "recoil": None if recoil is None else recoil._asdict(),
        "frame_s": timeline.frame_s,
        "keyframes_note": "levels of all taxels, in the order of the plan's, from each time on blended into the next;"
        " below 0: in counter-phase; each times its sign, which is -1 for a taxel that moves against others of its"
        " frequency, so that the pad keeps still",
    }
    signs_of = np.broadcast_to(timeline.signs, timeline.levels.shape).astype(int)
    rows = (
        {"time_s": float(f"{time:.10g}"), "levels": [float(f"{level:.10g}") for level in levels], "signs": signs}
        for time, levels, signs in zip(
            timeline.time_s.tolist(), timeline.levels.tolist(), signs_of.tolist(), strict=True
        )
    )
    lines = ",\n  ".join(json.dumps(row) for row in rows)
    return f'{json_text(table).rstrip()[:-1].rstrip()},\n "keyframes": [\n  {lines}\n ]\n}}\n'
