"""WAV files against two foreign readers and writers, and broken files."""

import os
import struct
import warnings
import wave
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from padgen.core.errors import FileError
from padgen.core.wav_reader import read_wav
from padgen.driver.formats.wav import LARGEST_24, LARGEST_WAVE, WavWriter, wav_header

RATE = 48000
STEP_24 = 2.0**-23


def written(path, samples, depth, comment="", parts=3):
    with WavWriter(path, RATE, samples.shape[1], len(samples), depth, comment) as file:
        for part in np.array_split(samples, parts):
            file.write(part)
    return path


def noise(count, channels, seed=0):
    samples = np.random.default_rng(seed).uniform(-1, 1, (count, channels))
    samples[0] = -1.0
    samples[-1] = LARGEST_24
    return samples


@pytest.mark.parametrize("channels", [1, 2, 3, 7, 19, 64])
@pytest.mark.parametrize("depth", ["24", "float"])
def test_scipy_reads_what_is_written(tmp_path, channels, depth):
    samples = noise(101, channels)
    path = written(tmp_path / "a.wav", samples, depth, "sample 1 = 30 V")
    with warnings.catch_warnings():
        warnings.simplefilter("error", wavfile.WavFileWarning)
        rate, theirs = wavfile.read(path)
    theirs = theirs.reshape(101, channels) / (2.0**31 if depth == "24" else 1)
    assert rate == RATE
    # Half a step of 24 bits; single floats round by as much at full scale.
    np.testing.assert_allclose(theirs, samples, rtol=0, atol=0.5001 * STEP_24)
    np.testing.assert_array_equal(read_wav(path).read(), theirs)


@pytest.mark.parametrize("channels", [1, 2, 18, 300])
@pytest.mark.parametrize("depth", ["24", "float"])
def test_it_reads_back_with_head_and_comment(tmp_path, channels, depth):
    samples = noise(50, channels)
    read = read_wav(written(tmp_path / "a.wav", samples, depth, "µ = 1 V"))
    assert (read.rate_hz, read.channels, read.count, read.comment) == (RATE, channels, 50, "µ = 1 V")
    assert (read.kind, read.bits) == (("pcm", 24) if depth == "24" else ("float", 32))
    assert read.seconds == pytest.approx(50 / RATE)
    np.testing.assert_array_equal(read.read(10, 20), read.read()[10:20])
    np.testing.assert_array_equal(read.read()[:, channels - 1], read.read()[:, -1])
    assert sum(len(part) for part in read.data()) == 50 * channels * (3 if depth == "24" else 4)


@pytest.mark.parametrize("width", [1, 2, 3, 4])
def test_it_reads_pcm_of_the_standard_library(tmp_path, width):
    whole = np.random.default_rng(1).integers(-(2 ** (8 * width - 1)), 2 ** (8 * width - 1), (40, 2))
    raw = (whole + 128).astype(np.uint8).tobytes() if width == 1 else b""
    if width > 1:
        raw = whole.astype("<i4").view(np.uint8).reshape(-1, 4)[:, :width].tobytes()
    with wave.open(str(tmp_path / "a.wav"), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(width)
        file.setframerate(8000)
        file.writeframes(raw)
    read = read_wav(tmp_path / "a.wav")
    assert (read.rate_hz, read.kind, read.bits) == (8000, "pcm", 8 * width)
    np.testing.assert_array_equal(read.read(), whole / 2.0 ** (8 * width - 1))


@pytest.mark.parametrize("kind", ["u1", "i2", "i4", "f4", "f8"])
def test_it_reads_as_scipy_from_disk_and_from_memory(tmp_path, kind):
    whole = np.random.default_rng(2).integers(0, 256, (40, 3, 8), np.uint8).view("i8")[..., 0]
    samples = (whole / 2.0**64 if kind[0] == "f" else whole).astype("<" + kind)
    head = fmt(3 if kind[0] == "f" else 1, 3, bits=8 * samples.itemsize)
    raw = samples.tobytes()
    path = tmp_path / "a.wav"
    path.write_bytes(riff(head, (b"data", len(raw), raw)))
    np.testing.assert_array_equal(wavfile.read(path)[1], samples)
    middle, full = {"f": (0, 1.0), "u": (128, 128.0), "i": (0, 2.0 ** (8 * samples.itemsize - 1))}[kind[0]]
    for read in (read_wav(path), read_wav(path, path.read_bytes())):
        np.testing.assert_array_equal(read.read(), (samples.astype(float) - middle) / full)


@pytest.mark.parametrize("bits, width", [(12, 2), (20, 3), (16, 4), (20, 4), (24, 4)])
def test_integers_in_the_upper_part_of_a_word_are_read_as_scipy_does(tmp_path, bits, width):
    whole = np.random.default_rng(3).integers(-(2 ** (bits - 1)), 2 ** (bits - 1), 30) << (8 * width - bits)
    raw = whole.astype("<i8").view(np.uint8).reshape(-1, 8)[:, :width].tobytes()
    path = tmp_path / "a.wav"
    path.write_bytes(riff(fmt(bits=bits, frame=width), (b"data", len(raw), raw)))
    read = read_wav(path)
    theirs = wavfile.read(path)[1]
    assert (read.bits, read.width) == (bits, width)
    np.testing.assert_array_equal(read.read()[:, 0], whole / 2.0 ** (8 * width - 1))
    np.testing.assert_array_equal(read.read()[:, 0], theirs / 2.0 ** (8 * theirs.itemsize - 1))


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_it_reads_floats_of_scipy(tmp_path, kind):
    samples = noise(33, 3).astype(kind)
    wavfile.write(tmp_path / "a.wav", RATE, samples)
    np.testing.assert_array_equal(read_wav(tmp_path / "a.wav").read(), samples)


def test_the_same_samples_give_the_same_bytes(tmp_path):
    one = written(tmp_path / "a.wav", noise(99, 5), "24", "x", parts=1).read_bytes()
    assert one == written(tmp_path / "b.wav", noise(99, 5), "24", "x", parts=7).read_bytes()


def test_rounding_leaves_no_line_above_the_noise(tmp_path):
    # A sum 60 dB below full scale: rounding must not make lines of its own, though there is no dither.
    t = np.arange(RATE // 2) / RATE
    signal = 1e-3 * (np.cos(2 * np.pi * 60 * t) + np.cos(2 * np.pi * 78 * t + 1))
    read = read_wav(written(tmp_path / "a.wav", signal[:, None], "24")).read()[:, 0]
    lines = np.abs(np.fft.rfft(read)) / len(t) * 2
    lines[[30, 39]] = 0
    assert 20 * np.log10(lines.max() / 1e-3) < -110  # white: -60 - 141 + 60 + 10 dB


@pytest.mark.parametrize("depth, width", [("24", 3), ("float", 4)])
def test_sizes_fit_into_32_bits(depth, width):
    most = LARGEST_WAVE // (48 * width)
    head = wav_header(RATE, 48, most, depth)
    assert struct.unpack("<I", head[4:8])[0] == len(head) - 8 + most * 48 * width < 2**32
    with pytest.raises(FileError, match=r"would take 4 GB, at most 4 GB are written"):
        wav_header(RATE, 48, most + 1, depth)


def test_an_odd_number_of_bytes_is_padded(tmp_path):
    path = written(tmp_path / "a.wav", np.full((3, 1), 0.25), "24")
    assert path.stat().st_size % 2 == 0
    assert struct.unpack("<I", path.read_bytes()[4:8])[0] == path.stat().st_size - 8
    assert read_wav(path).count == 3


@pytest.mark.parametrize("value", [1.0, -1.0 - STEP_24, np.nan, np.inf])
def test_nothing_is_clipped(tmp_path, value):
    with pytest.raises(ValueError, match="clipped"), WavWriter(tmp_path / "a.wav", RATE, 1, 1, "24") as file:
        file.write(np.array([[value]]))


@pytest.mark.parametrize("value", [1.0001, -1.0001, np.nan])
def test_nor_floats_beyond_full_scale(tmp_path, value):
    with pytest.raises(ValueError, match="clipped"), WavWriter(tmp_path / "a.wav", RATE, 1, 1, "float") as file:
        file.write(np.array([[value]]))


@pytest.mark.parametrize(
    "channels, rate, sentence",
    [
        (0, RATE, "1 … 65535 channels, got 0"),
        (70000, RATE, "got 70000"),
        (30000, RATE, "at most"),
        (30000, 100, "at most 21845 channels at 100 Hz"),
    ],
)
def test_what_the_format_cannot_tell_is_refused(channels, rate, sentence):
    with pytest.raises(FileError, match=sentence):
        wav_header(rate, channels, 10, "24")


def riff(*chunks):
    body = b"WAVE" + b"".join(name + struct.pack("<I", size) + data for name, size, data in chunks)
    return b"RIFF" + struct.pack("<I", len(body)) + body


def fmt(code=1, channels=1, rate=RATE, bits=16, frame=None):
    frame = channels * bits // 8 if frame is None else frame
    return b"fmt ", 16, struct.pack("<HHIIHH", code, channels, rate, rate * frame, frame, bits)


DATA = (b"data", 4, b"\1\0\2\0")


@pytest.mark.parametrize(
    "raw, sentence",
    [
        (b"", "is empty"),
        (b"RIFF", "is not a WAV file"),
        (b"ID3\4" + b"\0" * 60, "is not a WAV file"),
        (riff(), "it has no format"),
        (riff(fmt()), "it has no samples"),
        (riff(DATA), "it has no format"),
        (riff((b"fmt ", 8, b"\0" * 8), DATA), "format of 8 bytes"),
        (riff(fmt(channels=0, frame=2), DATA), "0 channels"),
        (riff(fmt(rate=0), DATA), "at 0 Hz"),
        (riff(fmt(code=2, bits=4), DATA), "format 0x0002 and 4 bits"),
        (riff(fmt(code=0xFFFE), DATA), "format 0xfffe"),
        (riff(fmt(code=3, bits=16), DATA), "format 0x0003 and 16 bits"),
        (riff(fmt(frame=3), DATA), "1 channels of 16 bits in 3 bytes"),
        (riff(fmt(), (b"data", 400, b"\0" * 4)), "cut off: it has 2 of the 200 samples"),
        (riff(fmt(), (b"data", 3, b"\0" * 4)), "3 bytes of samples, not whole samples"),
        (riff(fmt(), (b"data", 0xFFFFFFFF, b"\0" * 4)), "cut off"),
        (riff((b"junk", 4000, b"\0" * 4), fmt(), DATA), "it has no format"),
    ],
)
def test_broken_files_are_refused_with_a_sentence(tmp_path, raw, sentence):
    path = tmp_path / "a.wav"
    path.write_bytes(raw)
    with pytest.raises(FileError, match=sentence) as caught:
        read_wav(path)
    assert "a.wav" in str(caught.value)


@pytest.mark.parametrize(("where", "sentence"), [("nowhere.wav", "there is no such file"), (".", "cannot be read")])
def test_what_is_no_file_is_refused(tmp_path, where, sentence):
    with pytest.raises(FileError, match=sentence):
        read_wav(tmp_path / where)


@pytest.mark.parametrize("chunk", [(b"junk", 3, b"abc\0"), (b"LIST", 5, b"INFOx\0"), (b"fact", 0, b"")])
def test_chunks_of_odd_length_are_passed_over(tmp_path, chunk):
    path = tmp_path / "a.wav"
    path.write_bytes(riff(chunk, fmt(), DATA, (b"id3 ", 2, b"xy")))
    np.testing.assert_array_equal(read_wav(path).read()[:, 0], [1 / 2**15, 2 / 2**15])


def test_a_file_without_samples_is_read(tmp_path):
    path = written(tmp_path / "a.wav", np.zeros((0, 4)), "float", parts=1)
    assert read_wav(path).read().shape == (0, 4)
    assert len(read_wav(path).read()[:, 2]) == 0


@pytest.mark.parametrize("cut", range(0, 130, 7))
def test_a_file_cut_anywhere_is_refused(tmp_path, cut):
    path = written(tmp_path / "a.wav", noise(10, 3), "float", "comment")
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(FileError):
        read_wav(path)


def test_a_folder_that_is_not_there_cannot_be_written(tmp_path):
    with pytest.raises(FileError, match="cannot be written"), WavWriter(tmp_path / "no" / "a.wav", RATE, 1, 0, "24"):
        pass


def test_a_head_that_takes_minutes_to_walk_through_is_refused(tmp_path):
    path = tmp_path / "a.wav"
    with path.open("wb") as file:
        file.write(b"RIFF\0\0\0\0WAVE")
        file.truncate(10**10)
    with pytest.raises(FileError, match="is damaged: a WAV file has a few parts, this one more than 1000"):
        read_wav(path)


def test_pipes_and_devices_are_no_wav_files(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for place in (tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(FileError, match="cannot be read"):
            read_wav(place)
