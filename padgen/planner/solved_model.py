"""Model a taxel by modes that finite elements solved for its printed solid, in place of the beam model."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from padgen.physics.modal import TaxelModes
from padgen.physics.modes import Modes
from padgen.planner.taxel_model import TaxelModel
from padgen.spec import Spec

__all__ = ["SolvedModel", "asked_error", "solved_model"]

FINEST = 2e-3
"""Smallest relative error of a resonance that finite elements are asked for."""


@dataclass(frozen=True)
class SolvedModel(TaxelModel):
    """One taxel by 3-D elasticity: `solved` has its modes, `solver_error` their relative error.

    Sag and stress are the beam model's, scaled by the ratio of the working modes' stiffnesses: both go with the bending
    moment at a beam's root.
    """

    solved: TaxelModes
    solver_error: float

    @cached_property
    def beam_model(self) -> TaxelModel:
        """The beam model of the same taxel."""
        return TaxelModel(self.spec, self.topology, self.plate, self.beam)

    @cached_property
    def modes(self) -> Modes:
        """The solved modes, referred to the washer's axis."""
        return Modes(self.solved.frequency_hz, self.solved.motion.T, self.washer_point_m)

    @property
    def error_estimate(self) -> np.ndarray:
        """Relative error of the resonance by finite elements."""
        return np.asarray(self.solver_error)

    @property
    def beam_error(self) -> float | None:
        """Relative error of the beam model's resonance, against the solved one."""
        return float(self.beam_model.resonance_hz / self.resonance_hz - 1)

    @property
    def sag_m(self) -> np.ndarray:
        """Sag in m of the washer under the weight of the taxel."""
        return np.asarray(self.beam_model.sag_m / self._stiffness_ratio)

    @property
    def hardening_per_m2(self) -> np.ndarray:
        """Hardening in 1/m² by beams that stretch, from the beam model."""
        return self.beam_model.hardening_per_m2

    def root_stress_pa(self, level_m: np.ndarray) -> np.ndarray:
        """Return the largest bending stress in Pa of the beams when the washer moves by `level_m`."""
        return np.asarray(self.beam_model.root_stress_pa(level_m) * self._stiffness_ratio)

    @property
    def _stiffness_ratio(self) -> np.ndarray:
        return np.asarray(self.stiffness_n_per_m / self.beam_model.stiffness_n_per_m)


def solved_model(model: TaxelModel, solved: TaxelModes, solver_error: float) -> SolvedModel:
    """Return `model` with its modes replaced by the solved ones."""
    return SolvedModel(model.spec, model.topology, model.plate, model.beam, solved, solver_error)


def asked_error(spec: Spec) -> float:
    """Return the relative error within which a solid's resonance must be known to count as tuned."""
    return min(FINEST, spec.model.tolerance)
