"""How strongly each channel is to vibrate when ON: level laws, up to one common factor."""

import numpy as np

__all__ = ["LevelLaw"]


class LevelLaw:
    """ON displacement against frequency.

    Either ``D ∝ f^−p`` (p = 0 equal displacement, 1 velocity, 2 acceleration) or equal sensation: in
    proportion to a detection threshold that is given at a few frequencies, straight between them on
    logarithmic axes, with bends at `bends_log_hz`, ln of its frequencies (empty for a power law).
    """

    def __init__(self, exponent: float, curve_hz: tuple[float, ...] = (), curve_um: tuple[float, ...] = ()) -> None:
        self.exponent = exponent
        self._parts = exponent, tuple(curve_hz), tuple(curve_um)
        self.bends_log_hz, self._log_um = np.log(curve_hz), np.log(curve_um)

    def __call__(self, resonance_hz: np.ndarray) -> np.ndarray:
        """Displacements (n,) for resonances (n,) in Hz."""
        threshold = self.threshold_um(resonance_hz)
        if threshold is not None:
            return threshold
        level: np.ndarray = np.asarray(resonance_hz, float) ** -self.exponent
        return level

    def threshold_um(self, resonance_hz: np.ndarray) -> np.ndarray | None:
        """The curve in µm at `resonance_hz`; None for a power law, which knows no threshold."""
        if not len(self.bends_log_hz):
            return None
        threshold: np.ndarray = np.exp(np.interp(np.log(resonance_hz), self.bends_log_hz, self._log_um))
        return threshold

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LevelLaw) and self._parts == other._parts

    def __hash__(self) -> int:
        return hash(self._parts)
