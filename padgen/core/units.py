"""The only unit conversions of padgen.

Specs and plans use millimetre, gram and gigapascal, as drawings and catalogues do; `physics` uses SI. ``length_mm *
MM`` is metres and ``length_m / MM`` is millimetres; the others work alike.
"""

from math import log10

__all__ = [
    "GPA",
    "GRAM",
    "GRAVITY_M_PER_S2",
    "G_PER_CM3",
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
G_PER_CM3 = 1e3
MH = 1e-3
MN = 1e-3
MA = 1e-3
MS = 1e-3
GRAVITY_M_PER_S2 = 9.80665


def decibel(ratio: float) -> float:
    """Return an amplitude ratio in dB; -inf for 0."""
    return 20.0 * log10(ratio) if ratio > 0 else float("-inf")
