"""Trim advice: which taxels to lower, and by how much, where two came out too close for any tones.

Only lowering is advised: weight is easily added and a beam easily thinned, the reverse is not. A little weight dm on
the plate lowers the resonance by ``m ((f/f')² − 1) = dm``, m the effective mass; a beam that is filed by dt follows the
sensitivities of the beam model, ``f'/f = (1 − dt/t)^s``. The lightest weight on one taxel that brings the coil to what
is needed is looked for; where none does, taxels are lowered one after the other, each by what helps most.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from padgen.core.units import GRAM, MG
from padgen.measured.predict import CoilFigures, levels_um, predicted, tones_at
from padgen.measured.tuning import Tuning
from padgen.physics.selectivity import Channels, Scheme, off_energy
from padgen.planner.plan import Plan
from padgen.planner.printed_pads import coils_of, sensitivities

__all__ = ["Trim", "TrimStep", "needed_db", "trims"]

SHORT_OF_PLAN_DB = 1.0
"""Where the plan itself keeps less than asked, a coil is as good as planned down to so much below it."""
LARGEST = 0.25
"""Largest share by which a resonance is to be lowered: 0.8 of the moving mass again."""
STEPS = 64
"""Shares that a taxel is tried at: from an eighth of the narrowest bandwidth, each larger by the same factor."""
MOST_STEPS = 4
"""Taxels of a coil that are lowered at most."""


@dataclass(frozen=True, slots=True)
class TrimStep:
    """One taxel to lower: `add_mg` of weight on its plate, or a beam filed thinner, or narrower, by so much."""

    id: str
    from_hz: float
    to_hz: float
    add_mg: float
    file_thickness_mm: float
    file_width_mm: float


@dataclass(frozen=True, slots=True)
class Trim:
    """What to do to one coil; `before_db`, `after_db` in all states with re-tuned tones, `needed_db` what is enough."""

    row: int
    column: int
    before_db: float
    after_db: float
    needed_db: float
    steps: tuple[TrimStep, ...]

    @property
    def reaches(self) -> bool:
        """Whether it is enough."""
        return self.after_db >= self.needed_db - 0.05


class _Coil(NamedTuple):
    """Taxels (n,) of one coil, and what their OFF energies must stay below."""

    plan: Plan
    hz: np.ndarray
    q: np.ndarray
    response: np.ndarray
    mass_mg: np.ndarray
    scheme: Scheme
    limit: float


def needed_db(plan: Plan) -> float:
    """What a coil must keep to be left alone: what was asked, or, where the plan keeps less, a little below that."""
    figures = plan.selectivity
    planned = figures.placed_all_states_db
    if planned is None or planned >= figures.asked_db:
        return figures.asked_db
    return planned - SHORT_OF_PLAN_DB


def trims(plan: Plan, tuning: Tuning, after: Sequence[CoilFigures]) -> tuple[Trim, ...]:
    """Advice for every coil that keeps too little after re-tuning; `after` are its figures then.

    Where nothing tried is enough, what helps most; nothing for a coil that no lowering helps.
    """
    need = needed_db(plan)
    short = {(c.row, c.column): c for c in after if c.all_states_db is not None and c.all_states_db < need}
    if not short:
        return ()
    lowered: dict[tuple[int, int], np.ndarray] = {}
    hz = np.array([taxel.resonance_hz for taxel in tuning.taxels])
    for place, index in sorted(coils_of(plan).items()):
        if place in short and all(tuning.taxels[i].response_um_per_a2 > 0 for i in index):
            share = _lowering(_coil(plan, tuning, index, short[place], need))
            hz[index] *= 1 - share
            lowered[place] = share
    trimmed = _moved(tuning, hz)
    figures = {(c.row, c.column): c for c in predicted(plan, trimmed, tones_at(plan, trimmed))}
    sensitivity = sensitivities(plan)
    found = []
    for place, share in lowered.items():
        index, db = coils_of(plan)[place], figures[place].all_states_db
        before = short[place].all_states_db
        if share.any() and db is not None and before is not None and db > before:
            steps = tuple(_step(plan, tuning, i, float(y), sensitivity) for i, y in zip(index, share, strict=True) if y)
            found.append(Trim(*place, before, db, need, steps))
    return tuple(found)


def _moved(tuning: Tuning, hz: np.ndarray) -> Tuning:
    """The print with more weight on it: the stiffness, and with it the response, stays."""
    taxels = (replace(t, resonance_hz=float(f)) for t, f in zip(tuning.taxels, hz, strict=True))
    return replace(tuning, taxels=tuple(taxels))


def _coil(plan: Plan, tuning: Tuning, index: Sequence[int], figures: CoilFigures, need: float) -> _Coil:
    taxels = [tuning.taxels[i] for i in index]
    mass = [plan.channels[plan.taxels[i].channel].effective_mass_g * GRAM / MG for i in index]
    bare = _Coil(
        plan,
        np.array([t.resonance_hz for t in taxels]),
        np.array([t.q for t in taxels]),
        np.array([t.response_um_per_a2 for t in taxels]),
        np.array(mass),
        plan.scheme,
        1.0,
    )
    # Other modes cost what they cost now.
    own_db = -10 * np.log10(_energies(bare, np.zeros((len(index), 1))).max())
    cost = max(own_db - (figures.all_states_db or 0.0), 0.0) if np.isfinite(own_db) else 0.0
    return bare._replace(limit=10 ** (-(need + cost) / 10))


def _energies(coil: _Coil, share: np.ndarray) -> np.ndarray:
    """OFF energies (n, columns) with resonances lowered by shares (n, columns), tones on them."""
    hz = coil.hz[:, None] * (1 - share)
    line = levels_um(coil.plan, hz.ravel()).reshape(hz.shape) / coil.response[:, None]
    which = Channels(hz, coil.q[:, None], line)
    return off_energy(which, coil.scheme)


def _lowering(coil: _Coil) -> np.ndarray:
    """Shares (n,) by which to lower the taxels of a coil."""
    share = np.zeros(len(coil.hz))
    excess = float(_excess(coil, share[:, None])[0])
    for _ in range(MOST_STEPS):
        tried = _each_lowered(coil, share)
        excesses = _excess(coil, tried)
        enough = tried[:, excesses == 0]
        if enough.shape[1]:
            return np.asarray(enough[:, _weight_mg(coil, enough).argmin()])
        best = int(excesses.argmin())
        if excesses[best] >= excess:
            break
        share, excess = tried[:, best], float(excesses[best])
    return share


def _excess(coil: _Coil, share: np.ndarray) -> np.ndarray:
    """By how much OFF energies exceed the limit, summed over taxels (columns,)."""
    excess: np.ndarray = np.maximum(_energies(coil, share) / coil.limit - 1, 0.0).sum(0)
    return excess


def _weight_mg(coil: _Coil, share: np.ndarray) -> np.ndarray:
    weight: np.ndarray = (coil.mass_mg[:, None] * ((1 - share) ** -2 - 1)).sum(0)
    return weight


def _each_lowered(coil: _Coil, base: np.ndarray) -> np.ndarray:
    """Shares (n, columns): each taxel in turn lowered further than `base`, others as they are."""
    least = min(1 / (8 * float(coil.q.max())), LARGEST / 8)
    steps = np.geomspace(least, LARGEST, STEPS)
    tried = np.repeat(base[:, None], len(base) * STEPS, 1)
    for i in range(len(base)):
        tried[i, i * STEPS : (i + 1) * STEPS] = np.maximum(base[i], steps)
    return tried


def _step(plan: Plan, tuning: Tuning, index: int, share: float, sensitivity: np.ndarray) -> TrimStep:
    taxel = tuning.taxels[index]
    channel = plan.channels[plan.taxels[index].channel]
    width, thickness, _ = sensitivity[channel.index]
    mass_mg = channel.effective_mass_g * GRAM / MG
    return TrimStep(
        taxel.id,
        taxel.resonance_hz,
        taxel.resonance_hz * (1 - share),
        mass_mg * ((1 - share) ** -2 - 1),
        _filed_mm(channel.beam.thickness_mm, share, float(thickness)),
        _filed_mm(channel.beam.width_mm, share, float(width)),
    )


def _filed_mm(size_mm: float, share: float, sensitivity: float) -> float:
    return size_mm * (1 - (1 - share) ** (1 / sensitivity)) if sensitivity > 0 else float("inf")
