"""Search the washer or magnet, ballast, suspension, pin and resonances that the spec of a pad under touch leaves open.

What decides is moving mass over the skin that a pin puts on it. The search climbs from a start that is known to be
good, one part after the other to its next values and around again, while more is kept: within the limits of coils, with
the faintest channel as strong as it must be to be felt. Parts whose values have no order are tried once.
"""

from collections.abc import Callable
from dataclasses import replace
from math import ceil, isfinite
from typing import Any, NamedTuple

from padgen.core.errors import InfeasibleError, PadgenError, number, plural
from padgen.planner.cures import Cure, varied
from padgen.planner.thresholds import SENSATION
from padgen.spec import Spec, catalogue
from padgen.spec.load import SEARCHED

__all__ = ["TouchTrial", "decided_under_touch"]

MOVERS = ("disc-4x2", "disc-4x1", "disc-3x1", "iso7089-m2.5")
COILS = {"magnet": "air-10", "washer": "paper"}
"""Magnets and washers, and the coil for either: a core would pull magnets onto itself."""
BALLASTS = (None, "steel-rod-3x3", "steel-rod-4x2", "steel-rod-4x3", "steel-rod-5x3", "steel-rod-6x3")
"""Masses in the plates, the lightest first."""
SUSPENSIONS = ("serpentine-3", "cantilever")
PLACES = (0.3, 0.35, 0.4, 0.45, 0.5, 0.55, 0.6, 0.7, 0.8, "plate")
RATIOS = (2.0, 2.25, 2.5, 2.6, 2.75, 3.0, 3.6)
"""Largest over smallest resonance of a coil's two channels."""
STARTS_HZ = (60.0, 80.0, 100.0, 125.0, 150.0, 180.0, 220.0, 280.0, 350.0)
"""Lowest resonance, within the band."""
INTERLEAVED = 1.2
"""Ratio of the second set's resonances to the first's: a coil's tones then fall beside its neighbours' taxels."""
MOST_TRIALS = 18
"""Most pads that are planned and simulated: a fifth of a second each."""
FELT_DB = 0.5
"""Level above what is just felt at which the faintest channel is driven."""


class TouchTrial(NamedTuple):
    """Result of planning a candidate spec under touch: selectivity in dB, heat of all coils in W, drive level in µm."""

    kept_db: float
    heat_w: float
    level_um: float
    within_limits: bool


class _TouchParts(NamedTuple):
    """A candidate of the search: pin's place, resonances, ballast, coil grid, washer or magnet, and suspension."""

    place: float | str
    ratio: float
    ballast: str | None
    start_hz: float
    turned: bool
    mover: str
    suspension: str


START = _TouchParts(0.45, 2.5, "steel-rod-4x2", 150.0, False, "disc-4x2", "serpentine-3")


def decided_under_touch(spec: Spec, tried: Callable[[Spec, float], TouchTrial]) -> Spec:
    """Return `spec` with the parts that `touch.search` names chosen by trial plans, or `spec` itself if it names none.

    `tried` returns what a decided spec keeps with its faintest channel so many dB above what is just felt, and raises
    `PadgenError` where no pad can be laid out.

    Raises
    ------
    InfeasibleError
        No choice of parts that was tried gives a pad.
    """
    is_open = frozenset(spec.touch.search.split("+"))
    if is_open.isdisjoint(SEARCHED):
        return spec
    movers = _movers(is_open)
    refusals: list[PadgenError] = []
    misfits: list[PadgenError] = []
    known: dict[Spec, tuple[tuple[bool, float], Spec | None]] = {}

    def score(parts: _TouchParts) -> tuple[bool, float]:
        try:
            decided = _decided(spec, parts, is_open)
        except PadgenError as error:
            misfits.append(error)
            return WORST
        if decided not in known and len(known) < MOST_TRIALS:
            try:
                known[decided] = _scored(decided, tried(decided, FELT_DB))
            except PadgenError as error:
                refusals.append(error)
                known[decided] = NO_PAD
        return known.get(decided, NO_PAD)[0]

    values = {
        "ratio": RATIOS,
        "ballast": BALLASTS if "ballast" in is_open else (START.ballast,),
        "start_hz": STARTS_HZ,
        "turned": (False, True),
        "mover": movers,
        "suspension": SUSPENSIONS if "suspension" in is_open else (START.suspension,),
        "place": PLACES if "contactor" in is_open else (START.place,),
    }
    best = START._replace(mover=movers[0])
    if score(best) == WORST:
        best = _climbed(best, "turned", values["turned"], score)
    # Pins nearer to the roots keep more for more heat: they take what is left of it at the end, or save it first.
    if not score(best)[0]:
        best = _climbed(best, "place", values["place"], score)
    for name in values:
        best = _climbed(best, name, values[name], score)
    before = None
    while best != before:
        before = best
        for name in IN_ORDER:
            best = _climbed(best, name, values[name], score)
    # Why parts do not fit the spec (their resonances its band) is no reason of a pad: those of laid out pads go first.
    reasons = refusals + misfits
    if reasons and all(decided is None for _, decided in known.values()):
        raise _nothing_found(spec, reasons[0], tried)
    return known.get(_decided(spec, best, is_open), NO_PAD)[1] or spec


SIDES = ("width", "depth")
COOL_PLACES = (START.place, 0.6, 0.8)
"""Places of pins of which the later ones take less heat."""
WIDER = (1.05, 1.1, 1.2, 1.3, 1.5)
"""Sides of a pad over those asked for that are tried after no pad under touch was found."""
WIDE_HZ = 450.0
"""Upper end of a band that is tried then: touched pads of two channels a coil resonate up to there."""


def _nothing_found(spec: Spec, why: PadgenError, tried: Callable[[Spec, float], TouchTrial]) -> InfeasibleError:
    """Return the error that no pad meets `spec`; it proposes a wider pad or band if a first trial works there."""
    is_open = frozenset(spec.touch.search.split("+"))

    def is_within_limits(change: Cure, place: float | str) -> bool | None:
        """Return whether a first try with pins at `place` keeps all limits; None where it cannot be laid out."""
        try:
            changed = varied(spec, change)
            parts = START._replace(mover=_movers(is_open)[0], place=place)
            return tried(_decided(changed, parts, is_open), FELT_DB).within_limits
        except PadgenError:
            return None

    def first_that_works(changes: list[Cure]) -> Cure | None:
        """Return the first of `changes` within all limits; None after one that can be laid out but exceeds them."""
        for change in changes:
            within = [is_within_limits(change, place) for place in COOL_PLACES]
            if True in within:
                return change
            if False in within:
                return None
        return None

    low, high = spec.band_hz
    pad = spec.pad
    wider: list[Cure] = [
        {f"pad.{side}_mm": round(getattr(pad, f"{side}_mm") * more, 1) for side in SIDES} for more in WIDER
    ]
    cure = first_that_works(wider)
    if cure is None and high < WIDE_HZ:
        wide_band: Cure = {"band_hz": [low, WIDE_HZ]}
        cure = first_that_works([wide_band, *(wide_band | sides for sides in wider)])
    searched = spec.touch.search.replace("+", ", ")
    contact = spec.touch.contact
    under = "its own contact" if contact == "own" else f"a {contact}"
    message = (
        f"no pad of {spec.resolution} taxel{plural(spec.resolution)} that works under {under} was found on"
        f" {number(pad.width_mm)} x {number(pad.depth_mm)} mm in band_hz = [{number(low)}, {number(high)}]"
        f" (searched: {searched}; first refusal: {why.message}); touch.search = 'none' plans the spec as it is"
    )
    return InfeasibleError(message, "touch", [] if cure is None else [cure])


def _scored(decided: Spec, trial: TouchTrial) -> tuple[tuple[bool, float], Spec | None]:
    """Return a tried spec's score and the spec with the drive level it needs; `NO_PAD` if its dB are not finite."""
    if not isfinite(trial.kept_db):
        return NO_PAD
    # Out of bounds, what takes less heat is nearer to being within.
    gain = trial.kept_db if trial.within_limits else -trial.heat_w
    return (trial.within_limits, gain), replace(decided, drive=replace(decided.drive, level_um=trial.level_um))


def _movers(is_open: frozenset[str]) -> tuple[str, ...]:
    """Return names of the washers and magnets to try: all, those of the kind in `is_open`, or one if none is open."""
    if "mover" in is_open:
        return MOVERS
    return tuple(name for name in MOVERS if _kind(name) in is_open) or MOVERS[:1]


WORST = (False, float("-inf"))
NO_PAD = WORST, None
"""Score of parts of which no pad can be made, and that with its spec."""
OF_MOVER = {"mover", "magnet", "washer"}
"""Words of `touch.search` that leave the mover open, of one kind or of any."""
IN_ORDER = ("ratio", "ballast", "start_hz", "place")
"""Parts whose values are in order, so that the search goes to the next ones only."""


def _climbed(
    parts: _TouchParts, name: str, values: tuple[Any, ...], score: Callable[[_TouchParts], tuple[bool, float]]
) -> _TouchParts:
    """Return `parts` with a better value of `name`: by single steps if values are ordered, else the best of all."""
    while True:
        best = max([parts, *(parts._replace(**{name: value}) for value in _next(name, values, parts))], key=score)
        if best == parts or name not in IN_ORDER:
            return best
        parts = best


def _next(name: str, values: tuple[Any, ...], parts: _TouchParts) -> tuple[Any, ...]:
    """Return values of a part to try next: the neighbouring ones if its values have an order, else all others."""
    at = values.index(getattr(parts, name))
    if name in IN_ORDER:
        return values[max(at - 1, 0) : at] + values[at + 1 : at + 2]
    return values[:at] + values[at + 1 :]


def _decided(spec: Spec, parts: _TouchParts, is_open: frozenset[str]) -> Spec:
    """Return the spec with a candidate's parts: two channels a coil, and other resonances on neighbouring coils."""
    change: Cure = {"touch.search": "none"}
    kind = spec.mover.kind
    if not is_open.isdisjoint(OF_MOVER):
        kind = _kind(parts.mover)
        other = {"magnet": "washer", "washer": "magnet"}[kind]
        change |= {kind: parts.mover, other: None, "mover.kind": kind}
    if "coil" in is_open:
        change["coil"] = COILS[kind]
    if "ballast" in is_open:
        change["ballast"] = parts.ballast
    if "suspension" in is_open:
        change["suspension.topology"] = parts.suspension
    if "contactor" in is_open:
        change["contactor.place"] = parts.place
    low = max(parts.start_hz, spec.band_hz[0] * 1.03)
    high = min(low * parts.ratio * INTERLEAVED, spec.band_hz[1] / 1.03)
    coils = ceil(spec.resolution / 2)
    is_alone = coils == 1
    resonances_hz = (low, high) if is_alone else (low, low * INTERLEAVED, high / INTERLEAVED, high)
    change["resonances_hz"] = [round(hz, 3) for hz in resonances_hz[: spec.resolution]]
    pad = spec.pad
    rows = max(round((coils * pad.depth_mm / pad.width_mm) ** 0.5), 1)
    if parts.turned:
        rows = max(rows + (1 if rows**2 < coils * pad.depth_mm / pad.width_mm else -1), 1)
    change |= {"coil.grid": [rows, ceil(coils / rows)], "coil.reuse": "same" if is_alone else "alternate"}
    if spec.drive.level_law == 1.0:
        change["drive.level_law"] = SENSATION
    return varied(spec, change | _plate(spec, parts, is_open))


def _kind(mover: str) -> str:
    return "magnet" if mover in catalogue("magnet") else "washer"


def _plate(spec: Spec, parts: _TouchParts, is_open: frozenset[str]) -> Cure:
    """Return spec changes that make plate and frame thick enough for washer or magnet and ballast, if needed."""
    printer = spec.printer
    name = parts.ballast if "ballast" in is_open else None
    height_mm = catalogue("ballast")[name]["height_mm"] if name else 0.0
    if "ballast" not in is_open and spec.ballast:
        height_mm = spec.ballast.height_mm
    moved_mm = spec.washer_or_magnet.thickness_mm
    if not is_open.isdisjoint(OF_MOVER):
        moved_mm = catalogue(_kind(parts.mover))[parts.mover]["thickness_mm"]
    recess_mm = printer.height_mm(printer.layers_up_to(moved_mm + spec.taxel.glue_gap_mm))
    least_mm = round(recess_mm + height_mm + 4 * printer.layer_mm, 6)
    if least_mm <= spec.taxel.plate_thickness_mm:
        return {}
    frame_mm = max(least_mm, spec.pad.frame_thickness_mm)
    return {"taxel.plate_thickness_mm": least_mm, "pad.frame_thickness_mm": frame_mm}
