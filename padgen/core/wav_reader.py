"""Read WAV files: any number of channels, PCM of 1 to 32 bits and IEEE floats, with samples read on demand."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np

from padgen.core.errors import FileError, number
from padgen.core.files import reason, wait_for_commit

__all__ = ["EXTENSIBLE", "FLOAT", "PCM", "SUBFORMAT", "Wave", "read_wav"]

PCM = 1
FLOAT = 3
EXTENSIBLE = 0xFFFE
SUBFORMAT = 0, 0x10, bytes.fromhex("800000aa00389b71")
"""Fields after the format's number in the subformat of WAVE_FORMAT_EXTENSIBLE: two numbers and bytes."""
SPOILT = "is cut off or damaged, not a WAV file that can be read: it"
READ_BYTES = 1 << 22
MOST_CHUNKS = 1000


@dataclass(frozen=True, slots=True, eq=False)
class Wave:
    """A WAV file: `count` samples of `channels` channels, read on demand; full scale is 1.

    `kind` is 'pcm' or 'float', with `bits` bits in `width` bytes; `comment` is that of the file's INFO list. `held` are
    the file's bytes (None: they are on disk); `offset` is the start of the samples.
    """

    path: Path
    rate_hz: int
    channels: int
    count: int
    kind: str
    bits: int
    width: int
    comment: str
    offset: int
    held: bytes | None

    @property
    def seconds(self) -> float:
        """Duration in s."""
        return self.count / self.rate_hz

    def read(self, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Return samples (s, channels) from `start` up to, not including, `stop`, as doubles; by default all."""
        raw = self._raw()[start:stop]
        if self.kind == "float":
            return np.ascontiguousarray(raw).view(f"<f{self.width}")[..., 0].astype(float)
        if self.bits <= 8:  # samples of up to 8 bits are unsigned
            return (raw[..., 0].astype(float) - 128) / 128
        if self.width == 3:
            whole = np.zeros((*raw.shape[:-1], 4), np.uint8)
            whole[..., 1:] = raw
            raw = whole
        return np.ascontiguousarray(raw).view(f"<i{raw.shape[-1]}")[..., 0] / 2.0 ** (8 * raw.shape[-1] - 1)

    def data(self) -> Iterator[bytes]:
        """Yield the bytes of the samples as they are in the file, in blocks."""
        raw = self._raw()
        step = max(READ_BYTES // (self.channels * self.width), 1)
        return (raw[start : start + step].tobytes() for start in range(0, self.count, step))

    def _raw(self) -> np.ndarray:
        """Return the bytes of all samples of the file, as an array (count, channels, bytes of a sample)."""
        shape = self.count, self.channels, self.width
        if self.held is None and self.count:
            return np.memmap(self.path, np.uint8, "r", self.offset, shape)
        return np.ndarray(shape, np.uint8, self.held or b"", self.offset * bool(self.count))


def read_wav(path: Path, data: bytes | None = None) -> Wave:
    """Read the header of WAV file `path`; samples stay on disk unless the file's bytes are given as `data`.

    Raises
    ------
    FileError
        The file is missing, not a WAV file, of an unsupported kind, or shorter than stated.
    """
    try:
        if data is not None:
            return _read(path, BytesIO(data), len(data), data)
        wait_for_commit(path.parent, path.name)
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise FileError("cannot be read (it is no ordinary file)", str(path))
        with path.open("rb") as file:
            return _read(path, file, path.stat().st_size, None)
    except FileNotFoundError as error:
        raise FileError("there is no such file", str(path)) from error
    except OSError as error:
        raise FileError(f"cannot be read ({reason(error)})", str(path)) from error


def _read(path: Path, file: BinaryIO, size: int, held: bytes | None) -> Wave:
    """Read the header of an open WAV file of `size` bytes; errors name `path`."""
    where = str(path)
    head = file.read(12)
    if head[:4] != b"RIFF" or head[8:] != b"WAVE":
        raise FileError("is not a WAV file that can be read (RIFF)" if size else "is empty", where)
    parts: dict[bytes, tuple[int, int]] = {}
    for count, (name, start, length) in enumerate(_chunks(file, size, 12)):
        if count >= MOST_CHUNKS:
            raise FileError(f"is damaged: a WAV file has a few parts, this one more than {MOST_CHUNKS}", where)
        parts.setdefault(name, (start, length))
    if missing := {b"fmt ": "format", b"data": "samples"}.keys() - parts:
        raise FileError(f"{SPOILT} has no {'samples' if b'data' in missing and b'fmt ' in parts else 'format'}", where)
    held_of = {}
    for name in (b"fmt ", b"LIST"):
        start, length = parts.get(name, (0, 0))
        file.seek(start)
        held_of[name] = file.read(min(length, 1 << 16))
    rate_hz, channels, kind, bits, width = _format(held_of[b"fmt "], where)
    offset, said = parts[b"data"]
    frame = channels * width
    if said > size - offset:
        there = max(size - offset, 0) // frame
        raise FileError(
            f"is cut off: it has {there} of the {said // frame} samples that it states; copy or write it again", where
        )
    if said % frame:
        raise FileError(f"has {said} bytes of samples, not whole samples of {frame} bytes", where)
    info = held_of[b"LIST"]
    chunks = _chunks(BytesIO(info), len(info), 4) if info[:4] == b"INFO" else ()
    texts = [info[start : start + length] for name, start, length in chunks if name == b"ICMT"]
    comment = texts[0].rstrip(b"\0").decode("utf-8", "replace") if texts else ""
    return Wave(path, rate_hz, channels, said // frame, kind, bits, width, comment, offset, held)


def _chunks(file: BinaryIO, size: int, start: int) -> Iterator[tuple[bytes, int, int]]:
    """Yield name, start and stated size in bytes of a file's chunks."""
    while start + 8 <= size:
        file.seek(start)
        name, length = struct.unpack("<4sI", file.read(8))
        yield name, start + 8, length
        start += 8 + length + length % 2


def _format(data: bytes, where: str) -> tuple[int, int, str, int, int]:
    """Return sample rate in Hz, channels, kind, and bits and bytes of a sample from a format chunk."""
    if len(data) < 16:
        raise FileError(f"{SPOILT} has a format of {len(data)} bytes, at least 16 are needed", where)
    code, channels, rate_hz, _, frame, bits = struct.unpack("<HHIIHH", data[:16])
    if code == EXTENSIBLE and len(data) >= 40:
        sub_code, *subformat = struct.unpack("<IHH8s", data[24:40])
        code = sub_code if tuple(subformat) == SUBFORMAT else code
    if bits not in {PCM: range(1, 33), FLOAT: (32, 64)}.get(code, ()):
        raise FileError(
            f"has samples of format {code:#06x} and {bits} bits; PCM of 1 … 32 bits and floats of 32 or 64 are read",
            where,
        )
    if not channels or not rate_hz:
        raise FileError(f"has {channels} channels at {number(rate_hz)} Hz, neither may be 0", where)
    width = frame // channels
    fits = -(-bits // 8)
    # Integers may lie in the upper part of a word of 32 bits.
    if frame % channels or width not in ((fits, 4) if code == PCM and fits > 1 else (fits,)):
        raise FileError(f"has {channels} channels of {bits} bits in {frame} bytes a sample", where)
    return rate_hz, channels, "pcm" if code == PCM else "float", bits, width
