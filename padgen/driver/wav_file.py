"""Multichannel WAV files, written and read in blocks: PCM of 24 bits and IEEE floats, any number of channels.

RIFF/WAVE; above 4 GiB RF64 (EBU Tech 3306), whose chunk `ds64` has the sizes in 64 bits. With more than two channels
or more than 16 bits the format is WAVE_FORMAT_EXTENSIBLE, here without loudspeaker positions: channel k is coil k.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, NamedTuple

import numpy as np

from padgen.core.errors import FileError, number

__all__ = ["BEYOND_LIMIT", "DEPTHS", "LARGEST_24", "WavWriter", "Wave", "read_wav", "wav_header"]

DEPTHS = ("24", "float")
BEYOND_LIMIT = "; not to be played: "
"""What a file's comment has before each limit that the file is beyond."""
LARGEST_24 = 1 - 2.0**-23
"""The largest sample that 24 bits hold; the smallest is −1."""
MOST_CHANNELS = 65535
PCM, FLOAT, EXTENSIBLE = 1, 3, 0xFFFE
SUBFORMAT_TAIL = bytes.fromhex("000000001000800000aa00389b71")
"""What follows the format's number in the subformat of WAVE_FORMAT_EXTENSIBLE."""
IN_DS64 = 0xFFFFFFFF
READ_BYTES = 1 << 22
MOST_CHUNKS = 1000


class _Chunk(NamedTuple):
    """A chunk of a file: where its data begin and how many bytes it says they are."""

    name: bytes
    start: int
    size: int


def wav_header(rate_hz: int, channels: int, count: int, depth: str, comment: str = "") -> bytes:
    """All bytes before the samples of a file of `count` samples in each channel, `depth` '24' or 'float'.

    Raises
    ------
    FileError
        No or too many channels, or a rate that the format cannot tell.
    """
    if not 1 <= channels <= MOST_CHANNELS:
        raise FileError(f"must have 1 … {MOST_CHANNELS} channels, got {channels}", "WAV")
    width = 3 if depth == "24" else 4
    if channels * width > MOST_CHANNELS or channels * width * rate_hz > IN_DS64:
        most = min(MOST_CHANNELS // width, IN_DS64 // (width * rate_hz))
        raise FileError(f"of {depth} can have at most {most} channels at {rate_hz} Hz, got {channels}", "WAV")
    data = count * channels * width
    chunks = _format_chunk(rate_hz, channels, depth)
    if depth == "float":
        chunks += _chunk(b"fact", struct.pack("<I", min(count, IN_DS64)))
    if comment:
        chunks += _chunk(b"LIST", b"INFO" + _chunk(b"ICMT", comment.encode() + b"\0"))
    riff = 4 + len(chunks) + 8 + data + data % 2
    if riff < IN_DS64:
        return b"RIFF" + struct.pack("<I", riff) + b"WAVE" + chunks + b"data" + struct.pack("<I", data)
    sizes = _chunk(b"ds64", struct.pack("<QQQI", riff + 36, data, count, 0))
    head = b"RF64" + struct.pack("<I", IN_DS64) + b"WAVE" + sizes
    return head + chunks + b"data" + struct.pack("<I", IN_DS64)


def _chunk(name: bytes, data: bytes) -> bytes:
    return name + struct.pack("<I", len(data)) + data + b"\0" * (len(data) % 2)


def _format_chunk(rate_hz: int, channels: int, depth: str) -> bytes:
    width, code = (3, PCM) if depth == "24" else (4, FLOAT)
    frame = channels * width
    extended = channels > 2 or depth == "24"
    tag = EXTENSIBLE if extended else code
    head = struct.pack("<HHIIHH", tag, channels, rate_hz, frame * rate_hz, frame, 8 * width)
    if not extended:
        return _chunk(b"fmt ", head + struct.pack("<H", 0))
    return _chunk(b"fmt ", head + struct.pack("<HHIH", 22, 8 * width, 0, code) + SUBFORMAT_TAIL)


class WavWriter:
    """Writes a WAV file block by block; a context manager. The number of samples is given beforehand.

    `checksum` is the CRC-32 of the samples' bytes.
    """

    def __init__(self, path: Path, rate_hz: int, channels: int, count: int, depth: str, comment: str = "") -> None:
        self._header = wav_header(rate_hz, channels, count, depth, comment)
        self._path, self._depth, self._channels, self._left = path, depth, channels, count
        self._odd = count * channels * (3 if depth == "24" else 4) % 2
        self.checksum = 0
        self._file: BinaryIO

    def __enter__(self) -> "WavWriter":
        try:
            self._file = self._path.open("wb")
        except OSError as error:
            raise FileError(f"cannot be written ({error.strerror})", str(self._path)) from error
        self._file.write(self._header)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._file:
            if kind is None:
                self._file.write(b"\0" * self._odd)
        if kind is None and self._left:
            raise ValueError(f"{self._left} samples are missing")

    def write(self, samples: np.ndarray) -> None:
        """Append samples (s, channels) in −1 … 1.

        Raises
        ------
        ValueError
            A sample would be clipped, or there are more samples than were announced.
        """
        if samples.shape[1] != self._channels or len(samples) > self._left:
            raise ValueError(f"{samples.shape} samples, at most {(self._left, self._channels)} are due")
        raw = (_packed_24(samples) if self._depth == "24" else _packed_float(samples)).data
        self._left -= len(samples)
        self.checksum = zlib.crc32(raw, self.checksum)
        self._file.write(raw)


def _packed_24(samples: np.ndarray) -> np.ndarray:
    """Bytes (s, channels, 3), little-endian, rounded to the nearest.

    Without dither: the rounding error of a sum of lines is noise-like at this depth (`tests/test_wav.py`).
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


@dataclass(frozen=True, slots=True, eq=False)
class Wave:
    """A WAV file: `count` samples of `channels` channels, read when they are asked for.

    `kind` is 'pcm' or 'float' with its `bits`; `comment` that of the file's INFO list. Full scale is 1.
    """

    path: Path
    rate_hz: int
    channels: int
    count: int
    kind: str
    bits: int
    comment: str
    offset: int

    @property
    def seconds(self) -> float:
        """Its length."""
        return self.count / self.rate_hz

    @property
    def samples(self) -> np.ndarray:
        """All samples (count, channels)."""
        return self.read()

    def read(self, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Samples (s, channels) from `start` to before `stop`, as doubles."""
        return _unpacked(self._raw()[start:stop], self.kind)

    def channel(self, index: int) -> np.ndarray:
        """The samples (count,) of one channel."""
        raw = self._raw()
        parts = [_unpacked(raw[i : i + READ_BYTES, index], self.kind) for i in range(0, self.count, READ_BYTES)]
        return np.concatenate(parts) if parts else np.zeros(0)

    def data(self) -> Iterator[bytes]:
        """The samples' bytes in the file, in blocks."""
        raw = self._raw()
        step = max(READ_BYTES // (self.channels * self.bits // 8), 1)
        return (raw[start : start + step].tobytes() for start in range(0, self.count, step))

    def _raw(self) -> np.ndarray:
        """The file's bytes (count, channels, bytes of a sample)."""
        shape = self.count, self.channels, self.bits // 8
        if not self.count:
            return np.zeros(shape, np.uint8)
        return np.memmap(self.path, np.uint8, "r", self.offset, shape)


def _unpacked(raw: np.ndarray, kind: str) -> np.ndarray:
    """Doubles of the bytes (…, width) of samples."""
    width = raw.shape[-1]
    if kind == "float":
        return np.ascontiguousarray(raw).view(f"<f{width}")[..., 0].astype(float)
    if width == 1:  # 8-bit samples have no sign
        return (raw[..., 0].astype(float) - 128) / 128
    whole = np.zeros((*raw.shape[:-1], 4), np.uint8)
    whole[..., 4 - width :] = raw
    return whole.view("<i4")[..., 0] / 2.0**31


def read_wav(path: Path) -> Wave:
    """The WAV file `path`; its samples stay on disk.

    Raises
    ------
    FileError
        It is not there, not a WAV file, of a kind that is not read, or shorter than it says.
    """
    try:
        size = path.stat().st_size
        if not (path.is_file() or path.is_dir()):
            raise FileError("cannot be read (it is no ordinary file)", str(path))
        with path.open("rb") as file:
            head = file.read(12)
            if head[:4] not in (b"RIFF", b"RF64") or head[8:] != b"WAVE":
                raise FileError("is empty" if not size else "is not a WAV file (RIFF or RF64)", str(path))
            return _read(path, file, size)
    except OSError as error:
        raise FileError(f"cannot be read ({error.strerror})", str(path)) from error


def _read(path: Path, file: BinaryIO, size: int) -> Wave:
    parts: dict[bytes, bytes] = {}
    data: _Chunk | None = None
    for count, chunk in enumerate(_chunks(file, size)):
        if count >= MOST_CHUNKS:
            raise FileError(f"is damaged: a WAV file has a few parts, this one more than {MOST_CHUNKS}", str(path))
        if chunk.name == b"data":
            data = data or chunk
        elif chunk.name in (b"ds64", b"fmt ", b"LIST") and chunk.name not in parts:
            file.seek(chunk.start)
            parts[chunk.name] = file.read(min(chunk.size, 1 << 16))
    if b"fmt " not in parts or data is None:
        missing = "format" if b"fmt " not in parts else "samples"
        raise FileError(f"is a WAV file without its {missing}", str(path))
    rate_hz, channels, kind, bits = _format(parts[b"fmt "], str(path))
    said = data.size
    frame = channels * bits // 8
    if said > size - data.start:
        there = max(size - data.start, 0) // frame
        raise FileError(
            f"is cut off: it has {there} of the {said // frame} samples that it says; copy or write it anew",
            str(path),
        )
    if said % frame:
        raise FileError(f"has {said} bytes of samples, not whole samples of {frame} bytes", str(path))
    return Wave(path, rate_hz, channels, said // frame, kind, bits, _comment(parts.get(b"LIST", b"")), data.start)


def _chunks(file: BinaryIO, size: int) -> Iterator[_Chunk]:
    """The chunks of a file; sizes that stand in `ds64` are taken from there."""
    start, in_64 = 12, 0
    while start + 8 <= size:
        file.seek(start)
        name, length = struct.unpack("<4sI", file.read(8))
        if name == b"ds64":
            sizes = file.read(16)
            in_64 = struct.unpack("<QQ", sizes)[1] if len(sizes) == 16 else 0
        if name == b"data" and length == IN_DS64 and in_64:
            length = in_64
        yield _Chunk(name, start + 8, length)
        start += 8 + length + length % 2


def _format(data: bytes, where: str) -> tuple[int, int, str, int]:
    """Rate, channels, kind and bits of a format chunk."""
    if len(data) < 16:
        raise FileError(f"has a format of {len(data)} bytes, at least 16 are due", where)
    code, channels, rate_hz, _, frame, bits = struct.unpack("<HHIIHH", data[:16])
    if code == EXTENSIBLE and len(data) >= 40:
        code = struct.unpack("<H", data[24:26])[0] if data[26:40] == SUBFORMAT_TAIL else EXTENSIBLE
    known = {PCM: (8, 16, 24, 32), FLOAT: (32, 64)}
    if bits not in known.get(code, ()):
        raise FileError(
            f"has samples of format {code:#06x} and {bits} bits; PCM of 8, 16, 24 or 32 bits and floats are read", where
        )
    if not channels or not rate_hz:
        raise FileError(f"has {channels} channels at {number(rate_hz)} Hz, neither may be 0", where)
    if frame != channels * bits // 8:
        raise FileError(f"has {channels} channels of {bits} bits in {frame} bytes a sample", where)
    return rate_hz, channels, "pcm" if code == PCM else "float", bits


def _comment(data: bytes) -> str:
    """The comment of an INFO list, empty where there is none."""
    at = 4
    while data[:4] == b"INFO" and at + 8 <= len(data):
        name, length = struct.unpack("<4sI", data[at : at + 8])
        if name == b"ICMT":
            return data[at + 8 : at + 8 + length].rstrip(b"\0").decode("utf-8", "replace")
        at += 8 + length + length % 2
    return ""
