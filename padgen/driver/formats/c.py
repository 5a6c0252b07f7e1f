"""A pad's drive as C: the header `pad_drive.h` of numbers, and the firmware that plays it.

Phases are 32-bit shares of a turn that a sample moves on by a whole increment, so that a frequency is off by at
most rate/2³³: 0.003 mHz at 24 kHz. They begin anew with every period of the comb, a whole number of samples:
after an hour as after the first period no phase is off by more than period_samples/2³³ of a turn.
"""

import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from math import ceil, exp, expm1, floor, inf, log2, pi
from pathlib import Path
from textwrap import fill
from typing import Any
from zlib import crc32

import numpy as np

from padgen.core.errors import Finding, SpecError, number
from padgen.core.files import OutputFolder
from padgen.core.units import COPPER_C
from padgen.driver.excitation import FirmwareSweep, sweep_table
from padgen.driver.formats import DriveJob
from padgen.driver.loads import (
    channels_per_group,
    channels_per_signed_group,
    judge_limits,
    least_constants,
    least_thermal_time_s,
    signed_constants,
)
from padgen.driver.serial_line import HOLD_WATCHDOGS, plan_hash
from padgen.driver.waveform import CONTROLLER_RATES_HZ, CoilDrive, PadDrive, drive_at, frame_s, ramp_s
from padgen.measured.tuning import Tuning, tuning_hash
from padgen.physics.selectivity import Scheme
from padgen.planner.limits import limits
from padgen.planner.plan import Plan
from padgen.spec import catalogue

__all__ = [
    "FILE",
    "MADE_OF",
    "ORDER",
    "SCHEME_NUMBERS",
    "boards_in_time",
    "c_header",
    "firmware_files",
    "sample_mhz",
    "write",
]

ORDER = 2
MADE_OF = "host"
FILE = "pad_drive.h"
FIRMWARE = Path(__file__).with_name("firmware")
NAMES = {"README.md": "padgen_firmware.md"}
"""Names of files in a pad's folder, where they differ."""
SCHEME_NUMBERS = {"tones": 0, "spur-free": 1, "biased": 2, "time-shared": 3, "linear": 4}
LEAST_WATCHDOG_S = 1.0
WATCHDOG_FRAMES = 2
HEADER = 3
"""Version of what header and firmware expect of each other."""
ROOT_CLOCKS = (300, 370, 50)
CLOCKS = (200, 320, 95)
WAVE_CLOCKS = 125
"""Clocks of a Cortex-M4 with floating-point unit that a sample takes at most, for each spur-free or other sample, coil
and taxel, and for each sine with its slope: they bound what `docs/measure_firmware.py` counts; compilers differ."""
CLOCK_SHARE = 2 / 3
"""Share of a board's clock that samples may take; the rest is for converters, the line and waiting for memory."""
MICRO = 1e-6
SMALL = 1e-4
MOST_SAMPLES = (1 << 32) - 1
"""Largest value of the firmware's counters."""
TURN = 1 << 32
NO_TAXEL = 0xFFFF


def write(out: OutputFolder, job: DriveJob) -> None:
    """Write the C header and the firmware, with findings on limits that the worst frames from a host would exceed."""
    request = job.request
    drive = drive_at(job.plan, CONTROLLER_RATES_HZ, request.rate_hz, request.tuning, request.carrier_hz)
    drive = replace(drive, corner_hz=0.0)  # a microcontroller's converters are no sound card's outputs
    job.findings += judge_limits(FILE, job.plan, drive, tuning=request.tuning)
    if not boards_in_time(drive):
        load_note = (
            f"takes up to {number(round(sample_mhz(drive)))} MHz of a Cortex-M4's clock at {drive.rate_hz} samples/s"
        )
        job.findings += (
            Finding("warning", "firmware.time", FILE, f"{load_note}; no board of the catalogue makes them in time"),
        )
    out.write(FILE, c_header(job.plan, drive, request.tuning))
    for name, data in firmware_files().items():
        out.write(name, data)


def sample_mhz(drive: PadDrive) -> float:
    """Return an upper bound, in MHz, of the clock rate that a Cortex-M4 needs to compute the samples of a drive."""
    each, coil, taxel = ROOT_CLOCKS if drive.scheme.is_root else CLOCKS
    kinds = {
        coil_drive.harmonic.tobytes() + coil_drive.line_a2.tobytes() + coil_drive.phase_rad.tobytes(): coil_drive
        for coil_drive in drive.coils
    }
    waves, taxels = (sum(len(coil_drive.taxels) for coil_drive in coils) for coils in (kinds.values(), drive.coils))
    return (each + coil * len(drive.coils) + taxel * taxels + WAVE_CLOCKS * waves) * drive.rate_hz * MICRO


def boards_in_time(drive: PadDrive) -> list[str]:
    """Return the names of catalogue boards that are fast enough to compute the samples of a drive."""
    boards = catalogue("board").items()
    needed = sample_mhz(drive) / CLOCK_SHARE
    return [name for name, board in boards if board["clock_mhz"] >= needed]


def firmware_files() -> dict[str, bytes]:
    """Return the contents of the firmware's files, keyed by the file names that they get in a pad's folder."""
    paths = (path for path in sorted(FIRMWARE.iterdir()) if path.suffix in (".c", ".h", ".md"))
    return {NAMES.get(path.name, path.name): path.read_bytes() for path in paths}


def c_header(plan: Plan, drive: PadDrive, tuning: Tuning | None = None) -> str:
    """Return the text of `pad_drive.h`, valid as C99 and C++; coils that play the same lines share a row of its tables.

    Frequencies and phases are of the current's tones: half the force's where it has no constant part. `tuning` is the
    one that `drive` was made with.

    Raises
    ------
    SpecError
        More taxels than a frame of the protocol can have.
    """
    if len(plan.taxels) >= NO_TAXEL:
        raise SpecError(f"a frame has at most {NO_TAXEL - 1} taxels, got {len(plan.taxels)}", plan.name)
    slots = {channel.index: k for channel_set in plan.sets for k, channel in enumerate(channel_set)}
    kinds: dict[tuple[Any, ...], CoilDrive] = {}
    keys = []
    for coil in drive.coils:
        channel_set = tuple(slots[plan.taxels[t].channel] for t in coil.taxels)
        parts = (coil.harmonic, coil.line_a2, coil.phase_rad, coil.margin)
        keys.append((channel_set, coil.bias_a, *(part.tobytes() for part in parts)))
        kinds.setdefault(keys[-1], coil)
    # At least 1: an empty table is no C.
    channels = max(1, *(len(coil.taxels) for coil in drive.coils))
    name = _plain(plan.name)
    print_of = "as planned" if tuning is None else f"for the print of tuning {tuning_hash(tuning)}"
    if tuning is not None and tuning.coil_c != COPPER_C:
        print_of += f", its coils at {tuning.coil_c:.0f} degrees C"
    header = [
        (
            f"/* What the coils of the pad '{name}' play, {print_of} ({drive.scheme.name}).\n"
            " * Do not edit: padgen writes it anew.\n"
            " * Currents in A, lines of their square in A2; phases and increments in 2^-32 turns.\n"
            f" * Tones are off by at most {drive.rate_hz / 2 / TURN:.2g} Hz within a period of the comb and"
            " begin anew\n"
            f" * with the next: no phase is ever off by more than {drive.period_samples / 2 / TURN:.2g} of a turn.\n */"
        ),
        "#ifndef PADGEN_PAD_DRIVE_H\n#define PADGEN_PAD_DRIVE_H\n\n#include <stdint.h>\n",
        _defines(plan, drive, len(kinds), channels),
        _table("uint8_t padgen_plan_hash[8]", [f"0x{byte:02x}" for byte in plan_hash(plan, tuning)]),
        _table("uint16_t padgen_coil_kind[PADGEN_COILS]", [str(list(kinds).index(key)) for key in keys]),
        _taxel_table(plan, drive, channels),
        *_kind_tables(drive, list(kinds.values()), [key[0] for key in kinds], channels),
        *_sweep(sweep_table(plan), drive.rate_hz),
    ]
    if drive.scheme.is_root:
        header += _constant_tables(list(kinds.values()), channels)
    return with_tables_crc("\n".join([*header, "#endif\n"]))


def with_tables_crc(header: str) -> str:
    """Return a C header with two macros added or renewed: the list of its tables, and the CRC-32 of their data."""
    header = re.sub(r"#define PADGEN_TABLES.*\n", "", header)
    names = []
    crc = 0
    for kind, name, entries in re.findall(r"static const (\w+) (\w+)[^=]*=\s*(\{.*?\});", header, re.DOTALL):
        words = re.findall(r"[\w.+-]+", re.sub(r"/\*.*?\*/", "", entries, flags=re.DOTALL))
        is_float = kind == "float"
        numbers = [float(word.rstrip("f")) if is_float else int(word.rstrip("u"), 0) for word in words]
        kind_of = np.dtype(np.float32 if is_float else kind.removesuffix("_t")).newbyteorder("<")
        crc = crc32(np.array(numbers, kind_of).tobytes(), crc)
        names.append(f"of({name})")
    lines = f"#define PADGEN_TABLES(of) {' '.join(names)}\n#define PADGEN_TABLES_CRC 0x{crc:08x}u\n"
    return header.removesuffix("#endif\n") + lines + "#endif\n"


def _plain(text: str) -> str:
    """Return `text` with each character that cannot stand in a C comment replaced by an underscore."""
    return "".join(c if c.isascii() and c.isprintable() and c not in "*/\\?" else "_" for c in text)


def _defines(plan: Plan, drive: PadDrive, kinds: int, channels: int) -> str:
    rate = drive.rate_hz
    turns = drive.scheme.takes_turns
    slots = len(plan.sets[0]) if turns else 1
    ramp = ceil((frame_s(plan) / slots / 2 if turns else ramp_s(plan)) * rate)
    step = 2 * ramp if turns else ramp
    frame = max(round(frame_s(plan) * rate), step * slots)
    watchdog = max(ceil(LEAST_WATCHDOG_S * rate), WATCHDOG_FRAMES * frame)
    scheme = drive.scheme
    alike = {
        (alike_scheme.kind.CURRENT, alike_scheme.takes_turns): alike_scheme.name
        for alike_scheme in map(Scheme, SCHEME_NUMBERS)
    }
    if (made := (scheme.kind.CURRENT, turns)) not in alike:
        raise SpecError(
            f"the firmware does not play {scheme.name!r}; its schemes are {', '.join(SCHEME_NUMBERS)}", FILE
        )
    lines = {
        **{f"PADGEN_{_upper(name)}": number for name, number in SCHEME_NUMBERS.items()},
        "PADGEN_HEADER": HEADER,
        "PADGEN_SCHEME": f"PADGEN_{_upper(alike[made])}",
        "PADGEN_TAKES_TURNS": int(turns),
        "PADGEN_RATE_HZ": f"{rate}u",
        "PADGEN_PERIOD_SAMPLES": f"{drive.period_samples}u",
        "PADGEN_RAMP_SAMPLES": f"{ramp}u",
        "PADGEN_STEP_SAMPLES": f"{step}u",
        "PADGEN_SLOTS": slots,
        "PADGEN_FRAME_SAMPLES": f"{frame}u",
        "PADGEN_WATCHDOG_SAMPLES": f"{watchdog}u",
        "PADGEN_HOLD_SAMPLES": f"{min(HOLD_WATCHDOGS * watchdog, MOST_SAMPLES)}u",
        "PADGEN_COILS": len(drive.coils),
        "PADGEN_KINDS": kinds,
        "PADGEN_CHANNELS": channels,
        "PADGEN_TAXELS": len(plan.taxels),
        "PADGEN_RESISTANCE_OHM": _float(drive.resistance_ohm),
        "PADGEN_INDUCTANCE_H": _float(drive.inductance_h),
        **_limits(plan, drive),
        "PADGEN_HAS_CARRIER": int(drive.carrier_hz is not None),
        "PADGEN_CARRIER_HZ": _float(drive.carrier_hz or 0.0),
        "PADGEN_CARRIER_INCREMENT": f"{_turns((drive.carrier_hz or 0.0) / rate)}u",
        "PADGEN_GROUP_CHANNELS": channels_per_group(channels),
    }
    return "".join(f"#define {key} {value}\n" for key, value in lines.items())


def _limits(plan: Plan, drive: PadDrive) -> dict[str, int | str]:
    """Return C macros, by name: limits of coil and amplifier, and coefficients of a coil's current and heat.

    With x = exp(−R dt/L) and u = v/R the current goes from b to a = u + (b − u) x, and the mean of its square is
    u² + 2 u (b − u) (1 − x)/k + (b − u)² (1 − x²)/(2k), k = R dt/L: written in a and b, a sum of terms alike in size.
    """
    spec = plan.spec
    rate = drive.rate_hz
    resistance = drive.resistance_ohm
    inductance = drive.inductance_h
    volts = max(floor(drive.voltage_limit_v / MICRO + SMALL), 1)
    reached = ceil(1.001 * drive.voltage_limit_v / resistance / MICRO)
    bounds = {limit.firmware: limit.bound(spec) for limit in limits() if limit.firmware}
    kept = {name: floor(bound / MICRO + SMALL) for name, bound in bounds.items() if bound < inf}
    amplifier_v = volts
    if spec.amplifier:
        amplifier_v = max(volts, floor(spec.amplifier.voltage_v / MICRO + SMALL))
    amplifier_a = kept.get("PADGEN_AMPLIFIER_UA", reached)
    all_coils_uw = len(drive.coils) * kept["PADGEN_COIL_LIMIT_UW"]
    shift = floor(log2(least_thermal_time_s(spec.coil) * rate))
    k = resistance / (inductance * rate) if inductance else inf
    x = exp(-k)
    rise = -expm1(-k)
    first, second = (0.0, 0.0) if k == inf else (2 * rise / k, -expm1(-2 * k) / (2 * k))
    mean = (1 - first + second, first * (1 + x) - 2 * x - 2 * second, x * x - first * x + second)
    after, both, before = (part / rise**2 for part in mean) if k > SMALL else (1 / 3, 1 / 3, 1 / 3)
    lines: dict[str, int | str] = {
        "PADGEN_VOLTAGE_LIMIT_UV": volts,
        "PADGEN_AMPLIFIER_UV": amplifier_v,
        "PADGEN_VOLTAGE_LIMIT_V": "(PADGEN_VOLTAGE_LIMIT_UV / 1000000.0f)",
        "PADGEN_CURRENT_LIMIT_UA": min(reached, amplifier_a),
        "PADGEN_AMPLIFIER_UA": amplifier_a,
        "PADGEN_CURRENT_LIMIT_A": "(PADGEN_CURRENT_LIMIT_UA / 1000000.0f)",
        "PADGEN_PAD_LIMIT_UW": min(all_coils_uw, kept.get("PADGEN_PAD_LIMIT_UW", all_coils_uw)),
        "PADGEN_HEAT_SHIFT": shift,
        "PADGEN_START_SAMPLES": f"{ceil((1 << shift) / 63)}u",
        "PADGEN_CURRENT_RISE": _float(rise),
        "PADGEN_SQUARE_AFTER": _float(after),
        "PADGEN_SQUARE_BOTH": _float(both),
        "PADGEN_SQUARE_BEFORE": _float(before),
    }
    return lines | {name: bound for name, bound in kept.items() if name not in lines}


def _upper(scheme: str) -> str:
    return scheme.upper().replace("-", "_")


def _taxel_table(plan: Plan, drive: PadDrive, channels: int) -> str:
    rows = []
    for coil in drive.coils:
        ids = ", ".join(_plain(plan.taxels[t].id) for t in coil.taxels)
        numbers = [*map(str, coil.taxels), *[hex(NO_TAXEL)] * (channels - len(coil.taxels))]
        rows.append(f"{_braces(numbers)}, /* row {coil.row}, column {coil.column}: {ids or 'no taxel'} */")
    return _rows("uint16_t padgen_coil_taxel[PADGEN_COILS][PADGEN_CHANNELS]", rows)


def _kind_tables(drive: PadDrive, kinds: list[CoilDrive], slots: list[tuple[int, ...]], channels: int) -> Iterable[str]:
    samples = drive.period_samples
    rate = drive.rate_hz
    share = 1.0 if drive.scheme.at_resonance else 0.5
    yield _table("uint8_t padgen_kind_channels[PADGEN_KINDS]", [str(len(kind.taxels)) for kind in kinds])
    # Whole numbers before they are divided: what is rounded is the increment alone.
    tables: tuple[tuple[str, str, Callable[[CoilDrive], list[str]]], ...] = (
        ("uint32_t padgen_increment", "0u", lambda c: [f"{_turns(k * share / samples)}u" for k in c.harmonic.tolist()]),
        ("uint32_t padgen_phase", "0u", lambda c: [f"{_turns(x * share / (2 * pi))}u" for x in c.phase_rad.tolist()]),
        ("float padgen_tone_hz", "0.0f", lambda c: [_float(k * share * rate / samples) for k in c.harmonic.tolist()]),
        ("float padgen_line_a2", "0.0f", lambda c: [_float(line) for line in c.line_a2.tolist()]),
    )
    for declared, empty, entries in tables:
        yield _by_kind(declared, channels, map(entries, kinds), empty)
    yield _by_kind("uint8_t padgen_slot", channels, ([str(slot) for slot in set_slots] for set_slots in slots), "0")
    yield _table("float padgen_bias_a[PADGEN_KINDS]", [_float(kind.bias_a) for kind in kinds])


def _by_kind(declared: str, channels: int, entries: Iterable[list[str]], empty: str) -> str:
    """Return a C table with a row for each kind of coil, each row filled up with `empty` to `channels` entries."""
    rows = [_braces([*entry, *[empty] * (channels - len(entry))]) + "," for entry in entries]
    return _rows(f"{declared}[PADGEN_KINDS][PADGEN_CHANNELS]", rows)


def _constant_tables(kinds: list[CoilDrive], channels: int) -> Iterable[str]:
    """Yield C tables for spur-free coils: least constant parts of i² by on/off state, and the margins added to them."""
    size = channels_per_group(channels)
    groups = ceil(channels / size)
    margins = ([_float_above(a2) for a2 in (kind.margin * kind.line_a2).tolist()] for kind in kinds)
    yield _by_kind("float padgen_margin_a2", channels, margins, "0.0f")
    tables = [least_constants(kind, size) for kind in kinds]
    yield _table("float padgen_all_on_a2[PADGEN_KINDS]", [_float_above(all_on) for all_on, _ in tables])
    few = channels_per_signed_group(channels)
    yield f"#define PADGEN_SIGNED_CHANNELS {few}\n"
    signed = [signed_constants(kind, few) for kind in kinds]
    yield _states_table("padgen_signed_a2", ceil(channels / few), 3**few, signed)
    yield _states_table("padgen_least_a2", groups, 1 << size, [least for _, least in tables])


def _states_table(name: str, groups: int, states: int, tables: Iterable[Iterable[Iterable[float]]]) -> str:
    """Return a C table of constant parts of i² in A², by kind of coil, group of channels, and state of that group."""
    rows = []
    for table in tables:
        known = list(table)
        of_groups = [*known, *[(0.0,) * states] * (groups - len(known))]
        rows.append("{" + ",\n".join(_braces([_float_above(a2) for a2 in group]) for group in of_groups) + "},")
    return _rows(f"float {name}[PADGEN_KINDS][{groups}][{states}]", rows)


def _sweep(table: FirmwareSweep, rate_hz: int) -> Iterable[str]:
    """Yield the C table of the firmware's sweep: frequency in Hz and voltage amplitude in V at equally spaced times."""
    yield f"#define PADGEN_SWEEP_SAMPLES {ceil(table.seconds * rate_hz)}u\n#define PADGEN_SWEEP_ROWS {len(table.hz)}\n"
    rows = [f"{{{_float(hz)}, {_float(volts)}}}," for hz, volts in zip(table.hz, table.volts, strict=True)]
    yield _rows("float padgen_sweep[PADGEN_SWEEP_ROWS][2]", rows)


def _turns(turns: float) -> int:
    """Convert a phase in turns to whole units of 2⁻³² turns, modulo one turn."""
    return round(turns * TURN) % TURN


def _float(value: float) -> str:
    """Return the C literal of `value` rounded to a single-precision float."""
    text = f"{float(np.float32(value)):.9g}"
    return f"{text}f" if "." in text or "e" in text else f"{text}.0f"


def _float_above(value: float) -> str:
    """Return the C literal of a single-precision float that is not below `value`."""
    single = np.float32(value)
    return _float(float(single if single >= value else np.nextafter(single, np.float32(np.inf))))


def _braces(entries: Iterable[str]) -> str:
    return fill("{" + ", ".join(entries) + "}", 116, break_long_words=False)


def _table(declared: str, entries: Iterable[str]) -> str:
    return f"static const {declared} =\n{_braces(entries)};\n"


def _rows(declared: str, rows: Iterable[str]) -> str:
    return f"static const {declared} = {{\n" + "\n".join(rows) + "\n};\n"
