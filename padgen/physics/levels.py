"""Level laws: the ON vibration of each channel against its frequency, up to one common factor."""

import numpy as np

__all__ = ["LevelLaw"]


class LevelLaw:
    """ON displacement against frequency.

    Either a power law ``D ∝ f^−p`` (p = 0 equal displacement, 1 velocity, 2 acceleration), or equal sensation: in
    proportion to a detection threshold that is given at a few frequencies and joined by straight lines on logarithmic
    axes. `bends_log_hz` is ln of these frequencies, empty for a power law.
    """

    def __init__(self, exponent: float, curve_hz: tuple[float, ...] = (), curve_um: tuple[float, ...] = ()) -> None:
        self.exponent = exponent
        self._parts = exponent, tuple(curve_hz), tuple(curve_um)
        self.bends_log_hz, self._log_um = np.log(curve_hz), np.log(curve_um)

    def __call__(self, resonance_hz: np.ndarray) -> np.ndarray:
        """Return displacements (n,) for resonances (n,) in Hz, in any unit."""
        threshold = self.threshold_um(resonance_hz)
        if threshold is not None:
            return threshold
        level: np.ndarray = np.asarray(resonance_hz, float) ** -self.exponent
        return level

    def threshold_um(self, resonance_hz: np.ndarray) -> np.ndarray | None:
        """Return the threshold in µm at `resonance_hz`; None for a power law."""
        if not len(self.bends_log_hz):
            return None
        threshold: np.ndarray = np.exp(np.interp(np.log(resonance_hz), self.bends_log_hz, self._log_um))
        return threshold

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LevelLaw) and self._parts == other._parts

    def __hash__(self) -> int:
        return hash(self._parts)
