"""Make the rows of a drive table: the current of each channel, and the constant part of a coil's current."""

import cmath
import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from math import degrees, inf, sqrt
from typing import Any

import numpy as np

from padgen.core.units import MA, MH, MN
from padgen.physics.magnetics import impedance
from padgen.physics.schemes import bias_a, current_lines_a, mean_square_a2, on_carrier_v, root_voltage_v
from padgen.physics.selectivity import Scheme
from padgen.planner.plan import Channel
from padgen.spec import Spec

__all__ = ["BIAS", "COLUMNS", "HEADINGS", "DriveRow", "bias_row", "coil_rows", "table_csv"]

BIAS = "bias"


def _table_column(heading: str, unit: str = "") -> Any:
    """Return a dataclass field for a column of the drive table, with the `heading` and `unit` that readers see."""
    return field(metadata={"heading": heading, "unit": unit})


@dataclass(frozen=True, slots=True)
class DriveRow:
    """One channel of the drive table, or the row of the current's constant part (channel 'bias', at 0 Hz).

    Amplitudes are peaks; the phase is that of the voltage ahead of the current. In the bias row of a biased drive the
    current is the constant current, in that of a spur-free drive the root of the constant part of i². The bias row's
    force is the mean pull on the washer of the coil's lowest channel.
    """

    channel: int | str = _table_column("channel")
    resonance_hz: float = _table_column("resonance", "Hz")
    drive_hz: float = _table_column("line of i", "Hz")
    force_mn: float = _table_column("force", "mN")
    current_ma_peak: float = _table_column("current", "mA peak")
    voltage_v_peak: float = _table_column("voltage", "V peak")
    impedance_ohm: float = _table_column("impedance", "Ω")
    phase_deg: float = _table_column("phase", "°")
    ring_up_ms: float = _table_column("ring-up", "ms")


COLUMNS = tuple(f.name for f in fields(DriveRow))
HEADINGS = tuple((f.metadata["heading"], f.metadata["unit"]) for f in fields(DriveRow))
"""The heading of each of `COLUMNS` where people read the table, and its unit."""


def coil_rows(
    spec: Spec, scheme: Scheme, channel_set: Sequence[Channel], carrier_hz: float | None = None
) -> list[DriveRow]:
    """Return a row for each channel of one coil.

    A plain tone of amplitude I at f pulls with c I²/2 at 2f. With a constant current B, a tone of amplitude b at r
    pulls with 2 c B b at r. For a spur-free drive a row has the current's peak with this channel alone on, on its
    carrier if there is one. For a washer that the coil does not pull the current is infinite.
    """
    current = current_lines_a(scheme, np.array([c.line_a2 for c in channel_set]), spec.drive.headroom)
    return [_row(spec, scheme, channel, float(i), carrier_hz) for channel, i in zip(channel_set, current, strict=True)]


def _row(spec: Spec, scheme: Scheme, channel: Channel, current_a: float, carrier_hz: float | None) -> DriveRow:
    resistance = spec.coil.resistance_ohm
    inductance = spec.coil.inductance_mh * MH
    z = complex(impedance(resistance, inductance, channel.drive_hz))
    volts = current_a * abs(z)
    if channel.force_constant_n_per_a2 <= 0:
        current_a = volts = inf
    elif scheme.is_root:
        volts = root_voltage_v(channel.line_a2, channel.resonance_hz, resistance, inductance, spec.drive.headroom)
        if carrier_hz is not None:
            volts = float(on_carrier_v(volts, current_a, inductance, carrier_hz))
            current_a *= sqrt(2)
    return DriveRow(
        channel.index,
        channel.resonance_hz,
        channel.drive_hz,
        channel.force_mn,
        current_a / MA,
        volts,
        abs(z),
        degrees(cmath.phase(z)),
        channel.ring_up_ms,
    )


def bias_row(spec: Spec, scheme: Scheme, channel_set: Sequence[Channel], name: str = BIAS) -> DriveRow:
    """Return the row for the constant part of the current in a coil with the channels `channel_set`."""
    lines = np.array([c.line_a2 for c in channel_set])
    resistance = spec.coil.resistance_ohm
    square = mean_square_a2(scheme, lines, spec.drive.headroom)
    constant = bias_a(scheme, lines) if scheme.is_biased else sqrt(square)
    static_mn = square * channel_set[0].force_constant_n_per_a2 / MN
    return DriveRow(name, 0.0, 0.0, static_mn, constant / MA, constant * resistance, resistance, 0.0, 0.0)


def table_csv(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return rows as CSV text, numbers with six significant digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        writer.writerow([f"{value:.6g}" if isinstance(value, float) else value for value in row])
    return text.getvalue()
