"""Load of the drive on a coil, its amplifier and the beams, and the level that these allow."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf

import numpy as np

from padgen.core.units import MA, MH, MM, UM
from padgen.physics.magnetics import pull_in_deflection, slack_at
from padgen.physics.modes import jump_amplitude
from padgen.physics.schemes import mean_square_a2, on_carrier_v, peak_current_a, peak_voltage_v
from padgen.physics.selectivity import Scheme
from padgen.planner.channels import hanging_gap_um
from padgen.planner.plan import Channel, CoilLoad, Plan, channel_sets
from padgen.planner.settings import carrier_hz, passes
from padgen.spec import Amplifier, Spec, catalogue

__all__ = ["coil_load", "fitting_amplifiers", "is_fed", "pull_in_share"]


def coil_load(spec: Spec, channels: Sequence[Channel], scheme: Scheme) -> CoilLoad:
    """Return currents, voltage and heat of a coil with all channels on, and the largest level that all limits allow.

    With two sets of channels, the figures are of the coil that allows the lower level.
    """
    sets = channel_sets(channels, spec.coil.sets)
    carrier = carrier_hz(spec, scheme, max(c.resonance_hz for c in channels))
    return min((_load(spec, own, scheme, carrier) for own in sets), key=lambda load: load.reachable_level_um)


def _load(spec: Spec, channels: Sequence[Channel], scheme: Scheme, carrier: float | None) -> CoilLoad:
    coil, headroom = spec.coil, spec.drive.headroom
    lines, resonance = np.array([(c.line_a2, c.resonance_hz) for c in channels]).T
    square_a2 = mean_square_a2(scheme, lines, headroom)
    volts = peak_voltage_v(scheme, lines, resonance, coil.resistance_ohm, coil.inductance_mh * MH, headroom)
    peak_a = peak_current_a(scheme, lines, headroom)
    if carrier is not None:
        volts = float(on_carrier_v(volts, peak_a, coil.inductance_mh * MH, carrier))
        peak_a *= 2**0.5
    loss_w = square_a2 * coil.resistance_ohm
    pull_in = max(pull_in_share(spec, channel, square_a2) for channel in channels)
    # Factors by which the displacements may grow: the square of the current grows in proportion.
    factors = {
        "voltage": (spec.drive.voltage_limit_v / volts) ** 2 if volts > 0 else inf,
        "copper loss": coil.power_limit_w / loss_w if loss_w > 0 else inf,
        "gap": min(_gap_factor(spec, channel, square_a2) for channel in channels),
        "stretching": min(jump_amplitude(c.hardening_per_mm2, c.q) * MM / UM / c.level_um for c in channels),
        "root stress": spec.material.fatigue_stress_mpa / max(c.root_stress_mpa for c in channels),
    }
    if spec.amplifier and peak_a > 0:
        factors["amplifier's current"] = (spec.amplifier.current_a / peak_a) ** 2
    if min(c.force_constant_n_per_a2 for c in channels) <= 0:
        factors["pull"] = 0.0
    tightest = min(factors, key=lambda name: factors[name])
    return CoilLoad(
        current_peak_ma=peak_a / MA,
        current_rms_ma=square_a2**0.5 / MA,
        voltage_peak_v=volts,
        copper_loss_w=loss_w,
        idle_w=mean_square_a2(scheme, lines, headroom, np.zeros(len(lines), bool)) * coil.resistance_ohm,
        pull_in_share=pull_in,
        reachable_level_um=spec.drive.level_um * factors[tightest],
        reachable_by=tightest,
    )


def fitting_amplifiers(plan: Plan) -> dict[str, int]:
    """Return the amplifiers of the catalogue that can play all channels of a plan, and how many of each it takes."""
    coils, fitting = plan.coils.rows * plan.coils.columns, {}
    for name, entry in catalogue("amplifier").items():
        drive = replace(plan.spec.drive, voltage_limit_v=entry["voltage_v"])
        spec = replace(plan.spec, amplifier=Amplifier(**entry), drive=drive)
        if passes(spec, plan.scheme) and is_fed(spec, coil_load(spec, plan.channels, plan.scheme)):
            fitting[name] = -(-coils // int(entry["channels"]))
    return fitting


def is_fed(spec: Spec, load: CoilLoad) -> bool:
    """Return whether the spec's amplifier, if there is one, has the volts and amperes of a load."""
    own = spec.amplifier
    enough_v = load.voltage_peak_v <= spec.drive.voltage_limit_v
    return own is None or (enough_v and load.current_peak_ma * MA <= own.current_a)


def pull_in_share(spec: Spec, channel: Channel, square_a2: float) -> float:
    """Return the mean pull on a washer for a mean square current, over the pull at which it snaps to the coil."""
    gap_um = float(hanging_gap_um(spec, channel.sag_um))
    _, largest_um = pull_in_deflection(gap_um, max(channel.pull_exponent, 0.0))
    return _slack_um(channel, square_a2) / largest_um


def _slack_um(channel: Channel, square_a2: float) -> float:
    """Return the deflection in µm under the mean pull at rest, as if the pull did not grow while the gap closes."""
    return max(square_a2 * channel.force_constant_n_per_a2, 0.0) / channel.stiffness_n_per_m / UM


def _gap_factor(spec: Spec, channel: Channel, square_a2: float) -> float:
    """Return the factor by which amplitude and mean pull may grow until, with the sag, they fill a third of the gap.

    The spring balances the mean pull, so the washer stays short of pull-in. 0 where sag alone fills a third of the gap.
    """
    gap_um, exponent = float(hanging_gap_um(spec, channel.sag_um)), max(channel.pull_exponent, 0.0)
    free_um, slack_um = spec.coil.gap_mm * MM / UM / 3 - channel.sag_um, _slack_um(channel, square_a2)
    if free_um <= 0 or slack_um <= 0:
        return max(free_um, 0.0) / channel.level_um
    low, high = 0.0, min(free_um, pull_in_deflection(gap_um, exponent)[0])
    for _ in range(60):
        static_um = (low + high) / 2
        grown = slack_at(static_um, gap_um, exponent) / slack_um
        low, high = (static_um, high) if grown * channel.level_um + static_um < free_um else (low, static_um)
    return slack_at(low, gap_um, exponent) / slack_um
