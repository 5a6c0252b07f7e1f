"""Fit stiffness, damping and mass of a finger to taxels that were measured touched and untouched.

Of a taxel of effective mass M whose skin moves by the lever n (`padgen.planner.plan.Pin.load_lever`), each measurement
is of a mode with a spring and a damper. What the finger adds to them is, at the touched resonance ω₁,

    k − m ω₁² = M (ω₁² − ω₀²)/n²        c = (M (ω₁/Q₁ − ω₀/Q₀) + n² m ω₁/Q₁)/n²

Taxels of several resonances tell k and m apart; what they do not tell of m is taken as that of typical skin under the
contactor, with an error as large as itself. M is the beam model's, a share of it is uncertain.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, pi

import numpy as np

from padgen.core.errors import SolverError, number
from padgen.core.units import GRAM
from padgen.measured.fits import TaxelFit
from padgen.planner.plan import Channel, Plan
from padgen.planner.touch import contactor_of, skin_contact

__all__ = ["FingerFit", "TouchedTaxel", "finger_toml", "fit_finger"]

MASS_SHARE = 0.02
"""Relative error of the effective mass of a taxel: plastic, glue and movers that were not weighed (assumed)."""
LEAST_RISE = 3.0
"""Rise of the resonance under the finger over its error, below which a taxel tells nothing of the finger."""


@dataclass(frozen=True, slots=True)
class TouchedTaxel:
    """A taxel measured untouched and touched, and what the finger adds to it, with one sigma of each.

    `added_n_per_m` is k − m ω² at the touched resonance, `damping_n_s_per_m` is c there, both at the skin.
    """

    id: str
    untouched_hz: float
    untouched_q: float
    touched_hz: float
    touched_q: float
    added_n_per_m: float
    added_error_n_per_m: float
    damping_n_s_per_m: float
    damping_error_n_s_per_m: float


@dataclass(frozen=True, slots=True)
class FingerFit:
    """Stiffness, damping and mass of a finger under a contactor, with one sigma of each.

    Errors count how much the taxels differ (`places`, sigma of ln k, 0 of one taxel). `mass_is_measured` is False
    where the taxels did not tell the mass.
    """

    diameter_mm: float
    k_n_per_m: float
    k_error_n_per_m: float
    c_n_s_per_m: float
    c_error_n_s_per_m: float
    m_g: float
    m_error_g: float
    mass_is_measured: bool
    places: float
    taxels: tuple[TouchedTaxel, ...]


def fit_finger(plan: Plan, untouched: Sequence[TaxelFit], touched: Sequence[TaxelFit]) -> FingerFit:
    """Fit the finger's stiffness, damping and mass to taxels that were measured both untouched and touched.

    Raises
    ------
    SolverError
        No taxel was measured both ways, or the finger raises no resonance by more than its error.
    """
    bare = {fit.id: fit for fit in untouched}
    channels = {taxel.id: plan.channels[taxel.channel] for taxel in plan.taxels}
    pairs = [(bare[fit.id], fit, channels[fit.id]) for fit in touched if fit.id in bare]
    if not pairs:
        raise SolverError("no taxel was measured both touched and untouched; measure the same ones", "--touched")
    contactor = contactor_of(plan.spec)
    typical_kg = float(skin_contact("fingertip", "typical").impedance(0.0, contactor).mass)
    pairs = [pair for pair in pairs if _is_raised(*pair[:2])]
    if not pairs:
        raise SolverError(
            "the finger raises the resonance of no taxel by more than its error: press harder, or take a wider pin",
            "--touched",
        )
    k, k_error, m, m_error = _stiffness_and_mass(pairs, typical_kg)
    taxels = tuple(_touched_taxel(*pair, m) for pair in pairs)
    c, c_error = _mean(
        [taxel.damping_n_s_per_m for taxel in taxels], [taxel.damping_error_n_s_per_m for taxel in taxels]
    )
    stiffnesses = np.array([taxel.added_n_per_m + m * (2 * pi * taxel.touched_hz) ** 2 for taxel in taxels])
    spread = float(np.log(np.maximum(stiffnesses, k / 100)).std(ddof=1)) if len(taxels) > 1 else 0.0
    return FingerFit(
        diameter_mm=plan.spec.contact_diameter_mm,
        k_n_per_m=k,
        k_error_n_per_m=float(np.hypot(k_error, MASS_SHARE * k)),
        c_n_s_per_m=c,
        c_error_n_s_per_m=float(np.hypot(c_error, MASS_SHARE * c)),
        m_g=m / GRAM,
        m_error_g=m_error / GRAM,
        mass_is_measured=m_error < MASS_IS_KNOWN * typical_kg,
        places=spread,
        taxels=taxels,
    )


MASS_IS_KNOWN = 0.5
"""Error of the mass over that of typical skin, below which the taxels have measured it."""


def _is_raised(bare: TaxelFit, pressed: TaxelFit) -> bool:
    error = np.hypot(bare.resonance_error_hz, pressed.resonance_error_hz)
    return pressed.resonance_hz - bare.resonance_hz > LEAST_RISE * error


def _touched_taxel(bare: TaxelFit, pressed: TaxelFit, channel: Channel, skin_kg: float) -> TouchedTaxel:
    """Return the stiffness and damping that the finger adds to a taxel, with errors propagated from both fits.

    The finger's mass is taken as `skin_kg`.
    """
    share = channel.effective_mass_g * GRAM / channel.pin.load_lever**2
    low, high = (2 * pi * fit.resonance_hz for fit in (bare, pressed))
    low_error, high_error = (2 * pi * fit.resonance_error_hz for fit in (bare, pressed))
    whole = share + skin_kg
    damped = whole * high / pressed.q
    damped_error = damped * np.hypot(pressed.q_error / pressed.q, high_error / high)
    bare_damping = share * low / bare.q
    bare_damping_error = bare_damping * np.hypot(bare.q_error / bare.q, low_error / low)
    return TouchedTaxel(
        id=pressed.id,
        untouched_hz=bare.resonance_hz,
        untouched_q=bare.q,
        touched_hz=pressed.resonance_hz,
        touched_q=pressed.q,
        added_n_per_m=share * (high**2 - low**2),
        added_error_n_per_m=float(2 * share * np.hypot(high * high_error, low * low_error)),
        damping_n_s_per_m=damped - bare_damping,
        damping_error_n_s_per_m=float(np.hypot(damped_error, bare_damping_error)),
    )


Pair = tuple[TaxelFit, TaxelFit, Channel]


def _stiffness_and_mass(pairs: Sequence[Pair], typical_kg: float) -> tuple[float, float, float, float]:
    """Return stiffness in N/m and mass in kg, each with one sigma, by least squares with a typical mass as prior.

    Taxels that differ by more than their errors raise the errors of both (chi-square per degree of freedom).
    """
    rough = [_touched_taxel(*pair, typical_kg) for pair in pairs]
    y = np.array([taxel.added_n_per_m for taxel in rough])
    sigma = np.array([taxel.added_error_n_per_m for taxel in rough])
    square = np.array([(2 * pi * taxel.touched_hz) ** 2 for taxel in rough])
    rows = np.stack([np.ones(len(y)), -square], 1)
    spread = 0.0
    for _ in range(ROUNDS):
        weight = 1 / np.hypot(sigma, spread)
        scaled = np.concatenate([rows * weight[:, None], [[0.0, 1 / typical_kg]]])
        wanted = np.append(y * weight, 1.0)
        size = np.array([1.0, 1 / square.mean()])
        inverse = np.linalg.inv((scaled * size).T @ (scaled * size)) * np.outer(size, size)
        k, m = inverse @ scaled.T @ wanted
        # What the taxels differ by beyond their errors belongs to the places of the finger.
        left = y - rows @ (k, m)
        excess = float((left**2).sum() / max(len(y) - 1, 1) - (sigma**2).mean())
        spread = max(excess, 0.0) ** 0.5
    m = max(float(m), 0.0)
    return float(k), float(inverse[0, 0] ** 0.5), m, float(inverse[1, 1] ** 0.5)


ROUNDS = 4


def _mean(values: Sequence[float], errors: Sequence[float]) -> tuple[float, float]:
    """Return the weighted mean of values and its error, which counts the spread beyond the `errors` of the values."""
    y = np.array(values)
    sigma = np.array(errors)
    spread = 0.0
    mean = error = inf
    for _ in range(ROUNDS):
        weight = 1 / (sigma**2 + spread**2)
        mean = float((y * weight).sum() / weight.sum())
        error = float(weight.sum() ** -0.5)
        excess = float(((y - mean) ** 2).sum() / max(len(y) - 1, 1) - (sigma**2).mean())
        spread = max(excess, 0.0) ** 0.5
    return mean, error


def finger_toml(plan: Plan, finger: FingerFit) -> str:
    """Return the fitted finger as a TOML table ``[touch]``, for specs with contactors of the same diameter."""
    mass = "measured" if finger.mass_is_measured else "of typical skin, the taxels do not tell it"
    table = {
        "contact": "own",
        "k_n_per_m": float(number(finger.k_n_per_m)),
        "c_n_s_per_m": float(number(finger.c_n_s_per_m)),
        "m_g": float(number(finger.m_g)),
    }
    lines = [
        f"# padgen retune --touched: a finger on {len(finger.taxels)} taxels of {plan.name}, contactors of"
        f" {number(finger.diameter_mm)} mm.",
        f"# k ± {number(finger.k_error_n_per_m)} N/m, c ± {finger.c_error_n_s_per_m:.2g} N s/m,"
        f" m ± {finger.m_error_g:.2g} g ({mass}); from taxel to taxel k differs by {finger.places:.0%}.",
        "[touch]",
        *(f"{key} = {json.dumps(value)}" for key, value in table.items()),
    ]
    return "\n".join(lines) + "\n"
