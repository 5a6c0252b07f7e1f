"""Resonance, Q and response of all taxels of one print, as measured, warm or simulated, and its predicted selectivity.

Predictions are of the ON and OFF amplitudes and of the selectivity of every coil. The tones need not lie on the print's
resonances; the planned tones do not. All else is as in `padgen.physics.selectivity`: motion is steady, and lines of
different frequency add as energies, so that an OFF taxel is loudest with all others on. The washers' unequal distances
from the coil and all modes of a taxel are counted. The modes move with the taxel's resonance, because a print is taken
to change the stiffness and not the mass. The coils around are left out, as in a plan's figures.

Simulated prints let re-tuning be tried without a lab. Their resonances are drawn by `padgen.planner.printed_pads` from
the printer's and the material's spreads; Q and pull are log-normal with the spreads below, which are assumptions. The
measurement is the motion that a probe on each washer would see, all modes of the taxel, with white noise. The coils
around and the frame's own motion are left out.
"""

import io
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, astuple, dataclass, replace
from math import hypot
from pathlib import Path
from typing import NamedTuple

import numpy as np

from padgen.core.errors import FileError, SpecError, at_least, at_most, number
from padgen.core.files import json_text, read_bounded, sha256_hex
from padgen.core.units import COPPER_C, GRAM, MN, MS, UM
from padgen.measured.shaking import chirp_current_a, measuring_band_hz, ring_s, shaking_line_a2, sweep_s
from padgen.physics.contact import loaded_resonance
from padgen.physics.resonator import ModalTaxels, ring_up_time
from padgen.physics.selectivity import Channels, Scheme, line_energy, off_energy, own_lines
from padgen.planner.channels import coil_modes, driven, wanted_line_a2
from padgen.planner.plan import Channel, Plan, level_law, read_as, scheme_named
from padgen.planner.printed_pads import Spreads, coils_of, design_of, drawn_prints, spreads_of
from padgen.planner.touch import contact_of, contactor_of
from padgen.planner.warm_pad import copper_ohm
from padgen.spec import Spec

__all__ = [
    "PULL_SPREAD",
    "Q_SPREAD",
    "SIMULATED",
    "CoilFigures",
    "TaxelEnergies",
    "TunedTaxel",
    "Tuning",
    "WantedLines",
    "levels_um",
    "one_coil_spec",
    "planned_response_um_per_a2",
    "planned_tuning",
    "played_tuning",
    "predicted",
    "printed_channels",
    "read_tuning",
    "refuse_tuning",
    "simulate_print",
    "simulated_measurement",
    "spec_at_coil_temperature",
    "taxel_energies",
    "tones_at",
    "tuning_from_json",
    "tuning_hash",
    "tuning_to_json",
    "warm_plan",
    "warm_tuning",
    "worst_db",
]

LARGEST_FILE = 1 << 22
LARGEST_TAXEL = 1 << 12
"""Most bytes of a file: a fixed number, and more for each taxel."""
FARTHEST = 10.0
"""Largest ratio of a resonance to the planned one, or the inverse; beyond it, another unit must have been used."""
LEAST_Q = 0.5
LARGEST_Q = 1e9
FARTHEST_RESPONSE = 1e6
"""Largest ratio of a response, or the inverse, to the one that follows from f and Q with the planned mass and pull.

A print changes it by less than ten; beyond the limit, another unit must have been used.
"""
LARGEST_ERROR = 1e6
"""Largest error of a figure, over the figure itself."""
COLDEST_C = -100.0
HOTTEST_C = 500.0
"""Bounds of the copper's temperature, far beyond those that a coil bears."""


@dataclass(frozen=True, slots=True)
class TunedTaxel:
    """One taxel of a print; `_error` fields are one sigma.

    `response_um_per_a2` is the amplitude at resonance per amplitude of the line of i² there: the pull's force constant
    times Q over the stiffness. Where `measured` is False the figures are the plan's or estimated; where
    `level_measured` is False the response follows from f and Q with the plan's mass and pull.
    """

    id: str
    resonance_hz: float
    resonance_error_hz: float
    q: float
    q_error: float
    response_um_per_a2: float
    response_error: float
    measured: bool
    level_measured: bool


@dataclass(frozen=True, slots=True)
class Tuning:
    """All taxels of one print, in the plan's order; `name` is the plan's name.

    `coil_c` is the temperature in °C of the copper whose resistance gives voltages and heat; coils are stated at 20 °C.
    """

    name: str
    taxels: tuple[TunedTaxel, ...]
    coil_c: float = COPPER_C


def planned_response_um_per_a2(channel: Channel, resonance_hz: float | None = None, q: float | None = None) -> float:
    """Return the amplitude at resonance in µm per A² of the i² line that drives it, with the planned mass and pull.

    `resonance_hz` and `q` are those of a print (None: as planned). A print is taken to change the stiffness and not the
    mass. The result is 0 for a washer that the coil does not pull.
    """
    hz = resonance_hz or channel.resonance_hz
    quality = q or channel.q
    stiffness = channel.stiffness_n_per_m * (hz / channel.resonance_hz) ** 2
    return max(channel.force_constant_n_per_a2, 0.0) * quality / stiffness / UM


def planned_tuning(plan: Plan) -> Tuning:
    """Return the tuning of a print that came out exactly as planned."""
    return Tuning(plan.name, tuple(_planned_taxel(plan.channels[taxel.channel], taxel.id) for taxel in plan.taxels))


def _planned_taxel(channel: Channel, name: str) -> TunedTaxel:
    response = planned_response_um_per_a2(channel)
    return TunedTaxel(name, channel.resonance_hz, 0.0, channel.q, 0.0, response, 0.0, False, False)


def warm_tuning(plan: Plan, cold: Tuning | None = None) -> Tuning:
    """Return the tuning of the pad at the temperatures of `Plan.warm`, which it reaches with all taxels ON for long.

    `cold` is the print as measured in the room (None: as planned). Each resonance falls by the share by which its
    channel's does, and the response rises as the stiffness falls; Q stays. Coils are at their mean temperature.

    Raises
    ------
    SpecError
        `cold` is of a warm pad already.
    """
    cold = cold or planned_tuning(plan)
    if cold.coil_c != COPPER_C:
        sentence = f"is of a pad whose coils are at {number(cold.coil_c)} °C already; drive it without --warm"
        raise SpecError(sentence, "tuning")
    pairs = zip(plan.taxels, cold.taxels, strict=True)
    return Tuning(
        plan.name,
        tuple(_warmed(plan, plan.channels[taxel.channel], tuned) for taxel, tuned in pairs),
        plan.warm.mean_coil_c,
    )


def _warmed(plan: Plan, channel: Channel, cold: TunedTaxel) -> TunedTaxel:
    """Return a taxel of a channel as it is on the warm pad."""
    x = plan.warm.resonances_hz[channel.index] / channel.resonance_hz
    unsure_hz = plan.warm.error * (1 - x) * cold.resonance_hz
    return replace(
        cold,
        resonance_hz=cold.resonance_hz * x,
        resonance_error_hz=hypot(cold.resonance_error_hz * x, unsure_hz),
        response_um_per_a2=cold.response_um_per_a2 / x**2,
        response_error=cold.response_error / x**2,
    )


def played_tuning(plan: Plan, bare: Tuning | None = None) -> Tuning:
    """Return the taxels' figures that a drive is made for: untouched or, for a plan tuned for touch, under skin.

    `bare` is the print as measured untouched (None: as planned).
    """
    bare = bare or planned_tuning(plan)
    touch = plan.touch
    if touch is None or touch.tones == "untouched":
        return bare
    contact = contact_of(plan.spec, "typical")
    contactor = contactor_of(plan.spec)
    channels = [plan.channels[taxel.channel] for taxel in plan.taxels]
    mass = np.array([channel.effective_mass_g * GRAM for channel in channels])
    hz = _of(bare, "resonance_hz")
    q = _of(bare, "q")
    response = _of(bare, "response_um_per_a2")
    stiffness = mass * (2 * np.pi * hz) ** 2
    lever = np.array(touch.lever)[[channel.index for channel in channels]]
    touched_hz, touched_q = loaded_resonance(contact, contactor, stiffness, mass, q, lever)
    added = contact.impedance(touched_hz, contactor).through(lever)
    response = response * (stiffness / q) * touched_q / (stiffness + added.stiffness)
    changed = zip(bare.taxels, touched_hz.tolist(), touched_q.tolist(), response.tolist(), strict=True)
    taxels = tuple(replace(t, resonance_hz=h, q=quality, response_um_per_a2=r) for t, h, quality, r in changed)
    return replace(bare, taxels=taxels)


def spec_at_coil_temperature(plan: Plan, coil_c: float) -> Spec:
    """Return the plan's spec with the resistance of coils whose copper is at `coil_c`."""
    spec = plan.spec
    return replace(spec, coil=replace(spec.coil, resistance_ohm=copper_ohm(spec.coil.resistance_ohm, coil_c)))


def warm_plan(plan: Plan) -> Plan:
    """Return a plan whose channels and coil are those of the warm pad, for tables of channels."""
    tuned = [_warmed(plan, channel, _planned_taxel(channel, "")) for channel in plan.channels]
    levels = levels_um(plan, np.array(plan.warm.resonances_hz)).tolist()
    spec = spec_at_coil_temperature(plan, plan.warm.mean_coil_c)
    channels = [_printed_channel(*each) for each in zip(plan.channels, tuned, levels, strict=True)]
    return replace(plan, spec=spec, channels=driven(spec, channels, plan.scheme))


def tuning_to_json(tuning: Tuning) -> str:
    """Return the tuning as JSON text."""
    return json_text(asdict(tuning))


def tuning_hash(tuning: Tuning) -> str:
    """Return the first 16 digits of the hash of a tuning's file."""
    return sha256_hex(tuning_to_json(tuning).encode())[:16]


def read_tuning(path: Path, plan: Plan) -> Tuning:
    """Read the tuning of a print of `plan` from a file.

    Raises
    ------
    FileError
        The file cannot be read, or is no tuning of this plan.
    """
    most = LARGEST_FILE + LARGEST_TAXEL * len(plan.taxels)
    try:
        text = read_bounded(path, most, f"a tuning of {len(plan.taxels)} taxels").decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(f"is not a tuning: byte {error.start} is not UTF-8 text", str(path)) from error
    return tuning_from_json(text, plan, str(path))


def tuning_from_json(text: str, plan: Plan, where: str = "tuning.json") -> Tuning:
    """Read the tuning of a print of `plan` from JSON text; `where` names its file in messages.

    Raises
    ------
    FileError
        The text is no tuning, belongs to another pad, or has figures that no print has.
    """
    try:
        tuning: Tuning = read_as(Tuning, json.loads(text, parse_int=float), "tuning")
        if tuning.coil_c is None or any(None in astuple(taxel) for taxel in tuning.taxels):
            raise ValueError("a figure is null")
        due = [taxel.id for taxel in plan.taxels]
        ids = [taxel.id for taxel in tuning.taxels]
        if tuning.name != plan.name or len(ids) != len(due):
            raise ValueError(
                f"it has {len(ids)} taxels of {tuning.name!r}, must have the {len(due)} of {plan.name!r};"
                " padgen retune makes one for this plan"
            )
        if ids != due:
            k = next(k for k, pair in enumerate(zip(ids, due, strict=True)) if pair[0] != pair[1])
            raise ValueError(f"taxel {k + 1} must be {due[k]!r}, in the order of the plan, it is {ids[k]!r}")
    except (ValueError, RecursionError) as error:
        raise FileError(f"is not a tuning of {plan.name!r} ({str(error)[:200]})", where) from error
    refuse_tuning(tuning, plan, where)
    return tuning


def refuse_tuning(tuning: Tuning, plan: Plan, where: str) -> None:
    """Raise FileError if a resonance, Q, response, error or coil temperature is beyond that of any print of `plan`.

    Raises
    ------
    FileError
        A figure is outside its bounds, which are named.
    """
    if not COLDEST_C <= tuning.coil_c <= HOTTEST_C:
        bounds = f"{number(COLDEST_C)} … {number(HOTTEST_C)} °C"
        raise FileError(f"coil_c must be {bounds}, got {number(tuning.coil_c)} °C", where)
    for tuned, taxel in zip(tuning.taxels, plan.taxels, strict=True):
        for name, value, low, high, why in _bounded(tuned, plan.channels[taxel.channel]):
            # The bounds are widened, since files round to ten digits.
            if not low * (1 - 1e-9) <= value <= high * (1 + 1e-9):
                raise FileError(
                    f"{name} of {tuned.id} must be {at_least(low)} … {at_most(high)}{why}, got {number(value)}", where
                )


def _bounded(tuned: TunedTaxel, channel: Channel) -> Iterator[tuple[str, float, float, float, str]]:
    """Yield, for each figure of a taxel, its name, value, lower and upper bound, and the reason for the bounds.

    The response's bounds are worked out once resonance and Q are known to be within theirs.
    """
    hz = tuned.resonance_hz
    q = tuned.q
    response = tuned.response_um_per_a2
    planned = channel.resonance_hz
    yield "resonance_hz", hz, planned / FARTHEST, planned * FARTHEST, f" Hz (planned: {number(planned)} Hz)"
    yield "q", q, LEAST_Q, LARGEST_Q, ""
    usual = planned_response_um_per_a2(channel, hz, q) or 1.0
    if response != 0:
        why = " (or 0, where no current moves it)"
        yield "response_um_per_a2", response, usual / FARTHEST_RESPONSE, usual * FARTHEST_RESPONSE, why
    yield "resonance_error_hz", tuned.resonance_error_hz, 0.0, hz * LARGEST_ERROR, ""
    yield "q_error", tuned.q_error, 0.0, q * LARGEST_ERROR, ""
    yield "response_error", tuned.response_error, 0.0, (response or usual) * LARGEST_ERROR, ""


# Prediction


UNPULLED = 1e-12
"""Share of the largest response that replaces a smaller one, so that nothing is divided by zero."""


class WantedLines(NamedTuple):
    """Spectral line of i² that drives each taxel (t,), in the plan's order: frequency in Hz, amplitude in A²."""

    hz: np.ndarray
    line_a2: np.ndarray


class TaxelEnergies(NamedTuple):
    """Vibration energies (n,) of a coil's taxels, ON and OFF, each divided by its energy at its wanted ON level.

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
    """Return the ON amplitudes (t,) in µm that the plan asks for at these resonances (t,), by its level law.

    Under a contact, they are of touched taxels at the tones, with the level that the plan has in hand.
    """
    law = level_law(plan.spec)
    touch = plan.touch
    lowest_hz = plan.channels[0].resonance_hz
    level_um = plan.spec.drive.level_um
    if touch is not None:
        lowest_hz = touch.tone_hz[0]
        level_um = level_um * 10 ** (touch.in_hand_db / 20)
    lowest = law(np.array([lowest_hz]))[0]
    return np.asarray(law(resonance_hz) * (level_um / lowest))


def tones_at(plan: Plan, tuning: Tuning) -> WantedLines:
    """Return tones at the resonances of `tuning`, each with the amplitude that moves its taxel by its ON level.

    A taxel that no current moves gets a tone of amplitude 0.
    """
    hz = _of(tuning, "resonance_hz")
    response = _of(tuning, "response_um_per_a2")
    return WantedLines(hz, np.divide(levels_um(plan, hz), response, out=np.zeros(len(hz)), where=response > 0))


def one_coil_spec(plan: Plan) -> Spec:
    """Return the plan's spec with one set of channels for all coils (`coil.reuse` is "same"), not two in turn."""
    spec = plan.spec
    return replace(spec, coil=replace(spec.coil, reuse="same"))


def printed_channels(plan: Plan, tuning: Tuning) -> tuple[Channel, ...]:
    """Return one `Channel` for each taxel of the plan, with the resonance, Q and pull of that taxel of the print.

    The response gives the pull. The effects of the mean pull are those of the coil below the taxel.
    """
    levels = levels_um(plan, _of(tuning, "resonance_hz")).tolist()
    spec = one_coil_spec(plan)
    channels = (plan.channels[taxel.channel] for taxel in plan.taxels)
    moved = [_printed_channel(*each) for each in zip(channels, tuning.taxels, levels, strict=True)]
    for index in coils_of(plan).values():
        driven_set = driven(spec, [moved[i] for i in index], plan.scheme)
        for i, channel in zip(index, driven_set, strict=True):
            moved[i] = channel
    return tuple(moved)


def _printed_channel(channel: Channel, tuned: TunedTaxel, level_um: float) -> Channel:
    """Return a channel with resonance, Q and response of one printed taxel; effects of the mean pull stay as planned.

    Masses are the plan's, so stiffness goes with the square of the resonance, and sag with its inverse.
    """
    hz = tuned.resonance_hz
    q = tuned.q
    x = hz / channel.resonance_hz
    stiffness = channel.stiffness_n_per_m * x**2
    tau_ms = float(ring_up_time(hz, q)) / MS
    force_mn = level_um * UM * stiffness / q / MN
    force_constant = tuned.response_um_per_a2 * UM * stiffness / q
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


def taxel_energies(truth: Channels, tones: Channels, scheme: Scheme, modes: ModalTaxels | None = None) -> TaxelEnergies:
    """Return the vibration energies, ON and OFF, of the real taxels `truth` of one coil when it plays `tones`.

    ``truth.line`` is the amplitude of i² (A²) that moves a taxel by its wanted level at its own resonance;
    ``tones.line`` is played at ``tones.resonance_hz``.
    """
    (made,) = own_lines(tones, scheme)
    energy = line_energy(truth, made, modes)
    on = energy[:, 0].diagonal().copy()
    energy = energy.sum(1)
    np.fill_diagonal(energy, 0.0)
    return TaxelEnergies(on, off_energy(truth, scheme, modes, tones), energy.max(1), energy.argmax(1))


def predicted(
    plan: Plan, tuning: Tuning, tones: WantedLines, wanted_um: np.ndarray | None = None, scheme_name: str | None = None
) -> tuple[CoilFigures, ...]:
    """Return the selectivity of every coil of the print `tuning` under `tones`, row by row.

    `wanted_um` (t,) are the levels that ON taxels should have (None: those of the level law at the print's resonances).
    The drive scheme is the plan's unless another is named.
    """
    scheme = scheme_named(plan.spec, scheme_name or plan.selectivity.drive, plan.channels)
    channels = printed_channels(plan, tuning)
    spec = one_coil_spec(plan)
    hz = _of(tuning, "resonance_hz")
    response = _of(tuning, "response_um_per_a2")
    wanted = levels_um(plan, hz) if wanted_um is None else wanted_um
    truth = Channels(hz, _of(tuning, "q"), wanted / np.maximum(response, UNPULLED * (response.max() or 1.0)))
    levels = []
    for place, index in sorted(coils_of(plan).items()):
        members = np.array(index)
        which = Channels(*(part[members] for part in truth))
        modes = coil_modes(spec, [channels[i] for i in index])
        result = taxel_energies(which, Channels(tones.hz[members], which.q, tones.line_a2[members]), scheme, modes)
        weakest = int(result.on.argmin())
        worst = int(result.off.argmax())
        lone = len(members) < 2
        smallest = float(result.on[weakest])
        levels.append(
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
    return tuple(levels)


def worst_db(coils: Sequence[CoilFigures]) -> float | None:
    """Return the worst coil's selectivity in all states in dB, None where no coil has two channels."""
    return min((coil.all_states_db for coil in coils if coil.all_states_db is not None), default=None)


def _db(on: float, off: float) -> float:
    if on <= 0:
        return float("-inf")
    return float(10 * np.log10(on / off)) if off > 0 else float("inf")


def _of(tuning: Tuning, name: str) -> np.ndarray:
    return np.array([getattr(taxel, name) for taxel in tuning.taxels], float)


# Simulated prints


SIMULATED = ("spectrum", "chirp", "pluck")
"""Kinds of simulated measurements."""
Q_SPREAD = 0.10
"""Relative spread of Q from taxel to taxel, as layers bond and glue damps differently. An assumption."""
PULL_SPREAD = 0.10
"""Relative spread of the pull beside that of its gap: half a millimetre of place, or other steel. An assumption."""
POINTS_PER_BANDWIDTH = 10
REACH_BANDWIDTHS = 6
"""Bandwidths on either side of each resonance at which a spectrum of high Q gets close points."""
MOST_EVEN = 3000
"""Most points of a spectrum that is even in octaves over the whole band."""
MOST_NUMBERS = 20_000_000
"""Most numbers in a file of a time series."""
RATE_OVER_HIGHEST = 8.0


def simulate_print(plan: Plan, seed: int, spreads: Spreads | None = None) -> Tuning:
    """Return one simulated print, known exactly; the same seed gives the same print."""
    spreads = spreads or spreads_of(plan.spec)
    design = design_of(plan, None)
    x, pull = (np.exp(np.clip(part[2, :, 0], -1.0, 1.0)) for part in drawn_prints(design, spreads, seed, 0, 1))
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0, 100)))
    q_factor, pull_factor = np.exp(rng.standard_normal((2, len(x))) * [[Q_SPREAD], [PULL_SPREAD]])
    taxels = []
    for taxel, off, better, stronger in zip(plan.taxels, x, q_factor, pull * pull_factor, strict=True):
        channel = plan.channels[taxel.channel]
        hz = channel.resonance_hz * float(off)
        q = max(channel.q * float(better), 0.5)
        response = planned_response_um_per_a2(channel, hz, q) * float(stronger)
        taxels.append(TunedTaxel(taxel.id, hz, 0.0, q, 0.0, response, 0.0, True, True))
    return Tuning(plan.name, tuple(taxels))


def simulated_measurement(plan: Plan, truth: Tuning, seed: int, kind: str = "spectrum", snr_db: float = 30.0) -> str:
    """Simulate a lab's measurement of the print `truth`, as CSV for `padgen.measured.read.read_measured`.

    The `kind` is 'spectrum' (complex amplitude per line of i² over the frequency of the motion), 'chirp' (displacement
    under the excitation of `padgen.driver.excitation`, with the current) or 'pluck' (the decay after a tap on each
    taxel, in relative units). `snr_db` is the largest value of a taxel's column over the noise's sigma at each point.

    Raises
    ------
    SpecError
        The kind is unknown, or the time series would be too long for a file.
    """
    if kind not in SIMULATED:
        raise SpecError(f"must be one of {', '.join(SIMULATED)}, got {kind!r}", "--kind")
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0, 101)))
    measure = {"spectrum": _spectrum, "chirp": _chirp, "pluck": _pluck}[kind]
    return measure(plan, truth, _responses(plan, truth), rng, 10 ** (-snr_db / 20))


Response = Callable[[int, np.ndarray], np.ndarray]
"""Function of a taxel's index and frequencies in Hz: the washer's complex amplitude in µm per A² of a line of i²."""


def _responses(plan: Plan, truth: Tuning) -> Response:
    channels = printed_channels(plan, truth)

    def response(i: int, frequency_hz: np.ndarray) -> np.ndarray:
        channel = channels[i]
        tuned = truth.taxels[i]
        working = int(np.argmax(channel.mode_shares))
        total = np.zeros(frequency_hz.shape, complex)
        for k, (mode_hz, share) in enumerate(zip(channel.modes_hz, channel.pulled_shares, strict=True)):
            resonance_hz = tuned.resonance_hz if k == working else mode_hz
            s = frequency_hz / resonance_hz
            total += share / channel.pulled_shares[working] / ((1 - s) * (1 + s) + 1j * s / tuned.q)
        return total * (tuned.response_um_per_a2 / tuned.q)

    return response


def _spectrum(plan: Plan, truth: Tuning, response: Response, rng: np.random.Generator, noise: float) -> str:
    frequency = _frequencies(plan, truth)
    columns = {"frequency_hz": frequency}
    for i, taxel in enumerate(truth.taxels):
        clean = response(i, frequency)
        sigma = noise * np.abs(clean).max() / np.sqrt(2)
        noisy = clean + sigma * (rng.standard_normal(len(clean)) + 1j * rng.standard_normal(len(clean)))
        columns |= {f"{taxel.id}_re": noisy.real, f"{taxel.id}_im": noisy.imag}
    return _csv(columns, "# unit: um_per_a2\n")


def _frequencies(plan: Plan, truth: Tuning) -> np.ndarray:
    """Return the frequencies of a spectrum in Hz: even in octaves, or close around each resonance where Q is high."""
    low, high = _band_hz(plan, truth)
    q = _of(truth, "q")
    even = int(np.ceil(np.log(high / low) * q.max() * POINTS_PER_BANDWIDTH))
    if even <= MOST_EVEN:
        return np.geomspace(low, high, max(even, 200))
    offsets = np.linspace(-REACH_BANDWIDTHS, REACH_BANDWIDTHS, 2 * REACH_BANDWIDTHS * POINTS_PER_BANDWIDTH + 1)
    zoomed = _of(truth, "resonance_hz")[:, None] * (1 + offsets / q[:, None])
    return np.unique(np.concatenate([np.geomspace(low, high, 200), zoomed.ravel()]).clip(low, high))


def _band_hz(plan: Plan, truth: Tuning) -> tuple[float, float]:
    """Return the measured band in Hz, widened where the print came out far off the plan."""
    hz = _of(truth, "resonance_hz").tolist()
    low, high = measuring_band_hz(plan)
    return min(low, min(hz) / 2), max(high, max(hz) * 2)


def _chirp(plan: Plan, truth: Tuning, response: Response, rng: np.random.Generator, noise: float) -> str:
    low, high = _band_hz(plan, truth)
    rate = float(np.ceil(RATE_OVER_HIGHEST * high / 2))
    sweep = sweep_s(plan)
    ring = ring_s(plan)
    numbers = (sweep + ring) * rate * (2 + len(truth.taxels))
    if numbers > MOST_NUMBERS:
        raise SpecError(
            f"chirp would take a file of {number(float(round(numbers)))} numbers, at most {MOST_NUMBERS} are written;"
            " spectrum would do",
            "--kind",
        )
    time = np.arange(int((sweep + ring) * rate)) / rate
    current = chirp_current_a(time, sweep, (low, high), shaking_line_a2(plan), plan.spec.force_order)[0]
    # Twice as long, so that motion at the end does not wrap round to the beginning.
    size = 2 * len(time)
    force = np.fft.rfft(current**plan.spec.force_order, size)
    frequency = np.fft.rfftfreq(size, 1 / rate)
    columns = {"time_s": time, "current_a": current}
    for i, taxel in enumerate(truth.taxels):
        moved = np.fft.irfft(force * response(i, frequency), size)[: len(time)]
        columns[taxel.id] = _noisy(moved, rng, noise)
    return _csv(columns, "# unit: um\n")


def _pluck(plan: Plan, truth: Tuning, response: Response, rng: np.random.Generator, noise: float) -> str:
    hz = _of(truth, "resonance_hz")
    q = _of(truth, "q")
    rate = float(np.ceil(RATE_OVER_HIGHEST * hz.max()))
    seconds = min(max(float((3 * q / (np.pi * hz)).max()), 5 / float(hz.min())), MOST_NUMBERS / rate / (1 + len(hz)))
    time = np.arange(int(seconds * rate)) / rate
    phases = rng.uniform(-0.5, 0.5, len(hz))
    columns = {"time_s": time}
    for taxel, phase in zip(truth.taxels, phases, strict=True):
        damped = taxel.resonance_hz * np.sqrt(1 - min(1 / (4 * taxel.q**2), 0.99))
        decay = np.exp(-np.pi * taxel.resonance_hz / taxel.q * time) * np.cos(2 * np.pi * damped * time + phase)
        columns[taxel.id] = _noisy(decay, rng, noise)
    return _csv(columns, "")


def _noisy(clean: np.ndarray, rng: np.random.Generator, noise: float) -> np.ndarray:
    return np.asarray(clean + noise * np.abs(clean).max() * rng.standard_normal(len(clean)))


def _csv(columns: dict[str, np.ndarray], head: str) -> str:
    text = io.StringIO()
    forms = ["%.10g"] + ["%.6g"] * (len(columns) - 1)
    np.savetxt(text, np.stack([*columns.values()], 1), forms, ",", header=head + ",".join(columns), comments="")
    return text.getvalue()
