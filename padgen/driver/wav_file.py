"""Multichannel WAV files, written in blocks: PCM of 24 bits and IEEE floats, any number of channels.

RIFF/WAVE; above 4 GiB RF64 (EBU Tech 3306), whose chunk `ds64` has the sizes in 64 bits. With more than two channels
or more than 16 bits the format is WAVE_FORMAT_EXTENSIBLE, here without loudspeaker positions: channel k is coil k.
`padgen.core.wav_reader` reads them.
"""

import struct
import zlib
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

import numpy as np

from padgen.core.errors import FileError
from padgen.core.wav_reader import EXTENSIBLE, FLOAT, IN_DS64, PCM, SUBFORMAT

__all__ = ["BEYOND_LIMIT", "DEPTHS", "LARGEST_24", "WavWriter", "wav_header"]

DEPTHS = ("24", "float")
BEYOND_LIMIT = "; not to be played: "
"""What a file's comment has before each limit that the file is beyond."""
LARGEST_24 = 1 - 2.0**-23
"""The largest sample that 24 bits hold; the smallest is −1."""
MOST_CHANNELS = 65535


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
    return _chunk(b"fmt ", head + struct.pack("<HHIIHH8s", 22, 8 * width, 0, code, *SUBFORMAT))


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
