"""A taxel whose modes were solved from the printed solid, in the place of the beam model."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from padgen.physics.modal import TaxelModes
from padgen.physics.modes import Modes
from padgen.planner.taxel_model import TaxelModel
from padgen.spec import Spec

__all__ = ["SolvedModel", "asked_error", "solved_model"]

FINEST = 2e-3
"""Relative error that finite elements are asked for."""


@dataclass(frozen=True)
class SolvedModel(TaxelModel):
    """One taxel by 3-D elasticity: `solved` gives its modes, `solver_error` is what they may be off by.

    Sag and stress are the beam model's, scaled by the stiffness of the working mode: both go with the
    bending moment at a beam's root.
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
        """What the finite elements may be off by."""
        return np.asarray(self.solver_error)

    @property
    def beam_error(self) -> float | None:
        """How far the beam model's resonance is off, relative."""
        return float(self.beam_model.resonance_hz / self.resonance_hz - 1)

    @property
    def sag_m(self) -> np.ndarray:
        """Sag of the washer under its own weight."""
        return np.asarray(self.beam_model.sag_m / self._stiffer)

    @property
    def hardening_per_m2(self) -> np.ndarray:
        """Hardening by beams that stretch, the beam model's."""
        return self.beam_model.hardening_per_m2

    def root_stress_pa(self, level_m: np.ndarray) -> np.ndarray:
        """Largest bending stress of the beams when the washer moves by `level_m`."""
        return np.asarray(self.beam_model.root_stress_pa(level_m) * self._stiffer)

    @property
    def _stiffer(self) -> np.ndarray:
        return np.asarray(self.stiffness_n_per_m / self.beam_model.stiffness_n_per_m)


def solved_model(model: TaxelModel, solved: TaxelModes, solver_error: float) -> SolvedModel:
    """`model` with its modes replaced."""
    return SolvedModel(model.spec, model.topology, model.plate, model.beam, solved, solver_error)


def asked_error(spec: Spec) -> float:
    """Relative error to which a solid's resonance must be known to count as tuned."""
    return min(FINEST, spec.model.tolerance)
