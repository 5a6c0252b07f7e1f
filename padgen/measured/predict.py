"""Prediction of ON and OFF amplitudes, and of selectivity, of every coil of a print under given tones.

The tones need not lie on the print's resonances; the planned tones do not. All else is as in
`padgen.physics.selectivity`: motion is steady, and lines of different frequency add as energies, so that an OFF taxel
is loudest with all others on. The washers' unequal distances from the coil and all modes of a taxel are counted. The
modes move with the taxel's resonance, because a print is taken to change the stiffness and not the mass. The coils
around are left out, as in a plan's figures.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from padgen.core.units import MN, MS, UM
from padgen.measured.tuning import Tuning, planned_tuning
from padgen.physics.resonator import ModalTaxels, ring_up_time
from padgen.physics.selectivity import Channels, Scheme, line_energy, off_energy, own_lines
from padgen.planner.channels import coil_modes, driven, wanted_line_a2
from padgen.planner.plan import Channel, Plan, level_law, scheme_named
from padgen.planner.printed_pads import coils_of
from padgen.spec import Spec

__all__ = [
    "CoilFigures",
    "Played",
    "Tones",
    "levels_um",
    "one_coil_spec",
    "planned_tones",
    "played",
    "predicted",
    "printed_channels",
    "tones_at",
    "worst_db",
]

UNPULLED = 1e-12
"""Share of the largest response that replaces a smaller one, so that nothing is divided by zero."""


class Tones(NamedTuple):
    """The lines of i² that are to move the taxels (t,), in the plan's order: frequency in Hz, amplitude in A²."""

    hz: np.ndarray
    line_a2: np.ndarray


class Played(NamedTuple):
    """Energies (n,) of the taxels of a coil, each over the energy of its wanted level.

    `on` is by the taxel's own tone alone, `off` the largest over all states in which the taxel is OFF, `alone` the
    largest with only one other channel on, and `loudest` the index of that channel.
    """

    on: np.ndarray
    off: np.ndarray
    alone: np.ndarray
    loudest: np.ndarray


@dataclass(frozen=True, slots=True)
class CoilFigures:
    """The selectivity of one coil.

    `one_hot_db` and `all_states_db` are the smallest ON over the largest OFF amplitude, with one channel on at a time
    and in all states; None for a coil of one channel. `off` is the taxel that moves most when OFF, `heard` the taxel
    whose tone moves it most. `smallest_on` is the smallest ON amplitude over the wanted one, that of the taxel
    `smallest_on_taxel`.
    """

    row: int
    column: int
    one_hot_db: float | None
    all_states_db: float | None
    off: str
    heard: str
    smallest_on: float
    smallest_on_taxel: str


def levels_um(plan: Plan, resonance_hz: np.ndarray) -> np.ndarray:
    """Return the ON amplitudes (t,) in µm that the plan's level law gives at these resonances."""
    law = level_law(plan.spec)
    lowest = law(np.array([plan.channels[0].resonance_hz]))[0]
    return np.asarray(law(resonance_hz) * (plan.spec.drive.level_um / lowest))


def tones_at(plan: Plan, tuning: Tuning) -> Tones:
    """Return tones on the resonances of `tuning` that move every taxel by its level.

    A taxel that no current moves gets a tone of amplitude 0.
    """
    hz = _of(tuning, "resonance_hz")
    response = _of(tuning, "response_um_per_a2")
    line = np.divide(levels_um(plan, hz), response, out=np.zeros(len(hz)), where=response > 0)
    return Tones(hz, line)


def planned_tones(plan: Plan) -> Tones:
    """Return the tones of the plan, on the planned resonances."""
    return tones_at(plan, planned_tuning(plan))


def one_coil_spec(plan: Plan) -> Spec:
    """Return the plan's spec for the channels of one coil alone, without two sets of channels in turn."""
    spec = plan.spec
    return replace(spec, coil=replace(spec.coil, reuse="same"))


def printed_channels(plan: Plan, tuning: Tuning) -> tuple[Channel, ...]:
    """Return the taxels of a print as channels, one for each taxel of the plan.

    Masses are the plan's, so stiffness goes with the square of the resonance, and sag with its inverse. The response
    gives the pull. The effects of the mean pull are those of the coil below the taxel.
    """
    level, spec = levels_um(plan, _of(tuning, "resonance_hz")), one_coil_spec(plan)
    moved = [
        _printed(plan.channels[taxel.channel], tuned.resonance_hz, tuned.q, tuned.response_um_per_a2, float(um))
        for taxel, tuned, um in zip(plan.taxels, tuning.taxels, level, strict=True)
    ]
    for index in coils_of(plan).values():
        own = driven(spec, [moved[i] for i in index], plan.scheme)
        for i, channel in zip(index, own, strict=True):
            moved[i] = channel
    return tuple(moved)


def _printed(channel: Channel, hz: float, q: float, response_um_per_a2: float, level_um: float) -> Channel:
    x = hz / channel.resonance_hz
    stiffness = channel.stiffness_n_per_m * x**2
    tau_ms = float(ring_up_time(hz, q)) / MS
    force_mn, force_constant = level_um * UM * stiffness / q / MN, response_um_per_a2 * UM * stiffness / q
    return replace(
        channel,
        resonance_hz=hz,
        q=q,
        stiffness_n_per_m=stiffness,
        ring_up_ms=tau_ms,
        ring_down_ms=channel.ring_down_ms * tau_ms / channel.ring_up_ms,
        level_um=level_um,
        modes_hz=tuple(mode * x for mode in channel.modes_hz),
        rest_motion=tuple(motion / x**2 for motion in channel.rest_motion),
        second_mode_hz=channel.second_mode_hz * x,
        sag_um=channel.sag_um / x**2,
        root_stress_mpa=channel.root_stress_mpa * level_um / channel.level_um,
        force_mn=force_mn,
        force_constant_n_per_a2=force_constant,
        line_a2=wanted_line_a2(force_mn, force_constant),
    )


def played(truth: Channels, tones: Channels, scheme: Scheme, modes: ModalTaxels | None = None) -> Played:
    """Return the energies of the taxels `truth` of one coil under `tones`.

    ``truth.line`` is the amplitude of i² (A²) that moves a taxel by its wanted level at its own resonance;
    ``tones.line`` is played at ``tones.resonance_hz``.
    """
    (made,) = own_lines(tones, scheme)
    own = line_energy(truth, made, modes)
    on, own = own[:, 0].diagonal().copy(), own.sum(1)
    np.fill_diagonal(own, 0.0)
    return Played(on, off_energy(truth, scheme, modes, tones), own.max(1), own.argmax(1))


def predicted(
    plan: Plan, tuning: Tuning, tones: Tones, wanted_um: np.ndarray | None = None, scheme_name: str | None = None
) -> tuple[CoilFigures, ...]:
    """Return the selectivity of every coil of the print `tuning` under `tones`, row by row.

    `wanted_um` (t,) are the levels that ON taxels should have (None: those of the level law at the print's resonances).
    The drive scheme is the plan's unless another is named.
    """
    scheme = scheme_named(plan.spec, scheme_name or plan.selectivity.drive)
    channels, spec = printed_channels(plan, tuning), one_coil_spec(plan)
    response = _of(tuning, "response_um_per_a2")
    response = np.maximum(response, UNPULLED * (response.max() or 1.0))
    wanted = levels_um(plan, _of(tuning, "resonance_hz")) if wanted_um is None else wanted_um
    truth = Channels(_of(tuning, "resonance_hz"), _of(tuning, "q"), wanted / response)
    found = []
    for place, index in sorted(coils_of(plan).items()):
        own = np.array(index)
        which = Channels(*(part[own] for part in truth))
        modes = coil_modes(spec, [channels[i] for i in index])
        result = played(which, Channels(tones.hz[own], which.q, tones.line_a2[own]), scheme, modes)
        weakest, worst, lone = int(result.on.argmin()), int(result.off.argmax()), len(own) < 2
        smallest = float(result.on[weakest])
        found.append(
            CoilFigures(
                *place,
                None if lone else _db(smallest, float(result.alone.max())),
                None if lone else _db(smallest, float(result.off[worst])),
                plan.taxels[index[worst]].id,
                plan.taxels[index[int(result.loudest[worst])]].id,
                smallest**0.5,
                plan.taxels[index[weakest]].id,
            )
        )
    return tuple(found)


def worst_db(coils: Sequence[CoilFigures]) -> float | None:
    """Return the worst coil's selectivity in all states in dB, None where no coil has two channels."""
    return min((coil.all_states_db for coil in coils if coil.all_states_db is not None), default=None)


def _db(on: float, off: float) -> float:
    if on <= 0:
        return float("-inf")
    return float(10 * np.log10(on / off)) if off > 0 else float("inf")


def _of(tuning: Tuning, name: str) -> np.ndarray:
    return np.array([getattr(taxel, name) for taxel in tuning.taxels], float)
