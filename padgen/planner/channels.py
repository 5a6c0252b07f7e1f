"""Make the plan's `Channel`s from sized beams: levels, forces, and the coil's pull on each washer."""

from collections.abc import Sequence
from dataclasses import replace
from math import log

import numpy as np

from padgen.core.units import GRAM, MM, MN, MPA, MS, UM, decibel
from padgen.physics.magnetics import balanced_deflection
from padgen.physics.modes import level_kept, resonance_rise
from padgen.physics.pull import PullAt
from padgen.physics.resonator import ring_up_time
from padgen.physics.schemes import mean_square_a2
from padgen.physics.selectivity import Scheme
from padgen.planner.plan import Beam, Channel, Site, channel_sets
from padgen.planner.pull_modes import force_error, mode_fields, pulled_shares, pulls, site_wrenches, taxel_modes
from padgen.planner.settings import level_law
from padgen.planner.sizing import SizedChannel, frequency_spread
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import fillet_mm
from padgen.spec import Spec

USUAL_DEPTH = 1.01
"""Depth of the frame behind a root over half a rib, for which beams are sized; up to here no error is added."""

__all__ = [
    "driven",
    "force_constants",
    "hanging_gap_um",
    "plan_channels",
    "pull_exponent",
    "site_pulls",
    "wanted_line_a2",
]


def plan_channels(spec: Spec, sized: Sequence[SizedChannel], sites: Sequence[Site]) -> tuple[Channel, ...]:
    """Return the channels of a coil, before `driven` fills in the fields that depend on the drive scheme."""
    resonance = np.array([float(s.model.resonance_hz) for s in sized])
    level = level_law(spec)(resonance)
    level_um = spec.drive.level_um * level / level[0]
    sag_m, alpha = np.array([(float(s.model.sag_m), float(s.model.hardening_per_m2)) for s in sized]).T
    sag_um, level_m = sag_m / UM, level_um * UM
    rise, kept = resonance_rise(alpha, level_m, sag_m), level_kept(alpha, spec.q_min, level_m, sag_m)
    pulled = site_pulls(spec, sites, hanging_gap_um(spec, sag_um))
    exponent = pull_exponent(pulled, hanging_gap_um(spec, sag_um))
    wrench = site_wrenches(spec, pulled, sites)
    tau_ms = ring_up_time(resonance, spec.q_min) / MS
    quiet = _quiet_ratios(spec, resonance, level_um)
    deep_error = _deep_frame_errors(sized, sites)
    radius_m = spec.washer.outer_diameter_mm / 2 * MM
    channels = []
    for i, (item, site) in enumerate(zip(sized, sites, strict=True)):
        stiffness = float(item.model.stiffness_n_per_m)
        beam_error = item.model.beam_error
        moving = taxel_modes(item.model)
        modes = mode_fields(moving, wrench[i])
        force_mn = float(level_um[i]) * UM * stiffness / spec.q_min / MN
        force_constant = float(pulled.pull[i]) * modes.pulled_share
        channels.append(
            Channel(
                index=i,
                resonance_hz=float(resonance[i]),
                drive_hz=float(resonance[i]) / 2,
                q=spec.q_min,
                beam=_beam(spec, item),
                effective_mass_g=float(item.model.effective_mass_kg) / GRAM,
                stiffness_n_per_m=stiffness,
                ring_up_ms=float(tau_ms[i]),
                ring_down_ms=float(tau_ms[i]) * max(log(quiet[i]), 0.0),
                level_um=float(level_um[i]),
                rule_hz=float(item.model.rule_hz),
                target_hz=item.target_hz,
                second_mode_hz=item.model.second_mode[0],
                second_mode_share=item.model.second_mode[1],
                **modes._asdict(),
                sag_um=float(sag_um[i]),
                hardening_per_mm2=float(alpha[i]) * MM**2,
                level_shift=float(rise[i]),
                level_loss_db=-decibel(float(kept[i])),
                root_stress_mpa=float(item.model.root_stress_pa(level_um[i] * UM)) / MPA,
                print_spread=float(frequency_spread(item.beam, spec.spread, item.model.exponents)),
                force_mn=force_mn,
                force_constant_n_per_a2=force_constant,
                line_a2=wanted_line_a2(force_mn, force_constant),
                force_error=force_error(moving, wrench[i], float(pulled.error[i]), radius_m),
                pull_exponent=float(exponent[i]),
                static_um=0.0,
                pull_shift=0.0,
                model="beam" if beam_error is None else "solid",
                model_error=float(item.model.error_estimate) + float(deep_error[i]),
                beam_error=beam_error,
                site=site,
            )
        )
    return tuple(channels)


def force_constants(spec: Spec, sized: Sequence[SizedChannel], sites: Sequence[Site]) -> np.ndarray:
    """Return the channels' `force_constant_n_per_a2` (n,) alone, faster than by `plan_channels`."""
    sag_um = np.array([float(s.model.sag_m) for s in sized]) / UM
    pulled = site_pulls(spec, sites, hanging_gap_um(spec, sag_um))
    share = pulled_shares([taxel_modes(s.model) for s in sized], site_wrenches(spec, pulled, sites))
    return np.asarray(pulled.pull * share)


def site_pulls(spec: Spec, sites: Sequence[Site], gap_um: np.ndarray) -> PullAt:
    """Return the pulls (n,) on the washers of `sites`, each over its own gap (n,) in µm."""
    return pulls(spec, gap_um * UM, np.array([site.coil_distance_mm for site in sites]) * MM)


def pull_exponent(pulled: PullAt, gap_um: np.ndarray) -> np.ndarray:
    """Return the exponent m (n,) of ``pull ∝ gap^−m`` about each gap (n,) in µm; 0 for washers that are not pulled."""
    return np.asarray(
        np.divide(-pulled.slope * gap_um * UM, pulled.pull, out=np.zeros(len(gap_um)), where=pulled.pull > 0)
    )


def hanging_gap_um(spec: Spec, sag_um: np.ndarray | float) -> np.ndarray:
    """Return the gap in µm below a washer that sags by `sag_um`, but at least a tenth of the spec's gap."""
    gap_um = spec.coil.gap_mm * MM / UM
    return np.maximum(gap_um - sag_um, gap_um / 10)


def driven(spec: Spec, channels: Sequence[Channel], scheme: Scheme) -> tuple[Channel, ...]:
    """Return `channels` with the frequencies of the current and the effects of the mean pull under `scheme`."""
    sets = channel_sets(channels, spec.coil.sets)
    squares_a2 = [mean_square_a2(scheme, np.array([c.line_a2 for c in own]), spec.drive.headroom) for own in sets]
    result = []
    for channel in channels:
        gap_um = float(hanging_gap_um(spec, channel.sag_um))
        pull_n = squares_a2[channel.index % len(sets)] * channel.force_constant_n_per_a2
        slack_um, exponent = pull_n / channel.stiffness_n_per_m / UM, max(channel.pull_exponent, 0.0)
        static_um = balanced_deflection(slack_um, gap_um, exponent)
        result.append(
            replace(
                channel,
                drive_hz=channel.resonance_hz if scheme.has_constant else channel.resonance_hz / 2,
                static_um=gap_um if static_um is None else static_um,
                # With F = k z at balance the stiffness falls by the share (dF/dz)/k, the resonance by half of that.
                pull_shift=0.0 if static_um is None else exponent * static_um / (gap_um - static_um) / 2,
            )
        )
    return tuple(result)


def wanted_line_a2(force_mn: float, force_constant_n_per_a2: float) -> float:
    """Return the amplitude in A² of the line of i² that makes a force in mN; 0 for a washer that is not pulled."""
    return force_mn * MN / force_constant_n_per_a2 if force_constant_n_per_a2 > 0 else 0.0


def _quiet_ratios(spec: Spec, resonance: np.ndarray, level_um: np.ndarray) -> np.ndarray:
    """Return the ON amplitude (n,) over the amplitude that counts as quiet.

    Quiet is the detection threshold where the spec has one, else 1/Δy of the ON amplitude.
    """
    threshold = level_law(spec).threshold_um(resonance)
    return np.full(len(resonance), spec.delta_y) if threshold is None else level_um / threshold


def _deep_frame_errors(sized: Sequence[SizedChannel], sites: Sequence[Site]) -> np.ndarray:
    """Return relative errors (n,) of resonances where the frame behind a root is deeper than half a rib.

    Beams are sized for half a rib. The error is twice the shift that the beam model finds with the true depth; that
    covers 96 % of 53 random taxels (docs/accuracy.md).
    """
    error, depth = np.zeros(len(sized)), np.array([site.frame_depth_mm for site in sites])
    models = [item.model for item in sized]
    deep = [i for i, m in enumerate(models) if m.beam_error is None and depth[i] >= m.spec.pad.rib_mm / 2 * USUAL_DEPTH]
    for topology in {models[i].topology for i in deep}:
        own = [i for i in deep if models[i].topology == topology]
        beam = BeamShape(*np.array([models[i].beam for i in own], float).T)
        true = replace(models[own[0]], beam=beam, frame_depth_mm=depth[own], member_of=None)
        error[own] = 2 * np.abs(true.resonance_hz / [models[i].resonance_hz for i in own] - 1)
    return error


def _beam(spec: Spec, item: SizedChannel) -> Beam:
    printer = spec.printer
    width, thickness, length = (float(v) for v in item.beam)
    return Beam(
        width_mm=width,
        thickness_mm=thickness,
        length_mm=length,
        topology=item.topology,
        fillet_mm=float(fillet_mm(spec, item.model.arrangement)),
        count=len(item.model.arrangement.beams),
        layers=round((thickness - printer.first_layer_mm) / printer.layer_mm) + 1,
    )
