"""What the drive asks of a coil, its amplifier and the beams; and how fast frames may follow."""

from collections.abc import Sequence

import numpy as np

from padgen.physics.currents import mean_square_a2, peak_current_a, peak_voltage_v
from padgen.physics.selectivity import SCHEMES
from padgen.planner.channels import squared_current_lines
from padgen.planner.plan import Channel, CoilLoad, FrameRate, channel_sets
from padgen.planner.selectivity import scheme_named
from padgen.spec import Spec
from padgen.units import MA, MH, MM, MS, UM

__all__ = ["coil_load", "frame_rates", "pull_in_share"]


def coil_load(spec: Spec, channels: Sequence[Channel], drive: str) -> CoilLoad:
    """Currents, voltage and heat of a coil with all channels on, and the level that every limit allows.

    With two sets of channels, of the coil that allows less.
    """
    sets = channel_sets(channels, spec.coil.sets)
    return min((_load(spec, own, drive) for own in sets), key=lambda load: load.reachable_level_um)


def _load(spec: Spec, channels: Sequence[Channel], drive: str) -> CoilLoad:
    coil, headroom = spec.coil, spec.drive.headroom
    scheme, lines = scheme_named(spec, drive), squared_current_lines(channels)
    resonance = np.array([c.resonance_hz for c in channels])
    square_a2 = mean_square_a2(scheme, lines, headroom)
    volts = peak_voltage_v(scheme, lines, resonance, coil.resistance_ohm, coil.inductance_mh * MH, headroom)
    loss_w = square_a2 * coil.resistance_ohm
    pull_in = max(pull_in_share(spec, channel) for channel in channels)
    shares = {
        # Displacements go with the square of the current.
        "voltage": (volts / spec.drive.voltage_limit_v) ** 2,
        "copper loss": loss_w / coil.power_limit_w,
        "gap": max(_gap_share(spec, channel) for channel in channels),
        "root stress": max(c.root_stress_mpa for c in channels) / spec.material.fatigue_stress_mpa,
    }
    tightest = max(shares, key=lambda name: shares[name])
    return CoilLoad(
        current_peak_ma=peak_current_a(scheme, lines, headroom) / MA,
        current_rms_ma=square_a2**0.5 / MA,
        voltage_peak_v=volts,
        copper_loss_w=loss_w,
        pull_in_share=pull_in,
        reachable_level_um=spec.drive.level_um / shares[tightest] if shares[tightest] > 0 else 0.0,
        reachable_by=tightest,
    )


def pull_in_share(spec: Spec, channel: Channel) -> float:
    """Mean pull on a washer over the one at which it snaps to the coil.

    With a pull ``c I² (g/(g − z))^m`` against a spring k, balance ends at z = g/(m + 1), a third of
    the gap for m = 2, and at ``k z (m/(m + 1))^m``.
    """
    gap_um, m = spec.coil.gap_mm * MM / UM, max(channel.pull_exponent, 0.0)
    largest_um: float = gap_um / (m + 1) * (m / (m + 1)) ** m
    return channel.static_um / largest_um


def _gap_share(spec: Spec, channel: Channel) -> float:
    """Static pull and amplitude over what sag leaves of a third of the gap.

    0 where sag leaves nothing: no level is small enough then, and the finding on travel says so.
    """
    free_um = spec.coil.gap_mm * MM / UM / 3 - channel.sag_um
    return (channel.static_um + channel.level_um) / free_um if free_um > 0 else 0.0


def frame_rates(channels: Sequence[Channel], sets: int = 1) -> tuple[FrameRate, ...]:
    """Frames a second, per scheme, at which what is switched off is quiet before the next frame.

    All at once: the slowest channel's ring-down. In turns: every channel's slot lasts until it has
    rung up, which takes as long as ringing down, the one before ringing down meanwhile.
    """
    together = max(channel.ring_down_ms for channel in channels) * MS
    in_turns = max(sum(channel.ring_down_ms for channel in own) for own in channel_sets(channels, sets)) * MS
    return tuple(
        FrameRate(name, 1 / time if (time := in_turns if name == "time-shared" else together) > 0 else float("inf"))
        for name in SCHEMES
    )
