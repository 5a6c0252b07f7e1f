"""Reading measurements: each kind against the print that made it, and every bad file against its message.

| figure | reference | tolerance | reason |
|---|---|---|---|
| f by every kind of file | the print's own | 4 sigma, and 1 % | noise of 30 dB |
| response by absolute files | the print's own | 4 sigma, and 10 % | as above |
| complex columns of every form | re and im | 1e-9 | the same numbers in another form |
| current by voltage and R, L | current itself | 0.3 % of f, 5 % of response | straight lines between samples |
"""

import io
import os
import struct
import tracemalloc
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from random import Random

import numpy as np
import pytest
from scipy.io import wavfile

import padgen as pg
from padgen.core import files
from padgen.core.errors import FileError, PadgenError
from padgen.measured.fits import fit_measured
from padgen.measured.read import read_measured, read_measured_text
from padgen.planner import Plan
from padgen.spec import parse_spec
from tests.recordings import TWO_COILS

RATE = 2000.0
PRINT = {"r0c0k0": (62.0, 14.0, 900.0), "r0c0k1": (91.0, 17.0, 400.0)}
"""Resonance in Hz, Q, and response in µm per A² of the measured print."""


@pytest.fixture(scope="module")
def plan() -> Plan:
    """A plan of two coils of two channels, at 60 and 90 Hz."""
    return pg.plan(parse_spec(TWO_COILS))


def spectrum(taxel, frequency):
    hz, q, response = PRINT[taxel]
    s = frequency / hz
    clean = response / (q * (1 - s * s) + 1j * s)
    rng = np.random.default_rng(len(taxel) + int(hz))
    return clean + response / 31.6 / np.sqrt(2) * (rng.standard_normal(len(s)) + 1j * rng.standard_normal(len(s)))


FREQUENCY = np.linspace(30.0, 180.0, 240)


def table(heading, *columns):
    rows = "\n".join(",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True))
    return f"{heading}\n{rows}\n"


def complex_text(unit="# unit: um_per_a2\n", scale=1.0, shift=1.0):
    one, two = (spectrum(taxel, FREQUENCY) for taxel in PRINT)
    heading = unit + "frequency_hz,r0c0k1_im,r0c0k0_re,r0c0k0_im,r0c0k1_re"
    return table(heading, scale * FREQUENCY * shift, two.imag, one.real, one.imag, two.real)


def decays():
    time = np.arange(int(0.5 * RATE)) / RATE
    rng = np.random.default_rng(3)
    y = [np.exp(-np.pi * hz / q * time) * np.cos(2 * np.pi * hz * time) for hz, q, _ in PRINT.values()]
    return time, [own + 0.02 * rng.standard_normal(len(time)) for own in y]


def driven(power=0, seed=4):
    """Return time, current, and both taxels' motion (its `power`-th derivative), by the receptance at lines of i²."""
    time = np.arange(int(3 * RATE)) / RATE
    phase = 2 * np.pi * (10 * time + 20 * time**2)
    current = 0.2 * np.sin(phase / 2 + 0.1) * np.minimum(1, 10 * (3 - time))
    frequency = np.fft.rfftfreq(2 * len(time), 1 / RATE)
    rng = np.random.default_rng(seed)
    moved = []
    for hz, q, response in PRINT.values():
        s = frequency / hz
        answer = response / (q * (1 - s * s) + 1j * s) * (2j * np.pi * frequency) ** power
        y = np.fft.irfft(np.fft.rfft(current**2, 2 * len(time)) * answer)[: len(time)]
        moved.append(y + 0.03 * np.abs(y).max() * rng.standard_normal(len(y)))
    return time, current, moved


def check(fits, absolute, names=tuple(PRINT)):
    assert [fit.id for fit in fits] == list(names)
    for fit in fits:
        hz, _, response = PRINT[fit.id]
        assert abs(fit.resonance_hz - hz) < min(4 * fit.resonance_error_hz, 0.01 * hz)
        assert fit.agree
        if absolute:
            assert abs(fit.response_um_per_a2 - response) < min(4 * fit.response_error, 0.1 * response)
        else:
            assert fit.response_um_per_a2 is None


def test_spectra(plan):
    measured = read_measured_text(complex_text(), plan)
    assert [part.id for part in measured.taxels] == ["r0c0k0", "r0c0k1"]
    fits = fit_measured(measured, plan)
    check(fits, absolute=True)
    assert [m.method for m in fits[0].methods] == ["least squares", "circle"]
    assert fits[0].snr_db == pytest.approx(30, abs=1.5)
    check(fit_measured(read_measured_text(complex_text(unit=""), plan), plan), absolute=False)


@pytest.mark.parametrize("form", ["{0}_mag,{0}_deg", "{0},{0}_deg", "{0}_db,{0}_deg"])
def test_forms_of_complex_columns(plan, form):
    data = spectrum("r0c0k0", FREQUENCY)
    size = 20 * np.log10(np.abs(data)) if "db" in form else np.abs(data)
    text = table("frequency_hz," + form.format("r0c0k0"), FREQUENCY, size, np.degrees(np.angle(data)))
    read = read_measured_text(text, plan).taxels[0].response
    assert read == pytest.approx(data, rel=1e-7, abs=1e-7)


@pytest.mark.parametrize("name", ["r0c0k0", "r0c0k0_mag"])
def test_magnitudes_and_a_line_at_0_hz(plan, name):
    size = np.abs(spectrum("r0c0k0", FREQUENCY))
    text = table(f"frequency_hz,{name}", np.concatenate([[0], FREQUENCY]), np.concatenate([[5], size]))
    check(fit_measured(read_measured_text("# unit: um_per_a2\n\n" + text, plan), plan), True, ("r0c0k0",))


def test_time_series_of_decays(plan):
    time, (one, two) = decays()
    measured = read_measured_text(table("r0c0k0,time_s,r0c0k1", one, time, two), plan)
    check(fit_measured(measured, plan), absolute=False)


def test_driven_time_series_by_current_and_by_voltage(plan):
    time, current, (one, two) = driven()
    text = table("# unit: um\ntime_s,current_a,r0c0k0,r0c0k1", time, current, one, two)
    measured = read_measured_text(text, plan)
    by_current = fit_measured(measured, plan)
    check(by_current, absolute=True)
    coil = plan.spec.coil
    volts = coil.resistance_ohm * current + coil.inductance_mh * 1e-3 * np.gradient(current, 1 / RATE)
    text = table("# unit: um\ntime_s,voltage_v,r0c0k0", time, volts, one)
    by_voltage = fit_measured(read_measured_text(text, plan), plan)[0]
    assert by_voltage.resonance_hz == pytest.approx(by_current[0].resonance_hz, rel=3e-3)
    assert by_voltage.response_um_per_a2 == pytest.approx(by_current[0].response_um_per_a2, rel=0.05)


def test_a_current_that_only_changes_sign_excites_magnets(plan):
    """A pseudo-random binary current, of constant square: magnets hear the current itself, steel hears nothing."""
    magnets = pg.plan("magnet-6")
    name = magnets.taxels[0].id
    hz = 1.02 * magnets.channels[magnets.taxels[0].channel].resonance_hz
    q = 14.0
    response = 900.0
    time = np.arange(int(3 * RATE)) / RATE
    current = np.repeat(np.random.default_rng(5).choice([-0.1, 0.1], len(time) // 4), 4)
    frequency = np.fft.rfftfreq(2 * len(time), 1 / RATE)
    s = frequency / hz
    answer = response / (q * (1 - s * s) + 1j * s)
    moved = np.fft.irfft(np.fft.rfft(current, 2 * len(time)) * answer)[: len(time)]
    text = table(f"# unit: um\ntime_s,current_a,{name}", time, current, moved)
    (fit,) = fit_measured(read_measured_text(text, magnets), magnets)
    assert fit.resonance_hz == pytest.approx(hz, rel=2e-3)
    assert fit.q == pytest.approx(q, rel=0.05)
    with pytest.raises(FileError, match=r"0\.1 throughout"):
        read_measured_text(text.replace(name, "r0c0k0"), plan)


def test_table(plan):
    text = "taxel,resonance_hz,q,resonance_error_hz,level_um,line_a2\nr0c0k1,91,17,0.2,40,0.1\nr0c0k0,62,,,,\n"
    one, two = fit_measured(read_measured_text(text, plan), plan)
    assert (one.id, one.resonance_hz, one.q, one.q_measured) == ("r0c0k0", 62, plan.channels[0].q, False)
    assert (two.resonance_error_hz, two.q, two.response_um_per_a2, two.q_measured) == (0.2, 17, 400, True)
    assert (one.q_error, one.resonance_error_hz) == pytest.approx((0.3 * one.q, 0.05 * 62 / one.q))


def wav(samples, rate=int(RATE)):
    out = io.BytesIO()
    wavfile.write(out, rate, samples)
    return out.getvalue()


def four(columns):
    """Return channels of all four taxels of the plan, with the second coil's equal to the first's."""
    return np.stack([*columns, *columns], axis=1)


@pytest.mark.parametrize("kind", ["float32", "int16", "int32"])
def test_wav_of_decays(plan, tmp_path, kind):
    samples = 0.5 * four(decays()[1])
    full = 1.0 if kind == "float32" else np.iinfo(kind).max
    path = tmp_path / "m.wav"
    path.write_bytes(wav((samples * full).astype(kind)))
    check(fit_measured(read_measured(path, plan), plan)[:2], absolute=False)


@pytest.mark.parametrize("excitation", ["current", "voltage"])
def test_driven_wav(plan, tmp_path, excitation):
    _, current, columns = driven()
    coil = plan.spec.coil
    volts = coil.resistance_ohm * current + coil.inductance_mh * 1e-3 * np.gradient(current, 1 / RATE)
    first = current if excitation == "current" else volts
    samples = np.concatenate([first[:, None], four(columns)], axis=1)
    path = tmp_path / "m.wav"
    path.write_bytes(wav((samples / np.abs(samples).max(0) * 0.9).astype(np.float32)))
    measured = read_measured(path, plan, excitation)
    check(fit_measured(measured, plan)[:2], absolute=False)


def test_folder(plan, tmp_path):
    data = spectrum("r0c0k0", FREQUENCY)
    text = table("# unit: um_per_a2\nfrequency_hz,response_re,response_im", FREQUENCY, data.real, data.imag)
    (tmp_path / "r0c0k0.csv").write_text(text)
    (tmp_path / "r0c0k1.wav").write_bytes(wav((0.5 * decays()[1][1]).astype(np.float32)))
    (tmp_path / "notes.txt").write_text("of no account")
    measured = read_measured(tmp_path, plan)
    assert [part.where for part in measured.taxels] == [str(tmp_path / n) for n in ("r0c0k0.csv", "r0c0k1.wav")]
    one, two = fit_measured(measured, plan)
    check([one], True, ("r0c0k0",))
    check([two], False, ("r0c0k1",))
    (tmp_path / "more").mkdir()
    (tmp_path / "r0c0k1.wav").rename(tmp_path / "more" / "r0c0k1.wav")
    for apart in ([tmp_path / "r0c0k0.csv", tmp_path / "more"], [tmp_path / "more", tmp_path / "r0c0k0.csv"]):
        assert fit_measured(read_measured(apart, plan), plan) == (one, two)


def test_frequencies_of_the_current(plan):
    halved = complex_text(shift=0.5)
    with pytest.raises(FileError, match=r"half of it as for nearly all taxels.*say '# frequency: drive'"):
        fit_measured(read_measured_text(halved, plan), plan)
    check(fit_measured(read_measured_text("# frequency: drive\n" + halved, plan), plan), absolute=True)
    kept = fit_measured(read_measured_text("# frequency: motion\n" + halved, plan), plan)
    assert kept[0].resonance_hz == pytest.approx(31, rel=0.01)


def test_nearest_of_two_peaks(plan):
    both = spectrum("r0c0k0", FREQUENCY) / 900 + spectrum("r0c0k1", FREQUENCY) / 400
    measured = read_measured_text(
        table("frequency_hz,r0c0k1_re,r0c0k1_im", FREQUENCY, both.real, both.imag), plan, "two.csv"
    )
    with pytest.raises(FileError, match=r"^two.csv, r0c0k1: has two peaks, at 6[12][.\d]* and 9[01]"):
        fit_measured(measured, plan)
    assert fit_measured(measured, plan, nearest=True)[0].resonance_hz == pytest.approx(91, rel=0.01)


def test_all_taxels_without_a_resonance_are_named(plan):
    rng = np.random.default_rng(5)
    text = table("frequency_hz,r0c0k0,r0c0k1", FREQUENCY, *np.abs(rng.standard_normal((2, len(FREQUENCY)))))
    with pytest.raises(FileError, match=r"r0c0k0: .*\(1 more cannot be fitted: r0c0k1\)"):
        fit_measured(read_measured_text(text, plan), plan)


def line_of(text, line, new):
    lines = text.split("\n")
    lines[line - 1] = new(lines[line - 1])
    return "\n".join(lines)


GOOD = table("frequency_hz,r0c0k0", FREQUENCY, np.abs(spectrum("r0c0k0", FREQUENCY)))
TIME = table("time_s,r0c0k0", decays()[0], decays()[1][0])
HEAD = "taxel,resonance_hz,q\n"
BAD_TEXTS = {
    "empty": ("", "is empty"),
    "heading alone": ("frequency_hz,r0c0k0\n", "no lines of numbers"),
    "no heading": ("30,1\n31,2\n", "has no headings: the first line is '30,1'"),
    "semicolons": (GOOD.replace(",", ";"), "separated by semicolons"),
    "khz heading": (GOOD.replace("frequency_hz", "frequency_khz"), "must be in Hz"),
    "nan": (line_of(GOOD, 7, lambda x: x.split(",")[0] + ",nan"), "line 7, column 'r0c0k0' must be a finite number"),
    "word": (line_of(GOOD, 9, lambda x: "abc," + x.split(",")[1]), "line 9, column 'frequency_hz' .* got 'abc'"),
    "cut off": (line_of(GOOD, 241, lambda x: x[:3]), "line 241 has 1 columns, the headings 2; is the file cut off"),
    "not rising": (
        line_of(GOOD, 5, lambda x: "3," + x.split(",")[1]),
        "line 5, column 'frequency_hz' must .* rise, got 3",
    ),
    "swapped": (
        table("frequency_hz,r0c0k0", np.abs(spectrum("r0c0k0", FREQUENCY)), FREQUENCY),
        "column 'r0c0k0' does: are the two swapped",
    ),
    "no such taxel": (GOOD.replace("r0c0k0", "r0c0k7"), "'r0c0k7' is no taxel of 't'.*; the nearest is 'r0c0k"),
    "twice": (GOOD.replace("frequency_hz,r0c0k0", "frequency_hz,frequency_hz"), "2 columns named 'frequency_hz'"),
    "no taxel": (table("frequency_hz", FREQUENCY), "has no taxel's column, such as 'r0c0k0'"),
    "re alone": (GOOD.replace("r0c0k0", "r0c0k0_re"), "r0c0k0 must have one column .* it has r0c0k0_re"),
    "negative": (line_of(GOOD, 4, lambda x: x.split(",")[0] + ",-3"), "line 4, column 'r0c0k0' is a magnitude .* -3"),
    "unit": ("# unit: mm\n" + GOOD, "'# unit:' must be um_per_a2, .* or relative, got 'mm'"),
    "frequency note": ("# frequency: khz\n" + GOOD, "must be drive or motion, got 'khz'"),
    "khz": (table("frequency_hz,r0c0k0", FREQUENCY / 1000, np.abs(spectrum("r0c0k0", FREQUENCY))), "look like kHz"),
    "edge": (
        table("frequency_hz,r0c0k0", FREQUENCY[54:], np.abs(spectrum("r0c0k0", FREQUENCY[54:]))),
        r"r0c0k0: the res.* lower end of the sweep, 63.\d+ Hz; start the sweep at \d+",
    ),
    "time back": (line_of(TIME, 9, lambda x: "0," + x.split(",")[1]), "line 9, column 'time_s' must rise, got 0"),
    "gap": (line_of(TIME, 1001, lambda x: "0.9," + x.split(",")[1]), "must go in even steps of 0.0005 s"),
    "ms": (table("time_s,r0c0k0", 1000 * decays()[0], decays()[1][0]), "look like ms"),
    "both": (table("time_s,current_a,voltage_v,r0c0k0", *[decays()[0]] * 3, decays()[1][0]), "leave one out"),
    "no current": (table("time_s,current_a,r0c0k0", decays()[0], 0 * decays()[0], decays()[1][0]), "0 throughout"),
    "table column": ("taxel,resonance_hz,Q\nr0c0k0,60,15\n", "a table has no column 'Q'"),
    "table taxel": (HEAD + "r9c0k0,60,15\n", "line 2: 't' has no taxel 'r9c0k0'; the nearest is"),
    "table twice": (HEAD + "r0c0k0,60,15\nr0c0k0,61,15\n", "line 3 is a second line of r0c0k0"),
    "table negative": (HEAD + "r0c0k0,-60,15\n", "line 2, column 'resonance_hz' must be above 0"),
    "table empty": (HEAD + "r0c0k0,,15\n", "'resonance_hz' is empty"),
    "table short": (HEAD + "r0c0k0,60\n", "line 2 has 2 columns, the headings 3"),
    "table level": ("taxel,resonance_hz,level_um\nr0c0k0,60,10\n", "'level_um' and 'line_a2' .* must stand together"),
    "table swapped": (HEAD + "r0c0k0,15,61\nr0c0k1,16,88\n", "look swapped: r0c0k0 has a q of 61"),
    "table khz": ("taxel,resonance_hz\nr0c0k0,0.061\n", "look like kHz; multiply them by 1000"),
}


@pytest.mark.parametrize("name", BAD_TEXTS)
def test_bad_texts(plan, name):
    text, sentence = BAD_TEXTS[name]
    with pytest.raises(FileError, match=sentence) as info:
        fit_measured(read_measured_text(text, plan, "m.csv"), plan)
    assert str(info.value).startswith("m.csv")


WAVES = wav((0.5 * four(decays()[1])).astype(np.float32))
BAD_WAVES = {
    "mono": (wav((0.5 * decays()[1][0]).astype(np.float32)), "is mono, must have 4"),
    "two": (wav((0.5 * four(decays()[1]))[:, :2].astype(np.float32)), "has 2 channels, must have 4"),
    "cut off": (WAVES[:4000], "is cut off"),
    "cut off within a sample": (WAVES[:4003], "is cut off"),
    "cut off in the head": (WAVES[:30], "is cut off or damaged, not a WAV file"),
    "head alone": (WAVES[:58], "is cut off"),
    "damaged": (WAVES.replace(b"data", b"dada", 1), "is cut off or damaged, not a WAV file"),
    "no wav": (b"hello, this is a text\n" * 9, "is not a WAV file that can be read"),
    "nan": (wav(np.full((100, 4), np.nan, np.float32)), "channel 1 has no finite number at sample 1"),
    "clipped": (wav(np.full((100, 4), 32767, np.int16)), "channel 1 is clipped at sample 1"),
    "silent current": (wav(np.zeros((100, 5), np.float32)), "channel 1, the excitation, is 0 throughout"),
    "silence": (wav(np.zeros((100, 4), np.float32)), r"channel 1 \(r0c0k0\): is 0 throughout"),
    "empty": (wav(np.zeros((0, 4), np.float32)), "holds 0 samples"),
}


@pytest.mark.parametrize("name", BAD_WAVES)
def test_bad_waves(plan, tmp_path, name):
    data, sentence = BAD_WAVES[name]
    path = tmp_path / "m.wav"
    path.write_bytes(data)
    with pytest.raises(FileError, match=sentence) as info:
        fit_measured(read_measured(path, plan), plan)
    assert str(info.value).startswith(str(path))


def test_24_bits_at_full_scale_are_clipped(plan, tmp_path):
    data = b"\xff\xff\x7f" * 400
    form = struct.pack("<IHHIIHH", 16, 1, 4, 2000, 24000, 12, 24)
    path = tmp_path / "m.wav"
    head = b"RIFF" + struct.pack("<I", 36 + len(data)) + b"WAVEfmt " + form
    path.write_bytes(head + b"data" + struct.pack("<I", len(data)) + data)
    with pytest.raises(FileError, match="clipped"):
        read_measured(path, plan)


def test_bad_places(plan, tmp_path):
    with pytest.raises(FileError, match="there is no such file or folder"):
        read_measured(tmp_path / "none.csv", plan)
    with pytest.raises(FileError, match=r"holds no CSV or WAV file named after a taxel, such as r0c0k0.csv"):
        read_measured(tmp_path, plan)
    (tmp_path / "m.csv").write_bytes(b"frequency_hz,r0c0k0\n\xff\xfe")
    with pytest.raises(FileError, match="byte 20 is not UTF-8"):
        read_measured(tmp_path / "m.csv", plan)
    with pytest.raises(FileError, match="must be named after a taxel of 't', 'm' is none"):
        read_measured(tmp_path, plan)
    with pytest.raises(PadgenError, match="must be current or voltage, got 'power'"):
        (tmp_path / "m.wav").write_bytes(WAVES)
        read_measured(tmp_path / "m.wav", plan, "power")


def test_bad_folders(plan, tmp_path):
    (tmp_path / "r0c0k0.csv").write_text(HEAD + "r0c0k0,60,15\n")
    with pytest.raises(FileError, match="is a table, which has all taxels in one file"):
        read_measured(tmp_path, plan)
    (tmp_path / "r0c0k0.csv").write_text(GOOD)
    (tmp_path / "r0c0k0.wav").write_bytes(wav(decays()[1][0].astype(np.float32)))
    with pytest.raises(FileError, match="is a second file of r0c0k0"):
        read_measured(tmp_path, plan)
    (tmp_path / "r0c0k0.wav").unlink()
    (tmp_path / "r0c0k0.csv").write_text(GOOD.replace("r0c0k0", "r0c0k1"))
    with pytest.raises(FileError, match="column 'r0c0k1' is no taxel"):
        read_measured(tmp_path, plan)


def test_silence_around_a_coils_turn_changes_nothing(plan):
    """A record of the whole excitation gives the same fit as the part in which the coil has its turn."""
    apart = []
    for seed in range(4, 12):
        time, current, (one, _) = driven(seed=seed)
        whole = read_measured_text(table("# unit: um\ntime_s,current_a,r0c0k0", time, current, one), plan)
        (first,) = whole.taxels
        pause = np.zeros(round(4 * first.rate_hz))
        noise = np.random.default_rng(seed).standard_normal((2, len(pause))) * first.displacement.std() / 100
        longer = replace(
            first,
            squared_current_a2=np.concatenate([pause, first.squared_current_a2, pause]),
            current_a=np.concatenate([pause, first.current_a, pause]),
            displacement=np.concatenate([noise[0], first.displacement, noise[1]]),
        )
        alone, padded = (fit_measured(replace(whole, taxels=(part,)), plan)[0] for part in (first, longer))
        apart.append((padded.resonance_hz - alone.resonance_hz) / alone.resonance_error_hz)
        assert padded.resonance_error_hz == pytest.approx(alone.resonance_error_hz, rel=0.3)
    # The data of the turn are the same, its ends are cut a little differently: half a sigma, 0.3 over many seeds.
    assert np.sqrt(np.mean(np.square(apart))) < 0.5


def test_no_rate_and_no_length_takes_more_memory_than_the_data(plan, tmp_path):
    _, current, moved = driven()
    path = tmp_path / "r0c0k0.wav"
    data = bytearray(wav((0.9 * np.stack([current, moved[0] / np.abs(moved[0]).max()], 1)).astype(np.float32)))
    for rate in (1, 17, 48_000, 10**6, 2**32 - 1):
        data[24:28] = struct.pack("<I", rate)
        path.write_bytes(data)
        sentence = ""
        tracemalloc.start()
        try:
            fit_measured(read_measured(tmp_path, plan), plan)
        except FileError as error:
            sentence = str(error)
        assert tracemalloc.get_traced_memory()[1] < 3e7
        tracemalloc.stop()
        assert rate in (17, 48_000) or "sampling rate" in sentence


VAST = {
    "characters": ("time_s,r0c0k0\n" + f"0,{'1' * 97}\n" * 700_000, "has 70 million characters, at most 67 million"),
    "lines": ("time_s,r0c0k0\n" + "\n" * 2_100_000, "has 2100001 lines, at most 1000000 are read"),
    "line": ("time_s,r0c0k0\n" + "," * 5_000_000, "line 2 has 5000000 characters, at most 4194304 are read"),
    "heading": (",".join(f"a{k}" for k in range(200_000)) + ",time_s\n1,2\n", "column 'a0' is no taxel"),
    "name": (f"taxel,resonance_hz\n{'r' * 1_000_000},60\n", "line 2: 't' has no taxel"),
    "huge": ("time_s,r0c0k0\n" + "".join(f"{k},{k % 7}e300\n" for k in range(99)), "at most 1e.30, got '1e300'"),
    "tiny": ("time_s,r0c0k0\n" + "".join(f"{k / 2000},{k % 7}e-300\n" for k in range(99)), "is 0 throughout"),
    "tiny current": (
        "time_s,current_a,r0c0k0\n" + "".join(f"{k / 2000},{k % 7}e-200,{k % 5}\n" for k in range(99)),
        "column 'current_a' is 0 throughout",
    ),
    "square": (
        "time_s,current_a,r0c0k0\n" + "".join(f"{k / 2000},{(-1) ** k},{k % 5}\n" for k in range(99)),
        "column 'current_a' is 1 throughout",
    ),
    "huge q": ("taxel,resonance_hz,q\nr0c0k0,60,1e20\n", "column 'q' must be above 0.5 and at most 1e.09"),
}


@pytest.mark.parametrize("name", VAST)
def test_vast_texts(plan, name):
    text, sentence = VAST[name]
    tracemalloc.start()
    with pytest.raises(FileError, match=sentence):
        fit_measured(read_measured_text(text, plan), plan)
    assert tracemalloc.get_traced_memory()[1] < 3e8
    tracemalloc.stop()


def test_places_that_hold_no_measurement(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(files, "LONGEST_PIPE_S", 0.1)
    with (tmp_path / "r0c0k0.wav").open("wb") as file:
        file.truncate(10**10)
    os.mkfifo(tmp_path / "pipe")
    for place, sentence in (
        (tmp_path / "r0c0k0.wav", "too large for a measurement: at most 268435456 bytes"),
        (tmp_path, "too large for a measurement: at most 268435456 bytes"),
        (tmp_path / "pipe", "did not end within"),
        (Path("/dev/zero"), "it is a device"),
        (tmp_path / ("a" * 5000), "name too long"),
    ):
        with pytest.raises(FileError, match=sentence):
            read_measured(place, plan)


def test_many_chunks_are_no_wav(plan, tmp_path):
    path = tmp_path / "m.wav"
    path.write_bytes(b"RIFF\0\0\0\0WAVE" + b"junk\0\0\0\0" * 2000)
    with pytest.raises(FileError, match="this one more than 1000"):
        read_measured(path, plan)


def test_samples_of_every_width_are_read_alike(plan, tmp_path):
    whole = np.round(100 * four(decays()[1])).astype(int)
    path = tmp_path / "m.wav"
    for samples, full in (
        ((whole + 128).astype(np.uint8), 2.0**7),
        (whole.astype(np.int16), 2.0**15),
        (whole.astype(np.int32), 2.0**31),
        (whole.astype(np.float32), 1.0),
    ):
        path.write_bytes(wav(samples))
        for k, part in enumerate(read_measured(path, plan).taxels):
            assert (part.displacement * full == whole[:, k]).all()


def test_damaged_bytes_of_measurements_end_in_a_sentence_or_a_fit(plan, tmp_path):
    rng = Random(0)
    path = tmp_path / "m.wav"
    short = wav((0.5 * four(decays()[1]))[:400].astype(np.int16))
    text = (HEAD + "r0c0k0,57.5,14\nr0c0k1,93.5,15\n").encode()
    series = table("time_s,r0c0k0", *(column[:60] for column in (decays()[0], decays()[1][0]))).encode()
    for k in range(300):
        good = (short, text, series)[k % 3]
        spoilt = bytearray(good[: rng.choice((len(good), rng.randrange(len(good))))] or b"R")
        for _ in range(rng.choice((1, 3, 20))):
            at = rng.randrange(min(len(spoilt), 80))
            spoilt[at] = rng.choice((0, 0xFF, 0x80, rng.randrange(256), *b",.\n-+e9#"))
        path.write_bytes(spoilt)
        with suppress(PadgenError):
            fit_measured(read_measured(path, plan), plan)


@pytest.mark.parametrize("power", [1, 2])
def test_the_level_of_any_sensor_is_that_of_displacement(plan, power):
    time, current, moved = driven(power)
    text = table("time_s,current_a,r0c0k0,r0c0k1", time, current, *moved)
    check(fit_measured(read_measured_text(text, plan), plan), absolute=False)
    unit = ("um_per_s", "um_per_s2")[power - 1]
    check(fit_measured(read_measured_text(f"# unit: {unit}\n{text}", plan), plan), absolute=True)
    with pytest.raises(FileError, match="must be displacement, velocity, acceleration, got 'ear'"):
        read_measured_text(f"# sensor: ear\n{text}", plan)
