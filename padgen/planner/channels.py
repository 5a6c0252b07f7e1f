"""Make the plan's `Channel`s from sized beams: levels, the coil's pull at each site, and how it excites the modes.

The modes are `TaxelModes`, whether from the beam model or from finite elements.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from math import log, sqrt
from typing import Any

import numpy as np

from padgen.core.registry import COILS
from padgen.core.units import GRAM, MA, MM, MN, MPA, MS, UM, decibel
from padgen.physics.magnetics import balanced_deflection
from padgen.physics.modes import level_kept, resonance_rise
from padgen.physics.pull import PullAt
from padgen.physics.resonator import (
    LEFT_OUT,
    ModalTaxels,
    TaxelModes,
    felt_gains,
    modal_taxels,
    ring_up_time,
    without_quiet_modes,
)
from padgen.physics.schemes import mean_pull_line
from padgen.physics.selectivity import Scheme
from padgen.planner.core_pull import CoreRest, core_rest, finite_rest
from padgen.planner.movers import mover_of
from padgen.planner.pins import pin_of
from padgen.planner.plan import TURNS, Beam, Channel, Site, channel_sets, level_law
from padgen.planner.sizing import SizedChannel, frequency_spread
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import (
    SolvedModel,
    TaxelModel,
    fillet_mm,
    plate_shape,
)
from padgen.spec import Spec

__all__ = [
    "coil_modes",
    "driven",
    "force_constants",
    "force_error",
    "hanging_gap_um",
    "heard_modes",
    "mode_fields",
    "mode_names",
    "plan_channels",
    "pull_exponent",
    "site_pulls",
    "site_wrenches",
    "taxel_modes",
    "unpulled",
    "wanted_line_a2",
    "with_auto_scheme",
    "working_mode_ratios",
]


NAMES = ("stretch", "lateral", "bending", "torsion", "pitch", "yaw")
"""Names of modes by the largest part of the plate's motion: along x, y, z, and about x, y, z."""
STILL = 1e-10
"""Motion of a mode in one of six directions, over the most of any mode in that direction, that is rounding: symmetric
taxels of the templates have up to 1e-13, and the smallest real couplings are 1e-7."""
SHARE_DECIMALS = 12
"""Decimals of a mode's share that rounding leaves alone."""


def taxel_modes(model: TaxelModel) -> TaxelModes:
    """Return the modes of `model`: those solved by finite elements if it has them, else the beam model's six.

    The beam model's are the same with any version of numpy: directions in which a mode does not move (`STILL`) are
    exactly zero, and the sign of a mode, which is free, makes the first of z, x, y and the rotations that it moves in
    positive.
    """
    if isinstance(model, SolvedModel):
        return model.solved
    motion = np.concatenate([model.modes.at_point(model.washer_point_m), model.modes.shape[3:]]).T
    motion[np.abs(motion) < STILL * np.abs(motion).max(axis=0)] = 0.0
    ordered = motion[:, [2, 0, 1, 3, 4, 5]]
    first = (ordered != 0).argmax(axis=1)
    motion *= np.sign(ordered[np.arange(len(motion)), first])[:, None]
    return TaxelModes(model.modes.frequency_hz, motion + 0.0)  # no -0.0


def mode_fields(modes: TaxelModes, wrench: np.ndarray) -> dict[str, Any]:
    """Return the `Channel` fields for the modes of a taxel; `wrench` (6,), its pull, is a row of `site_wrenches`.

    Shares are of the working mode's static compliance under a vertical pull at the washer's axis, to `SHARE_DECIMALS`.
    """
    unit = modes.compliances()[modes.working]
    return {
        "modes_hz": tuple(modes.frequency_hz.tolist()),
        "mode_shares": tuple((modes.compliances() / unit).round(SHARE_DECIMALS).tolist()),
        "pulled_shares": tuple((modes.compliances(wrench) / unit).round(SHARE_DECIMALS).tolist()),
        "mode_motions": tuple(tuple(row) for row in modes.motion.tolist()),
        "rest_motion": (0.0,) * 6 if modes.rest is None else tuple((modes.rest @ wrench).tolist()),
        "pull_wrench": tuple(wrench.tolist()),
    }


def working_mode_ratios(modes: Sequence[TaxelModes], wrenches: np.ndarray) -> np.ndarray:
    """Return the ratios (n,) of working-mode motion under pulls of `wrenches` (n, 6) to that under vertical pulls.

    Vertical pulls act at the washer's axis.
    """
    pairs = zip(modes, wrenches, strict=True)
    return np.array(
        [
            taxel_modes.compliances(wrench)[taxel_modes.working] / taxel_modes.compliances()[taxel_modes.working]
            for taxel_modes, wrench in pairs
        ]
    )


def force_error(modes: TaxelModes, wrench: np.ndarray, error: float, radius_m: float) -> float:
    """Return the relative error of the force that a pull `wrench` (6,) from `site_wrenches` exerts on the working mode.

    The axial pull has the relative `error`. The side force is off by as many newtons, the moment by the same force at
    the rim of the washer, `radius_m` from its axis (docs/accuracy.md). The three errors are independent.
    """
    x, y = wrench[:2] / (np.hypot(*wrench[:2]) or 1.0)
    off = np.array([(0, 0, 1, 0, 0, 0), (x, y, 0, 0, 0, 0), (0, 0, 0, -y * radius_m, x * radius_m, 0)])
    share, *parts = (modes.compliances(part)[modes.working] for part in (wrench, *off))
    return float(error * np.linalg.norm(parts) / abs(share)) if share else error


def site_wrenches(spec: Spec, pulled: PullAt, sites: Sequence[Site]) -> np.ndarray:
    """Return the pull at each site as a wrench (n, 6), force and moment, per newton of its vertical part.

    It is in N and N m, about the washer's axis at z = 0, in the taxel's own axes. A washer that the coil does not pull
    gets (0, 0, 1, 0, 0, 0).
    """
    none = np.zeros(len(sites))
    side, moment, side_across, moment_across = (
        np.divide(part, -pulled.pull, out=none.copy(), where=pulled.pull > 0)
        for part in (pulled.side, pulled.moment, pulled.side_across, pulled.moment_across)
    )
    # Unit vector away from the coil's axis; zero on the axis, where there is no side force.
    out = np.array([np.divide(site.washer_mm, site.coil_distance_mm or 1.0) for site in sites])
    cosine, sine = np.array([TURNS[site.along] for site in sites]).T
    # The same vector in the taxel's own axes.
    x = cosine * out[:, 0] + sine * out[:, 1]
    y = cosine * out[:, 1] - sine * out[:, 0]
    (force_x, force_y), (moment_x, moment_y) = (
        (x * a - y * b, y * a + x * b) for a, b in ((side, side_across), (-moment_across, moment))
    )
    # The underside of the washer is the glue's thickness above the bed's plane.
    height = spec.mover_low_mm * MM
    moments = moment_x - height * force_y, moment_y + height * force_x
    return np.stack([force_x, force_y, none + 1, *moments, none], axis=-1)


def coil_modes(spec: Spec, channels: Sequence[Channel]) -> ModalTaxels:
    """Return all modes of one coil's taxels, gains being relative to each taxel's motion at its resonance."""
    most = max(len(channel.modes_hz) for channel in channels) + 1
    frequency = np.ones((len(channels), most))
    gain = np.zeros((len(channels), most, 3))
    radius_m = spec.contact_diameter_mm / 2 * MM
    for i, channel in enumerate(channels):
        modes = TaxelModes(np.array(channel.modes_hz), np.array(channel.mode_motions))
        wrench = np.array(channel.pull_wrench)
        rest = np.array(channel.rest_motion)
        count = len(channel.modes_hz) + 1
        frequency[i, :count], gain[i, :count] = felt_gains(modes, wrench, rest, radius_m)
    return modal_taxels(
        frequency, gain, np.array([c.q for c in channels]), np.array([c.resonance_hz for c in channels])
    )


def heard_modes(spec: Spec, channels: Sequence[Channel], line: np.ndarray, left_out: float = LEFT_OUT) -> ModalTaxels:
    """Return `coil_modes` without modes that the drive hardly excites; `line` (n,): wanted lines, as in `Channels`.

    Together these move an OFF taxel by at most `left_out` of what its own mode does.
    """
    own_hz = np.array([c.resonance_hz for c in channels])
    return without_quiet_modes(coil_modes(spec, channels), own_hz, line, spec.drive.bias_ratio, left_out)


def mode_names(spec: Spec, channel: Channel) -> tuple[str, ...]:
    """Return a name for each mode of a channel.

    The working mode is 'bending'. The others take, of the names left, that of the largest part of the plate's motion:
    at half the plate's height, near the centre of mass, with rotations times the plate's radius of gyration. Beyond
    six, modes are 'higher'.
    """
    plate = plate_shape(spec)
    height = plate.thickness_mm / 2 * MM
    arm = plate.length_mm / 12**0.5 * MM
    motion = np.array(channel.mode_motions)
    motion[:, 0] += height * motion[:, 4]
    motion[:, 1] -= height * motion[:, 3]
    part = motion**2 * np.array([1, 1, 1, arm, arm, arm]) ** 2
    part /= part.sum(1, keepdims=True)
    names = ["higher"] * len(motion)
    working = int(np.argmax(channel.mode_shares)), NAMES.index("bending")
    for n in range(min(len(motion), len(NAMES))):
        mode, kind = np.unravel_index(int(part.argmax()), part.shape) if n else working
        names[mode] = NAMES[kind]
        part[mode] = -1.0
        part[:, kind] = -1.0
    return tuple(names)


USUAL_DEPTH = 1.01
"""Depth of the frame behind a root over half a rib, for which beams are sized; up to here no error is added."""


def with_auto_scheme(spec: Spec) -> Spec:
    """Return `spec` with the drive scheme set to 'auto': what does not depend on the scheme is then cached once."""
    return replace(spec, drive=replace(spec.drive, scheme="auto"))


def plan_channels(spec: Spec, sized: Sequence[SizedChannel], sites: Sequence[Site]) -> tuple[Channel, ...]:
    """Return the channels of a coil, before `driven` fills in the fields that depend on the drive scheme."""
    return _plan_channels(with_auto_scheme(spec), tuple(sized), tuple(sites), COILS.version(spec.coil.kind))


@lru_cache(maxsize=256)
def _plan_channels(
    spec: Spec, sized: tuple[SizedChannel, ...], sites: tuple[Site, ...], coil_version: int
) -> tuple[Channel, ...]:
    law = level_law(spec)
    sag_m, alpha = np.array([(float(s.model.sag_m), float(s.model.hardening_per_m2)) for s in sized]).T
    sag_um = sag_m / UM
    rest = resting(spec, sized, sites)
    hanging_um = hanging_gap_um(spec, sag_um)
    gap_um, soft = (hanging_um, np.ones(len(sized))) if rest is None else finite_rest(rest, hanging_um)
    core_um = hanging_um - gap_um
    resonance = np.array([float(s.model.resonance_hz) for s in sized]) * np.sqrt(soft)
    level = law(resonance)
    threshold_um = law.threshold_um(resonance)
    level_um = spec.drive.level_um * level / level[0]
    level_m = level_um * UM
    rise = resonance_rise(alpha, level_m, sag_m)
    kept = level_kept(alpha, spec.q_min, level_m, sag_m)
    pulled = site_pulls(spec, sites, gap_um)
    exponent = pull_exponent(pulled, gap_um)
    distance_m = np.array([site.coil_distance_mm for site in sites]) * MM
    remanent = mover_of(spec).remanent_currents(spec.coil, spec.washer_or_magnet, spec.drive.remanent_share, distance_m)
    wrench = site_wrenches(spec, pulled, sites)
    tau_ms = ring_up_time(resonance, spec.q_min) / MS
    # The ON amplitude over what counts as quiet: the detection threshold where the spec has one, else 1/Δy of it.
    quiet = np.full(len(resonance), spec.delta_y) if threshold_um is None else level_um / threshold_um
    deep_error = _deep_frame_errors(sized, tuple(site.frame_depth_mm for site in sites))
    radius_m = spec.washer_or_magnet.outer_diameter_mm / 2 * MM
    printer = spec.printer
    modes = [with_softer_working_mode(taxel_modes(s.model), float(share)) for s, share in zip(sized, soft, strict=True)]
    constants = (pulled.pull * working_mode_ratios(modes, wrench)).tolist()
    force_errors = [
        force_error(taxel, turned, float(error), radius_m)
        for taxel, turned, error in zip(modes, wrench, pulled.error, strict=True)
    ]
    channels = []
    for i, (item, site) in enumerate(zip(sized, sites, strict=True)):
        stiffness = float(item.model.stiffness_n_per_m * soft[i])
        beam_error = item.model.beam_error
        width, thickness, length = (float(v) for v in item.beam)
        force_mn = float(level_um[i]) * UM * stiffness / spec.q_min / MN
        channels.append(
            Channel(
                index=i,
                resonance_hz=float(resonance[i]),
                drive_hz=float(resonance[i]) / 2,
                q=spec.q_min,
                beam=Beam(
                    width_mm=width,
                    thickness_mm=thickness,
                    length_mm=length,
                    topology=item.topology,
                    fillet_mm=float(fillet_mm(spec, item.model.arrangement)),
                    count=len(item.model.arrangement.beams),
                    layers=round((thickness - printer.first_layer_mm) / printer.layer_mm) + 1,
                ),
                effective_mass_g=float(item.model.effective_mass_kg) / GRAM,
                stiffness_n_per_m=stiffness,
                ring_up_ms=float(tau_ms[i]),
                ring_down_ms=float(tau_ms[i]) * max(log(quiet[i]), 0.0),
                level_um=float(level_um[i]),
                rule_hz=float(item.model.rule_hz),
                target_hz=item.target_hz,
                second_mode_hz=item.model.second_mode[0],
                second_mode_share=item.model.second_mode[1],
                **mode_fields(modes[i], wrench[i]),
                sag_um=float(sag_um[i]),
                hardening_per_mm2=float(alpha[i]) * MM**2,
                level_shift=float(rise[i]),
                level_loss_db=-decibel(float(kept[i])),
                root_stress_mpa=float(item.model.root_stress_pa(level_um[i] * UM)) / MPA,
                print_spread=float(frequency_spread(item.beam, spec.spread, item.model.exponents)),
                force_mn=force_mn,
                force_constant_n_per_a2=constants[i],
                line_a2=wanted_line_a2(force_mn, constants[i]),
                force_error=force_errors[i],
                pull_exponent=float(exponent[i]),
                remanent_ma=float(remanent[i]) / MA,
                static_um=float(core_um[i]),
                pull_shift=1 - sqrt(soft[i]),
                model="beam" if beam_error is None else "solid",
                model_error=float(item.model.error_estimate) + float(deep_error[i]),
                mode_errors=tuple((item.model.mode_errors + deep_error[i]).tolist()),
                sag_error=float(item.model.sag_error) + 2 * float(deep_error[i]),
                static_error=item.model.compliance_error + 2 * float(deep_error[i]) + float(force_errors[i]),
                stress_error=item.model.stress_error + 2 * float(deep_error[i]),
                beam_error=beam_error,
                site=site,
                pin=pin_of(spec, item.model, site),
            )
        )
    return tuple(channels)


def force_constants(spec: Spec, sized: Sequence[SizedChannel], sites: Sequence[Site]) -> np.ndarray:
    """Return the channels' `force_constant_n_per_a2` (n,) alone, faster than by `plan_channels`."""
    sag_um = np.array([float(s.model.sag_m) for s in sized]) / UM
    rest = resting(spec, sized, sites)
    hanging_um = hanging_gap_um(spec, sag_um)
    pulled = site_pulls(spec, sites, hanging_um if rest is None else finite_rest(rest, hanging_um)[0])
    share = working_mode_ratios([taxel_modes(s.model) for s in sized], site_wrenches(spec, pulled, sites))
    return np.asarray(pulled.pull * share)


def unpulled(channels: Iterable[Channel]) -> int:
    """Return how many of the channels have a mover that the coil does not pull, as it lies too far off its axis."""
    return sum(channel.force_constant_n_per_a2 <= 0 for channel in channels)


def site_pulls(spec: Spec, sites: Sequence[Site], gap_um: np.ndarray) -> PullAt:
    """Return the pulls (n,) on the movers of `sites`, each over its own gap (n,) in µm."""
    return mover_of(spec).pulls(
        spec.coil,
        spec.washer_or_magnet,
        gap_um * UM,
        np.array([site.washer_mm for site in sites]) * MM,
        *spec.ballast_argument,
    )


def pull_exponent(pulled: PullAt, gap_um: np.ndarray) -> np.ndarray:
    """Return the exponent m (n,) of ``pull ∝ gap^−m`` about each gap (n,) in µm; 0 for washers that are not pulled."""
    return np.asarray(
        np.divide(-pulled.slope * gap_um * UM, pulled.pull, out=np.zeros(len(gap_um)), where=pulled.pull > 0)
    )


def hanging_gap_um(spec: Spec, sag_um: np.ndarray | float) -> np.ndarray:
    """Return the gap in µm below a washer that sags by `sag_um`, but at least a tenth of the spec's gap."""
    gap_um = spec.coil.gap_mm * MM / UM
    return np.maximum(gap_um - sag_um, gap_um / 10)


def resting(spec: Spec, sized: Sequence[SizedChannel], sites: Sequence[Site]) -> CoreRest | None:
    """Return where movers at `sites` come to rest, drawn by their coils' cores; None where no core draws them."""
    gap_um = hanging_gap_um(spec, np.array([float(s.model.sag_m) for s in sized]) / UM)
    stiffness = np.array([float(s.model.stiffness_n_per_m) for s in sized])
    return core_rest(spec, gap_um, [site.coil_distance_mm for site in sites], stiffness)


def with_softer_working_mode(modes: TaxelModes, share: float) -> TaxelModes:
    """Return `modes` with the stiffness of the working mode reduced to `share` of its value."""
    if share == 1:
        return modes
    frequency = modes.frequency_hz.copy()
    frequency[modes.working] *= sqrt(share)
    return modes._replace(frequency_hz=frequency)


def driven(spec: Spec, channels: Sequence[Channel], scheme: Scheme) -> tuple[Channel, ...]:
    """Return `channels` with the current frequencies, static deflections and resonance shifts of a drive `scheme`."""
    sets = channel_sets(channels, spec.coil.sets)
    means = [
        mean_pull_line(scheme, np.array([c.line_a2 for c in channel_set]), spec.drive.headroom) for channel_set in sets
    ]
    result = []
    for channel in channels:
        gap_um = float(hanging_gap_um(spec, channel.sag_um))
        pull_n = means[channel.index % len(sets)] * channel.force_constant_n_per_a2
        slack_um = pull_n / channel.stiffness_n_per_m / UM
        exponent = max(channel.pull_exponent, 0.0)
        static_um = balanced_deflection(slack_um, gap_um, exponent)
        # With F = k z at balance the stiffness falls by the share (dF/dz)/k, the resonance by half of that.
        shift = 0.0 if static_um is None else exponent * static_um / (gap_um - static_um) / 2
        static_um = gap_um if static_um is None else static_um
        drive_hz = channel.resonance_hz if scheme.at_resonance else channel.resonance_hz / 2
        if scheme.force_order == 1:  # at rest as with all channels on
            static_um = channel.static_um
            shift = channel.pull_shift
        result.append(replace(channel, drive_hz=drive_hz, static_um=static_um, pull_shift=shift))
    return tuple(result)


def wanted_line_a2(force_mn: float, force_constant_n_per_a2: float) -> float:
    """Return the amplitude in A² of the spectral line of i² that makes a force in mN; 0 for washers not pulled."""
    return force_mn * MN / force_constant_n_per_a2 if force_constant_n_per_a2 > 0 else 0.0


DEEP_SHIFTS = 2.25
"""Error of a resonance on a deep frame over the shift that the beam model makes of the depth."""


@lru_cache(maxsize=256)
def _deep_frame_errors(sized: tuple[SizedChannel, ...], depth_mm: tuple[float, ...]) -> np.ndarray:
    """Return extra relative errors (n,) of resonances where a beam's root is backed by more than half a rib; else 0.

    Beams are sized for half a rib. The error is `DEEP_SHIFTS` times the shift that the beam model finds with the true
    depth; that covers 96 % of 53 random taxels (docs/accuracy.md).
    """
    error = np.zeros(len(sized))
    depth = np.array(depth_mm)
    models = [item.model for item in sized]
    deep = [i for i, m in enumerate(models) if m.beam_error is None and depth[i] >= m.spec.pad.rib_mm / 2 * USUAL_DEPTH]
    for topology in {models[i].topology for i in deep}:
        same_kind = [i for i in deep if models[i].topology == topology]
        beam = BeamShape(*np.array([models[i].beam for i in same_kind], float).T)
        true = replace(models[same_kind[0]], beam=beam, frame_depth_mm=depth[same_kind], member_of=None)
        error[same_kind] = DEEP_SHIFTS * np.abs(true.resonance_hz / [models[i].resonance_hz for i in same_kind] - 1)
    return error
