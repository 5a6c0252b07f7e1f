"""Unit conversions, all that padgen has; the acceleration of gravity, and constants of copper.

Specs and plans use millimetre, gram and gigapascal, as drawings and catalogues do; `physics` uses SI. ``length_mm *
MM`` is metres and ``length_m / MM`` is millimetres; the others work alike.
"""

from math import log10

__all__ = [
    "COPPER_C",
    "COPPER_J_PER_M3_K",
    "COPPER_KG_PER_M3",
    "COPPER_MELTS_C",
    "COPPER_OHM_M",
    "COPPER_PER_K",
    "GPA",
    "GRAM",
    "GRAVITY_M_PER_S2",
    "G_PER_CM3",
    "KPA",
    "MA",
    "MG",
    "MH",
    "MM",
    "MN",
    "MPA",
    "MS",
    "UM",
    "decibel",
]

MM = 1e-3
UM = 1e-6
GRAM = 1e-3
MG = 1e-6
GPA = 1e9
MPA = 1e6
KPA = 1e3
G_PER_CM3 = 1e3
MH = 1e-3
MN = 1e-3
MA = 1e-3
MS = 1e-3
GRAVITY_M_PER_S2 = 9.80665
COPPER_OHM_M = 1.72e-8
COPPER_KG_PER_M3 = 8960.0
COPPER_J_PER_M3_K = 3.45e6
COPPER_PER_K = 3.93e-3
COPPER_C = 20.0
COPPER_MELTS_C = 1085.0
"""Copper: resistivity, density, heat capacity (8960 kg/m³ times 385 J/(kg K)), the relative rise of its resistance
per K, at `COPPER_C` (IEC 60028), and where it melts."""


def decibel(ratio: float) -> float:
    """Return an amplitude ratio in dB; -inf for 0."""
    return 20.0 * log10(ratio) if ratio > 0 else float("-inf")
