"""Fit of a printer to measured prints: the offsets of height and width of its beams, and the modulus.

The model of a print's resonances is the beam model with beams that are ``z_offset`` thicker and ``width_offset`` wider
than drawn, and with the modulus E. Measured resonances scatter about it by the spread of prints
(`padgen.planner.printed_pads`), by the error of the measurement, and by the model's own error, which all taxels of a
channel share. The three terms are found by generalised least squares, in Gauss-Newton steps, since the model is nearly
linear over some hundredths of a millimetre.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.measured.fits import TaxelFit
from padgen.planner.plan import Plan
from padgen.planner.printed_pads import covariance, design_of, log_resonances, spreads_of
from padgen.spec import Spec
from padgen.spec.load import without_none

__all__ = ["Calibration", "calibrated", "printer_toml"]

TERMS = ("z_offset_mm", "width_offset_mm", "log_modulus")
WIDTH_BIAS_MM = 0.06
"""Assumed bias of a width before a calibration: three times a usual XY compensation."""
REQUIRED = 0.6
"""Largest one sigma of a calibrated term, over the term's bias before the calibration."""
ALIKE = 3e-3
"""Ratio of smallest to largest singular value of normalised columns below which beams cannot tell the terms apart."""
STEPS = 8
STEP_MM = 1e-3
SETTLED = 1e-9
LEAST_LIKELY = 1e-4
"""Least probability of a larger chi-square; below it, measurements contradict each other or the model."""
FARTHEST_SIGMAS = 5.0
"""Largest change of a term, over its bias before the calibration and its error: beyond it, another pad was measured."""
SAME_PAD = "is this the plan that was printed, with this printer and material?"


@dataclass(frozen=True, slots=True)
class Calibration:
    """Offsets in mm and modulus in GPa of a printer and a material, with one sigma of each.

    `correlation` (3, 3) is of z offset, width offset and ln E. `chi_square` is about as large as `freedom`, the degrees
    of freedom, where the measurements scatter as the spec says.
    """

    z_offset_mm: float
    z_offset_error_mm: float
    width_offset_mm: float
    width_offset_error_mm: float
    modulus_gpa: float
    modulus_error_gpa: float
    correlation: tuple[tuple[float, ...], ...]
    chi_square: float
    freedom: int
    prints: int
    taxels: int


def calibrated(plan: Plan, prints: Sequence[Sequence[TaxelFit]]) -> Calibration:
    """Fit a printer's offsets of beam height and width, and its modulus, to the measured taxels of prints of `plan`.

    Raises
    ------
    SolverError
        There are too few taxels, they cannot tell the three terms apart, or the measurements contradict each other, or
        are of another pad or printer.
    """
    from scipy.stats import chi2

    place = {taxel.id: i for i, taxel in enumerate(plan.taxels)}
    index = [np.array([place[fit.id] for fit in fits]) for fits in prints]
    measured = np.log([fit.resonance_hz for fits in prints for fit in fits])
    if len(measured) <= len(TERMS):
        raise SolverError(f"{len(measured)} taxels were measured, at least {len(TERMS) + 1} are needed")
    if len({tuple(fit.resonance_hz for fit in fits) for fits in prints}) < len(prints):
        raise SolverError("the same measurement was given as two prints; give each print once")
    channel = np.array([taxel.channel for taxel in plan.taxels])[np.concatenate(index)]
    lower = np.linalg.cholesky(_scatter(plan, prints, index, channel))
    start = np.array([plan.spec.printer.z_offset_mm, plan.spec.printer.width_offset_mm, 0.0])
    terms = start.copy()
    smallest = np.min([(c.beam.thickness_mm, c.beam.width_mm) for c in plan.channels], axis=0)
    farthest = np.append(smallest / 2, 3.0)
    for k in range(STEPS):
        value, slope = _model(plan, terms)
        weighed = np.linalg.solve(lower, slope[channel])
        left = np.linalg.solve(lower, measured - value[channel])
        if k == 0:  # by the beams as drawn: measurements of another pad lead far away from them
            size = np.linalg.svd(weighed / np.linalg.norm(weighed, axis=0), compute_uv=False)
            if not size[-1] > ALIKE * size[0]:
                raise SolverError(
                    "the beams that were measured differ too little in thickness and width to tell height, width and"
                    " modulus apart; measure a pad whose channels differ in both (padgen build calibration)"
                )
            _refuse_vague(plan.spec, np.sqrt(np.diag(np.linalg.inv(weighed.T @ weighed))))
        step = np.linalg.lstsq(weighed, left, rcond=None)[0]
        # Measurements that contradict each other must not make a beam vanish.
        terms = np.clip(terms + step, -farthest, farthest)
        if np.abs(step).max() < SETTLED:
            break
    spread = np.linalg.inv(weighed.T @ weighed)
    sigma = np.sqrt(np.diag(spread))
    rest = left - weighed @ step
    chi_square = float(rest @ rest)
    freedom = len(measured) - len(TERMS)
    if chi2.sf(chi_square, freedom) < LEAST_LIKELY:
        raise SolverError(
            f"the measurements lie {number((chi_square / freedom) ** 0.5)} times as far from any one printer as prints"
            f" differ (chi-square {number(chi_square)} of {freedom}): {SAME_PAD}"
        )
    _refuse_far(plan.spec, terms - start, sigma)
    modulus = plan.spec.material.youngs_modulus_gpa * float(np.exp(terms[2]))
    return Calibration(
        z_offset_mm=float(terms[0]),
        z_offset_error_mm=float(sigma[0]),
        width_offset_mm=float(terms[1]),
        width_offset_error_mm=float(sigma[1]),
        modulus_gpa=modulus,
        modulus_error_gpa=modulus * float(sigma[2]),
        correlation=tuple(map(tuple, (spread / np.outer(sigma, sigma)).tolist())),
        chi_square=chi_square,
        freedom=freedom,
        prints=len(prints),
        taxels=len(measured),
    )


def _model(plan: Plan, terms: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ln f (n,) of the channels' resonances f, and its derivatives (n, 3) by the three `terms`.

    The offsets are of height and of width, in mm; the modulus counts over the planned one.
    """
    printer = plan.spec.printer
    sizes = np.array([(c.beam.width_mm, c.beam.thickness_mm, c.beam.length_mm) for c in plan.channels])
    move = np.array([terms[1] - printer.width_offset_mm, terms[0] - printer.z_offset_mm, 0.0])
    steps = STEP_MM * np.array([[0, 0, 0], [0, 1, 0], [0, -1, 0], [1, 0, 0], [-1, 0, 0]])
    log_hz = log_resonances(plan, sizes[:, None] + move + steps) + 0.5 * terms[2]
    thicker, wider = (log_hz[:, [1, 3]] - log_hz[:, [2, 4]]).T / (2 * STEP_MM)
    slope = np.stack([thicker, wider, np.full(len(sizes), 0.5)], axis=1)
    # The resonance as drawn is the plan's, which may be solved by finite elements; the beam model gives the shift.
    drawn = log_resonances(plan, sizes[:, None])[:, 0]
    return np.log([c.resonance_hz for c in plan.channels]) + log_hz[:, 0] - drawn, slope


def _scatter(
    plan: Plan, prints: Sequence[Sequence[TaxelFit]], index: Sequence[np.ndarray], channel: np.ndarray
) -> np.ndarray:
    """Return the covariance of the logarithms of all measured resonances.

    The spread of prints correlates taxels of one print, the model's own error taxels of one channel.
    """
    planned_covariance = covariance(design_of(plan, None), spreads_of(plan.spec))
    model = np.array([c.model_error for c in plan.channels])[channel]
    total = np.where(channel[:, None] == channel, np.outer(model, model), 0.0)
    first = 0
    for part, fits in zip(index, prints, strict=True):
        here = slice(first, first + len(part))
        total[here, here] += planned_covariance[np.ix_(part, part)]
        total[here, here] += np.diag([(fit.resonance_error_hz / fit.resonance_hz) ** 2 for fit in fits])
        first += len(part)
    return total


def _assumed_biases(spec: Spec) -> tuple[tuple[str, str, float], ...]:
    """Return name, unit and assumed bias of height offset, width offset and modulus before a calibration."""
    bias = spec.spread
    return (
        ("offset of height", "mm", bias.z_bias_mm),
        ("offset of width", "mm", WIDTH_BIAS_MM),
        ("modulus", "of its value", bias.modulus_bias),
    )


def _refuse_vague(spec: Spec, sigma: np.ndarray) -> None:
    """Raise SolverError if the fit leaves an offset or the modulus hardly more certain than it was before."""
    for (name, unit, before), known in zip(_assumed_biases(spec), sigma.tolist(), strict=True):
        if known > REQUIRED * before:
            raise SolverError(
                f"the {name} would be known to ± {number(known)} {unit}, must be"
                f" ± {number(REQUIRED * before)} at most (± {number(before)} before any calibration); plan with"
                " --model solid, measure more prints, or beams that differ more in thickness and width (padgen build"
                " calibration)"
            )


def _refuse_far(spec: Spec, change: np.ndarray, sigma: np.ndarray) -> None:
    """Raise SolverError if an offset or the modulus is further off than on any printer: another pad was measured."""
    for (name, unit, before), far, known in zip(_assumed_biases(spec), change.tolist(), sigma.tolist(), strict=True):
        most = FARTHEST_SIGMAS * float(np.hypot(before, known))
        if abs(far) > most:
            off = float(np.expm1(far)) if name == "modulus" else far
            raise SolverError(
                f"the {name} would be off by {off:+.5g} {unit}, expected is ± {number(before)} and at most"
                f" {FARTHEST_SIGMAS:g} times that: {SAME_PAD}"
            )


def printer_toml(spec: Spec, calibration: Calibration, name: str) -> str:
    """Return the TOML file of a calibrated printer, which a spec names as ``printer = "my-printer.toml"``."""
    comment = (
        f"padgen calibrate: {calibration.prints} prints, {calibration.taxels} taxels,"
        f" chi-square {number(calibration.chi_square)}"
    )
    printer = replace(
        spec.printer,
        name=name,
        z_offset_mm=round(calibration.z_offset_mm, 6),
        width_offset_mm=round(calibration.width_offset_mm, 6),
        source=f"{spec.printer.name}; {comment} of {calibration.freedom}",
    )
    spread = replace(
        spec.spread,
        name=name,
        z_bias_mm=round(calibration.z_offset_error_mm, 6),
        modulus_bias=round(calibration.modulus_error_gpa / calibration.modulus_gpa, 6),
        source=f"{spec.spread.name}; biases {comment}",
    )
    material = replace(spec.material, youngs_modulus_gpa=round(calibration.modulus_gpa, 6), source=comment)
    lines = []
    for table, part in (("printer", printer), ("spread", spread), ("material", material)):
        # JSON's words for what a spec has are TOML's too.
        rows = (f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in without_none(asdict(part)).items())
        lines += [f"[{table}]", *rows, ""]
    return "\n".join(lines)
