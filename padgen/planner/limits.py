"""List the limits of coils, amplifiers, gaps, beams and skin: one row each, for plans, samples, firmware and benches.

A plan asks for all taxels on at its level, a timeline for what its samples show, the firmware for whatever a host may
send, a bench for its excitation: each makes a `Demand`, and `exceeded` says which limits it breaks. A new limit is one
row of `LIMITS`, or one call of `register`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from math import hypot, inf
from typing import Any, NamedTuple

from padgen.core.errors import SpecError, about, at_least, at_most, number, plural
from padgen.core.registry import new_extension_table
from padgen.core.units import MM, UM
from padgen.physics.magnetics import balanced_deflection, pull_in_deflection
from padgen.physics.resonator import HAND_LIMIT_M_PER_S2, weighted_acceleration
from padgen.physics.selectivity import SQUARE
from padgen.physics.warmth import WARM_ERROR
from padgen.planner.channels import hanging_gap_um
from padgen.planner.movers.magnet import demagnetising_limit_c
from padgen.planner.plan import Channel
from padgen.planner.sizing import STRENGTH_OVER_FATIGUE
from padgen.spec import Coil, Spec, catalogue

__all__ = [
    "LOWER",
    "NEAR",
    "SMALLEST_LEVEL_UM",
    "Demand",
    "Exceeded",
    "Limit",
    "MovingTaxel",
    "exceeded",
    "limits",
    "linear_deflection_um",
    "lower_level",
    "most_asked",
    "pull_in_share",
    "register",
    "unregister",
]

NEAR = 1 + 1e-9
"""Factor above a bound up to which it counts as kept: rounding."""
SMALLEST_LEVEL_UM = 1e-4
"""Smallest level that a spec may ask for."""
LARGE_MOTION = 0.25
"""Largest deflection of a beam over its length. The secant stiffness of a cantilever under an end load is then 7 %
above that of linear theory (elastica)."""
LOWER = 0.5
"""Share of the level that is tried where the limit's quantity does not go with a power of the level."""
GAPS_TRIED = (1.01, 1.3, 2.0)
"""Wider gaps that are proposed, over three times the travel: farther from the coil a washer is pulled more evenly."""

Cures = tuple[dict[str, Any], ...]


class MovingTaxel(NamedTuple):
    """A taxel of `channel` moving at `level` times its ON level; its coil's mean square current is `square_a2` in A².

    For a force in proportion to the current itself, which has no mean, it is 0.
    """

    channel: Channel
    square_a2: float
    level: float


class Demand(NamedTuple):
    """The most that is asked at once: peak voltage, current and heat of any coil, heat of all coils, motion of taxels.

    `peak_v` in V, `peak_a` in A, `coil_w` and `pad_w` in W; `beam_rise_k` in K, where it is known: the rise of the
    warmest beams over the room.
    """

    peak_v: float
    peak_a: float
    coil_w: float
    pad_w: float
    moved: tuple[MovingTaxel, ...] = ()
    beam_rise_k: float = 0.0


def linear_deflection_um(channel: Channel, square_a2: float) -> float:
    """Return the static deflection in µm under the mean pull, as if the pull did not grow while the gap closes."""
    return max(square_a2 * channel.force_constant_n_per_a2, 0.0) / channel.stiffness_n_per_m / UM


def pull_in_share(spec: Spec, channel: Channel, square_a2: float) -> float:
    """Return the mean pull on a washer at a mean square current, divided by the pull at which it snaps to the coil."""
    gap_um = float(hanging_gap_um(spec, channel.sag_um))
    _, largest_um = pull_in_deflection(gap_um, max(channel.pull_exponent, 0.0))
    return linear_deflection_um(channel, square_a2) / largest_um


def _resting_um(spec: Spec, one: MovingTaxel) -> float:
    """Return a mover's static deflection in µm: sag by weight plus deflection by mean pull, or by the gap if it snaps.

    A magnet's includes the deflection by the core's pull at rest.
    """
    channel = one.channel
    gap_um = float(hanging_gap_um(spec, channel.sag_um))
    linear_um = linear_deflection_um(channel, one.square_a2)
    static_um = balanced_deflection(linear_um, gap_um, max(channel.pull_exponent, 0.0))
    at_rest_um = channel.static_um if spec.force_order == 1 else 0.0
    return channel.sag_um + at_rest_um + (gap_um if static_um is None else static_um)


def _travel_mm(spec: Spec, one: MovingTaxel) -> float:
    """Return the largest deflection of a washer in mm from the straight beam: by weight, mean pull and amplitude."""
    return (_resting_um(spec, one) + one.level * one.channel.level_um) * UM / MM


def _root_stress_mpa(spec: Spec, one: MovingTaxel) -> float:
    """Return the largest stress in MPa at the roots of a taxel's beams: by sag, mean pull and amplitude."""
    return one.channel.root_stress_mpa * _travel_mm(spec, one) * MM / UM / one.channel.level_um


def _at_finger_um(channel: Channel) -> float:
    """Return the amplitude in µm at the skin: of the mover, or of a pin on the beam, which also sways."""
    pin = channel.pin
    return channel.level_um * (hypot(pin.lever, pin.sway) if pin.on_beam else pin.lever)


def lower_level(spec: Spec, share: float) -> Cures:
    """Return the spec change that multiplies the level by `share`; empty if that is below the least allowed level."""
    level_um = float(at_most(spec.drive.level_um * share))
    return ({"drive.level_um": level_um},) if level_um >= SMALLEST_LEVEL_UM else ()


def _more_room(spec: Spec, travel_mm: float) -> Cures:
    """Return spec changes for a travel that takes too much of the gap: wider gaps and lower levels."""
    gaps = [float(at_least(3 * travel_mm * factor)) for factor in GAPS_TRIED]
    wider = [{"coil.gap_mm": gap_mm} for gap_mm in gaps if spec.coil.gap_mm < gap_mm <= LARGEST_GAP_MM]
    return (*wider, *lower_level(spec, LOWER), *lower_level(spec, 0.1))


LARGEST_GAP_MM = next(item.metadata["high"] for item in fields(Coil) if item.name == "gap_mm")


@dataclass(frozen=True)
class Limit:
    """One limit: a quantity that a plan or drive asks for, and the bound that it must not exceed.

    `asked` returns the quantity in `unit` of a `Demand`, or of a `MovingTaxel` where it is `of_taxels`; `bound` returns
    what a spec allows, infinity where nothing limits it, and `bound_name` says what that is. The quantity goes with the
    level's power of 1/`power`; None: with no power of it. `cures` returns changes of the spec that may keep the limit,
    by default the level that does. `planned` is the level of a plan's finding.

    `level_factor` is the name of the limit where it bounds the level that a coil reaches, `firmware` that of the
    constant, in millionths of the unit, by which the firmware keeps it. A channel, or a pad, that exceeds a limit of
    `implied_by`, which stand before this one, is not told of this one, too. Sentences have the quantity with so many
    significant `digits` as it is sure to have, or more where it would be written as its bound. `pattern` is the
    sentence where the usual one would be hard to read: with the fields `asked` and `bound`, units included.
    """

    code: str
    where: str
    quantity: str
    unit: str
    bound_name: str
    bound: Callable[[Spec], float]
    asked: Callable[[Spec, Any], float]
    of_taxels: bool = False
    power: float | None = 1.0
    cures: Callable[[Spec, float], Cures] | None = None
    planned: str = "error"
    level_factor: str = ""
    firmware: str = ""
    implied_by: tuple[str, ...] = ()
    digits: int = 5
    pattern: str = ""

    def share_of_level(self, spec: Spec, asked: float) -> float:
        """Return the factor on the level that brings the quantity to its bound; a guess where no power law holds."""
        if self.power is None:
            return LOWER
        power = self.power
        # What goes with the current goes with the level itself, not its root, where the force goes with the current.
        if not self.of_taxels:
            power *= spec.force_order / SQUARE
        return (self.bound(spec) / asked) ** power if asked > 0 else inf


class Exceeded(NamedTuple):
    """A limit that is exceeded: `asked` and `bound` in its unit, and the channels that exceed it, if any."""

    limit: Limit
    asked: float
    bound: float
    channels: tuple[int, ...]

    @property
    def sentence(self) -> str:
        """Clause that states the quantity that is asked for, and its bound."""
        limit = self.limit
        unit = f" {limit.unit}" if limit.unit != "1" else ""
        worst = f" (channel {self.channels[0]})" if self.channels else ""
        bound = f"{limit.bound_name} = {number(self.bound)}" if limit.bound_name else number(self.bound)
        asked = about(self.asked, limit.digits)
        if float(asked) <= self.bound:
            asked = number(self.asked)
        if limit.pattern:
            return limit.pattern.format(asked=f"{asked}{unit}{worst}", bound=f"{number(self.bound)}{unit}")
        return f"{limit.quantity} is {asked}{unit}{worst}, above {bound}{unit}"

    @property
    def where(self) -> str:
        """Name of the part at fault: the channels that exceed the limit, else the coil or the pad."""
        if not self.channels:
            return self.limit.where
        return f"channel{plural(len(self.channels))} {', '.join(map(str, sorted(self.channels)))}"


def exceeded(spec: Spec, demand: Demand) -> Iterator[Exceeded]:
    """Yield the limits that `demand` exceeds, in the table's order, each with its channels at fault, worst first.

    A channel is judged by that of its taxels that asks for most.
    """
    sentences: dict[str, set[int]] = {}
    for limit in limits():
        bound = limit.bound(spec)
        if not limit.of_taxels:
            asked = limit.asked(spec, demand)
            if asked > bound * NEAR and sentences.keys().isdisjoint(limit.implied_by):
                sentences[limit.code] = set()
                yield Exceeded(limit, asked, bound, ())
            continue
        most: dict[int, float] = {}
        for one in demand.moved:
            value = limit.asked(spec, one)
            most[one.channel.index] = max(value, most.get(one.channel.index, value))
        known = set[int]().union(*(sentences.get(code, ()) for code in limit.implied_by))
        broken = [index for index in most if most[index] > bound * NEAR and index not in known]
        sentences[limit.code] = {*broken}
        if broken:
            broken.sort(key=lambda index: (-most[index], index))
            yield Exceeded(limit, most[broken[0]], bound, tuple(broken))


def most_asked(limit: Limit, spec: Spec, demand: Demand) -> float:
    """Return a limit's quantity in `demand`: the largest of all taxels if it is per taxel, -inf if none moves."""
    if limit.of_taxels:
        return max((limit.asked(spec, one) for one in demand.moved), default=-inf)
    return limit.asked(spec, demand)


def _amplifier_a(spec: Spec) -> float:
    return spec.amplifier.current_a if spec.amplifier else inf


def _pad_w(spec: Spec) -> float:
    return inf if spec.limits.power_w is None else spec.limits.power_w


def _magnet_rise_k(spec: Spec) -> float:
    return inf if spec.magnet is None else demagnetising_limit_c(spec.magnet) - spec.limits.room_c


def _thicker_magnets(spec: Spec) -> Cures:
    """Return spec changes for a magnet that gets too warm: thicker magnets, which demagnetise themselves less."""
    magnet = spec.magnet
    if magnet is None:
        return ()
    known = catalogue("magnet").items()
    wide = [(name, entry) for name, entry in known if entry["outer_diameter_mm"] == magnet.outer_diameter_mm]
    return tuple({"magnet": name} for name, entry in wide if entry["thickness_mm"] > magnet.thickness_mm)


BELOW_GLASS_K = 15.0
"""Distance from the glass point within which the stiffness of plastics falls steeply, and loaded beams creep."""
BEARS = f"the plastic bears {{bound}} (from limits.room_c to {BELOW_GLASS_K:g} K below material.glass_c)"
GLASS_NAME = f"what the plastic bears, from limits.room_c to {BELOW_GLASS_K:g} K below material.glass_c"


def _rise_k(spec: Spec) -> float:
    glass_c = spec.material.glass_c
    return inf if glass_c is None else glass_c - BELOW_GLASS_K - spec.limits.room_c


LIMITS = (
    Limit(
        "coil.voltage",
        "coil",
        "the peak voltage of a coil",
        "V",
        "drive.voltage_limit_v",
        lambda spec: spec.drive.voltage_limit_v,
        lambda _, demand: demand.peak_v,
        power=2,
        level_factor="voltage",
        firmware="PADGEN_VOLTAGE_LIMIT_UV",
    ),
    Limit(
        "coil.current",
        "coil",
        "the peak current of a coil",
        "A",
        "amplifier.current_a",
        _amplifier_a,
        lambda _, demand: demand.peak_a,
        power=2,
        level_factor="amplifier's current",
        firmware="PADGEN_AMPLIFIER_UA",
    ),
    Limit(
        "coil.heat",
        "coil",
        "the heat of a coil",
        "W",
        "coil.power_limit_w",
        lambda spec: spec.coil.power_limit_w,
        lambda _, demand: demand.coil_w,
        level_factor="copper loss",
        firmware="PADGEN_COIL_LIMIT_UW",
    ),
    Limit(
        "limits.power",
        "pad",
        "the heat of all coils together",
        "W",
        "limits.power_w",
        _pad_w,
        lambda _, demand: demand.pad_w,
        firmware="PADGEN_PAD_LIMIT_UW",
    ),
    Limit(
        "magnet.hot",
        "pad",
        "the rise of the warmest beams over the room",
        "K",
        "what the magnets bear, from limits.room_c to the temperature at which half of one is past its knee",
        _magnet_rise_k,
        lambda _, demand: demand.beam_rise_k,
        cures=lambda spec, _: _thicker_magnets(spec),
        pattern="the warmest beams rise by {asked} over the room; the magnets bear {bound} (from limits.room_c to the"
        " temperature at which half of one is past its knee)",
    ),
    Limit(
        "pad.hot",
        "pad",
        f"the rise of the warmest beams over the room, less {WARM_ERROR:.0%} for what is unsure of it",
        "K",
        GLASS_NAME,
        _rise_k,
        lambda _, demand: demand.beam_rise_k * (1 - WARM_ERROR),
        cures=lambda spec, rise_k: lower_level(spec, _rise_k(spec) * (1 - WARM_ERROR) / rise_k),
        digits=2,
        pattern=f"the warmest beams rise by at least {{asked}} over the room, {WARM_ERROR:.0%} taken off for what is"
        f" unsure of it; {BEARS}",
    ),
    Limit(
        "pad.warm",
        "pad",
        "the rise of the warmest beams over the room",
        "K",
        GLASS_NAME,
        _rise_k,
        lambda _, demand: demand.beam_rise_k,
        planned="warning",
        implied_by=("pad.hot",),
        digits=2,
        pattern=f"the warmest beams rise by {{asked}} over the room; {BEARS}",
    ),
    Limit(
        "coil.pull_in",
        "coil",
        "the mean pull over the one at which the washer snaps to the coil",
        "1",
        "",
        lambda _: 1.0,
        lambda spec, one: pull_in_share(spec, one.channel, one.square_a2),
        of_taxels=True,
        pattern="the mean pull is {asked} times the pull at which the washer snaps to the coil; it must stay below it",
    ),
    Limit(
        "gap.contact",
        "gap",
        "the travel (sag, mean pull and amplitude)",
        "mm",
        "the whole gap, coil.gap_mm",
        lambda spec: spec.coil.gap_mm,
        _travel_mm,
        of_taxels=True,
        power=None,
        cures=_more_room,
        implied_by=("coil.pull_in",),
        digits=4,
        pattern="the travel (sag, mean pull and amplitude) is {asked}, more than the whole gap, coil.gap_mm = {bound}",
    ),
    Limit(
        "gap.travel",
        "gap",
        "the travel (sag, mean pull and amplitude)",
        "mm",
        "a third of coil.gap_mm",
        lambda spec: spec.coil.gap_mm / 3,
        _travel_mm,
        of_taxels=True,
        power=None,
        cures=_more_room,
        planned="warning",
        implied_by=("coil.pull_in", "gap.contact"),
        digits=4,
        pattern="the travel (sag, mean pull and amplitude) is {asked}, more than a third of coil.gap_mm, {bound}",
    ),
    Limit(
        "beam.strength",
        "beam",
        "the stress at the root of a beam by sag, mean pull and amplitude",
        "MPa",
        f"the strength, {STRENGTH_OVER_FATIGUE:g} x material.fatigue_stress_mpa",
        lambda spec: STRENGTH_OVER_FATIGUE * spec.material.fatigue_stress_mpa,
        _root_stress_mpa,
        of_taxels=True,
        power=None,
    ),
    Limit(
        "beam.sag",
        "beam",
        "the travel over the length of the beam",
        "1",
        "the largest for which figures hold",
        lambda _: LARGE_MOTION,
        lambda spec, one: _travel_mm(spec, one) / one.channel.beam.length_mm,
        of_taxels=True,
        power=None,
    ),
    Limit(
        "beam.stress",
        "beam",
        "the alternating stress at the root of a beam",
        "MPa",
        "material.fatigue_stress_mpa",
        lambda spec: spec.material.fatigue_stress_mpa,
        lambda _, one: one.level * one.channel.root_stress_mpa,
        of_taxels=True,
        level_factor="root stress",
    ),
    Limit(
        "skin.level",
        "skin",
        "the acceleration at a finger (weighted by ISO 5349-1)",
        "m/s²",
        "what Directive 2002/44/EC allows for eight hours a day",
        lambda _: HAND_LIMIT_M_PER_S2,
        lambda _, one: weighted_acceleration(one.channel.resonance_hz, one.level * _at_finger_um(one.channel) * UM),
        of_taxels=True,
        pattern="the acceleration at a finger (weighted by ISO 5349-1) is {asked}, above {bound}, what Directive"
        " 2002/44/EC allows for eight hours a day",
    ),
)
"""The table: a limit is a row of it."""
_registered: dict[str, Limit] = new_extension_table()


def limits() -> tuple[Limit, ...]:
    """Return all limits: those of the table, then the registered ones."""
    return (*LIMITS, *_registered.values())


def register(limit: Limit) -> None:
    """Add a limit; `unregister` removes it.

    Raises
    ------
    SpecError
        Its code is taken.
    """
    if limit.code in (one.code for one in limits()):
        raise SpecError(f"there is a limit {limit.code!r} already; take another code", "limit")
    _registered[limit.code] = limit


def unregister(code: str) -> None:
    """Remove a registered limit; those of the table cannot be removed."""
    del _registered[code]
