"""Compute how skin changes resonances, Q and selectivity, and how far taxels vibrate above the threshold of feeling.

Skin is one of the models of `padgen.physics.contact` with the catalogue's data, all provisional. What is felt is of
untouched taxels that reach their planned levels, against `padgen.planner.thresholds`.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from math import inf, log, pi

import numpy as np

from padgen.core.errors import Finding, at_least, at_most, less_or_more_text, number, plural
from padgen.core.registry import CONTACTS
from padgen.core.units import GRAM, MM, UM, decibel
from padgen.physics.contact import Contact, Contactor, LoadedTaxels, Scaled, loaded_resonance
from padgen.physics.selectivity import Responses, Scheme, line_energy, off_energy, own_lines
from padgen.physics.sensation import distinct_frequencies, distinct_levels, level_db
from padgen.planner.channels import heard_modes
from padgen.planner.drive_scheme import placed_channels
from padgen.planner.plan import Channel, Felt, Plan, Touched, channel_sets
from padgen.planner.thresholds import SENSATION, detection_threshold
from padgen.spec import Spec
from padgen.spec.load import catalogue
from padgen.spec.model import ContactorTable

__all__ = [
    "SKINS",
    "contact_of",
    "contactor_of",
    "felt_levels",
    "indentation_mm",
    "judge_felt",
    "judge_touch",
    "lever_of",
    "skin_contact",
    "skin_figures",
    "skin_spreads",
]

SKINS = ("low", "typical", "high")
SKIN_MODEL = "half-space"


@cache
def skin_contact(site: str, which: str) -> Contact:
    """Return the catalogue's contact model of 'low', 'typical' or 'high' skin at `site`, 'fingertip' or 'palm'."""
    contact: Contact = CONTACTS.get(SKIN_MODEL).made_of(catalogue("skin")[f"{site}-{which}"])
    return contact


FIGURES = ("modulus_kpa", "layer_mm", "time_ms")
"""Figures of a catalogue's skin that differ from person to person and from place to place."""
OWN_FIGURES = ("k_n_per_m", "c_n_s_per_m", "m_g")
"""The same of a contact of one's own."""
SITE = "fingertip"
"""Skin by which a pad is judged whose spec names no contact."""
LOW_HIGH_SIGMAS = 1.6449
"""Sigmas from typical to low and high skin, which are 5 % and 95 % of people."""


def _site(spec: Spec) -> str:
    return SITE if spec.touch.is_untouched else spec.touch.contact


def skin_spreads(spec: Spec) -> dict[str, tuple[float, float]]:
    """Return each skin property's spread between people: sigmas of its logarithm below and above the typical value."""
    people = spec.touch.people
    site = _site(spec)
    if site == "own":
        return dict.fromkeys(OWN_FIGURES, (people or 0.0, people or 0.0))
    if people is not None:
        return dict.fromkeys(FIGURES, (people, people))
    low, typical, high = (catalogue("skin")[f"{site}-{which}"] for which in SKINS)
    return {
        name: (log(typical[name] / low[name]) / LOW_HIGH_SIGMAS, log(high[name] / typical[name]) / LOW_HIGH_SIGMAS)
        for name in FIGURES
    }


def contact_of(spec: Spec, which: str = "typical", factors: Mapping[str, np.ndarray] | None = None) -> Contact:
    """Return the model of the skin (or the user's own contact) that a spec names: its 'low', 'typical' or 'high' one.

    With `factors`, figures of skin are multiplied by them. A spec without a contact is judged by fingertips.
    """
    if factors is None and (spec.touch.is_untouched or spec.touch.people is None) and spec.touch.contact != "own":
        return skin_contact(_site(spec), which)
    if factors is None:
        sigmas = {"low": -LOW_HIGH_SIGMAS, "typical": 0.0, "high": LOW_HIGH_SIGMAS}[which]
        spreads = skin_spreads(spec)
        factors = {name: np.exp(sigmas * (above if sigmas > 0 else below)) for name, (below, above) in spreads.items()}
    if _site(spec) != "own":
        typical = catalogue("skin")[f"{_site(spec)}-typical"]
        contact: Contact = CONTACTS.get(SKIN_MODEL).made_of({name: typical[name] * factors[name] for name in FIGURES})
        return contact
    touch = spec.touch
    given = {"hz": touch.hz, "k_n_per_m": touch.k_n_per_m, "c_n_s_per_m": touch.c_n_s_per_m, "m_g": touch.m_g}
    table = CONTACTS.get("table").made_of({name: value for name, value in given.items() if value is not None})
    return Scaled(table, *(factors[name] for name in OWN_FIGURES))


def contactor_of(spec: Spec) -> Contactor:
    """Return the flat disc that meets the skin: radius in m, guard hole's over disc's diameter, indentation in m."""
    diameter_mm = spec.contact_diameter_mm
    hole_ratio = spec.guard_hole_mm / diameter_mm if spec.guard_height_mm else inf
    return Contactor(diameter_mm / 2 * MM, hole_ratio, indentation_mm(spec) * MM)


def indentation_mm(spec: Spec) -> float:
    """Return how deep in mm a boss or pin at rest presses into skin: by the spec, else its height above the guard.

    The height counts up to `MOST_PRESSED_MM`. The indentation is 0 without a touch, or with neither of them.
    """
    if spec.touch.is_untouched:
        return 0.0
    if spec.touch.indentation_mm is not None:
        return spec.touch.indentation_mm
    return min(spec.contact_proud_mm, MOST_PRESSED_MM) if spec.guard_height_mm else 0.0


MOST_PRESSED_MM = 0.5
"""Indentation up to which anything is assumed of how skin stiffens."""


def lever_of(spec: Spec, channels: Sequence[Channel]) -> np.ndarray:
    """Return ratios (n,), by channel, of the pin's effective motion against skin to the motion of the washer or magnet.

    It is 1 where the spec plans for no contact: what untouched pads say of fingers is of bosses that move straight up.
    """
    if spec.touch.is_untouched:
        return np.ones(len(channels))
    return np.array([channel.pin.load_lever for channel in channels])


MOST_CHANNELS = 32
"""Most channels of a coil for which the selectivity under a finger is computed."""


def skin_figures(spec: Spec, channels: Sequence[Channel], scheme: Scheme) -> Iterator[Touched]:
    """Yield, for low, typical and high skin on every taxel, resonances, Q and selectivity under tones for bare taxels.

    Only the taxels' own modes and one coil are counted.
    """
    contactor = contactor_of(spec)
    for which in SKINS:
        skin = contact_of(spec, which)
        taxels = _loaded(spec, skin, channels)
        hz, q = loaded_resonance(*taxels)
        kept_db = [_kept_db(spec, channel_set, scheme, skin) for channel_set in channel_sets(channels, spec.coil.sets)]
        yield Touched(
            skin=which,
            skin_stiffness_n_per_m=float(skin.impedance(0.0, contactor).stiffness),
            resonance_hz=tuple(hz.tolist()),
            q=tuple(q.tolist()),
            all_states_db=None if None in kept_db else min(db for db in kept_db if db is not None),
        )


def _loaded(spec: Spec, contact: Contact, channels: Sequence[Channel]) -> LoadedTaxels:
    stiffness, mass_g, q = np.array([(c.stiffness_n_per_m, c.effective_mass_g, c.q) for c in channels]).T
    return LoadedTaxels(contact, contactor_of(spec), stiffness, mass_g * GRAM, q, lever_of(spec, channels))


def _kept_db(spec: Spec, channel_set: Sequence[Channel], scheme: Scheme, skin: Contact) -> float | None:
    """Return a touched coil's selectivity in dB: its smallest ON level over its largest OFF level in any on/off state.

    None for a single channel, or for more than `MOST_CHANNELS`.
    """
    if not 2 <= len(channel_set) <= MOST_CHANNELS:
        return None
    planned = placed_channels(spec, channel_set)
    taxels = _loaded(spec, skin, channel_set)
    (made,) = own_lines(planned, scheme)
    on = line_energy(planned, made, taxels)[:, 0].diagonal()
    return decibel(float((on.min() / off_energy(planned, scheme, taxels).max()) ** 0.5))


STIFFENED = 0.1
"""Largest stiffness of skin over a taxel's that counts as not loading it; the resonance is then 5 % higher."""
KEPT_Q = 8.0
"""Q that a touched taxel is to keep, by the loss of the skin alone."""
SMALLEST_CONTACT_MM = 0.4
"""Width of the finest pin that a common printer makes: one line of a 0.4 mm nozzle."""
HEAVIEST_G = 2.5
"""Heaviest mass that hangs on a taxel of some 6 mm: a short steel dowel."""
HIGHEST_FELT_HZ = 800.0
"""Highest frequency that skin feels well enough to be of use."""
HALVINGS = 40


def _skin_load_ratio(skin: Contact, contactor: Contactor, hz: float, stiffness: float) -> float:
    """Return skin's load on a taxel divided by the tolerable load: above 1, f rises by over 5 % or Q falls below 8."""
    added = skin.impedance(hz, contactor)
    stiffens = float(added.stiffness) / stiffness / STIFFENED
    return max(stiffens, 2 * pi * hz * float(added.damping) * KEPT_Q / stiffness)


def _largest(low: float, high: float, holds: Callable[[float], bool]) -> float:
    """Return the largest value from `low` to `high` for which `holds` returns true, found by bisection."""
    if holds(high):
        return high
    for _ in range(HALVINGS):
        middle = (low * high) ** 0.5
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def judge_touch(plan: Plan) -> Iterator[Finding]:
    """Yield a note if typical skin stiffens or damps a taxel too much, with the contact width, mass or Hz that helps.

    A pad that is planned under a contact is judged by what it keeps there.
    """
    if plan.touch is not None:
        return
    skin = contact_of(plan.spec, "typical")
    contactor = contactor_of(plan.spec)
    burdens = [_skin_load_ratio(skin, contactor, c.resonance_hz, c.stiffness_n_per_m) for c in plan.channels]
    worst = max(plan.channels, key=lambda c: burdens[c.index])
    if burdens[worst.index] <= 1:
        return
    typical = next(t for t in plan.touched if t.skin == "typical")
    mass = worst.effective_mass_g * GRAM
    stiffness = worst.stiffness_n_per_m

    def smaller(radius: float) -> bool:
        return _skin_load_ratio(skin, contactor._replace(radius=radius), worst.resonance_hz, stiffness) <= 1

    def too_low(hz: float) -> bool:
        return _skin_load_ratio(skin, contactor, hz, mass * (2 * pi * hz) ** 2) > 1

    contact_mm = 0.0
    if smaller(SMALLEST_CONTACT_MM / 2 * MM):
        contact_mm = 2 * _largest(SMALLEST_CONTACT_MM / 2 * MM, float(contactor.radius), smaller) / MM
    heavy_g = mass * burdens[worst.index] / GRAM
    high_hz = _largest(worst.resonance_hz, 2 * HIGHEST_FELT_HZ, too_low)
    hz = typical.resonance_hz[worst.index]
    q = typical.q[worst.index]
    kept = typical.all_states_db
    heard = "" if kept is None else f", and OFF taxels vibrate {less_or_more_text(kept)} than ON ones"
    ways = []
    if contact_mm:
        ways.append(f"a contact {at_most(contact_mm)} mm wide")
    if heavy_g <= HEAVIEST_G:
        ways.append(f"a moving mass of {at_least(heavy_g)} g")
    if high_hz <= HIGHEST_FELT_HZ:
        ways.append(f"a resonance of {at_least(high_hz)} Hz")
    cure = f"{' or '.join(ways)} would hold its resonance within 5 %"
    if not ways:
        cure = "no change of contact, moving mass or resonance alone would hold its resonance within 5 %"
    yield Finding(
        "note",
        "touch.skin",
        f"channel {worst.index}",
        f"under typical skin (a provisional model) it resonates at {hz:.1f} Hz instead of"
        f" {number(worst.resonance_hz)} Hz, with a Q of {q:.2g}{heard}; {cure}",
    )


def felt_levels(spec: Spec, channels: Sequence[Channel], scheme: Scheme, contact: Contact | None = None) -> Felt:
    """Return how far above the threshold of feeling each channel's ON and loudest OFF taxel vibrate.

    Of one coil in its worst states, as planned; with `contact` on all taxels, each then by its own mode alone.
    """
    threshold = detection_threshold(spec)
    hz = np.array([channel.resonance_hz for channel in channels])
    level_m = np.array([channel.level_um * channel.pin.lever for channel in channels]) * UM
    lost = np.array([channel.level_loss_db for channel in channels])
    on_db = level_db(level_m, hz, threshold) - lost
    off_db = np.full(len(channels), -inf)

    def weight(line_hz: np.ndarray) -> np.ndarray:
        return np.asarray(threshold.amplitude(line_hz) ** -2)

    for channel_set in channel_sets(channels, spec.coil.sets):
        planned = placed_channels(spec, channel_set)
        taxels: Responses = heard_modes(spec, channel_set, planned.line)
        at = [channel.index for channel in channel_set]
        if contact:
            taxels = _loaded(spec, contact, channel_set)
            (made,) = own_lines(planned, scheme)
            on_db[at] += 10 * np.log10(line_energy(planned, made, taxels)[:, 0].diagonal())
        with np.errstate(divide="ignore"):
            off_db[at] = 10 * np.log10(off_energy(planned, scheme, taxels, weight=weight) * level_m[at] ** 2)
    by_name = catalogue("difference")
    near = by_name["amplitude-threshold"]
    small = by_name["amplitude-small"]
    weber = by_name["frequency-fingertip"]
    felt_hz = hz[on_db >= 0].tolist()
    return Felt(
        threshold_um=tuple((threshold.amplitude(hz) / UM).tolist()),
        error_db=tuple(threshold.error_at(hz).tolist()),
        on_db=tuple(on_db.tolist()),
        off_db=tuple(db if db > -inf else None for db in off_db.tolist()),
        least_levels=tuple(distinct_levels(db, small["largest"], near["smallest"]) for db in on_db.tolist()),
        most_levels=tuple(distinct_levels(db, small["smallest"]) for db in on_db.tolist()),
        least_frequencies=distinct_frequencies(felt_hz, weber["largest"]),
        most_frequencies=distinct_frequencies(felt_hz, weber["smallest"]),
    )


MARGIN_DB = 0.1
"""Distance of a cure's levels from the threshold."""


def judge_felt(plan: Plan) -> Iterator[Finding]:
    """Yield warnings of ON taxels too faint to be felt, and of OFF taxels that are felt, with levels that may help.

    Where the spec has a threshold of its own, `level.threshold` tells of the first.
    """
    felt = plan.felt
    spec = plan.spec
    # The faintest ON taxel is to be felt, and the loudest OFF taxel is not.
    softest = min(plan.channels, key=lambda channel: felt.on_db[channel.index])
    loudest = max(plan.channels, key=lambda channel: _or_silent(felt.off_db[channel.index]))
    below_db = -felt.on_db[softest.index]
    above_db = _or_silent(felt.off_db[loudest.index])
    part = "boss" if spec.contactor == ContactorTable() else "pin"
    through = f"a fingertip feels through its {part} of {number(spec.contact_diameter_mm)} mm"
    if below_db > 0 and not spec.drive.threshold_hz:
        silent = [channel.index for channel in plan.channels if felt.on_db[channel.index] < 0]
        yield Finding(
            "warning",
            "felt.below",
            f"channel{plural(len(silent))} {', '.join(map(str, silent))}",
            f"too faint to be felt: {f'at worst, channel {softest.index}' if len(silent) > 1 else 'it'} vibrates by"
            f" {softest.level_um:.2g} µm at {number(softest.resonance_hz)} Hz when ON, {below_db:.1f} dB less than the"
            f" {felt.threshold_um[softest.index]:.2g} µm (± {felt.error_db[softest.index]:.0f} dB) that {through}",
            tuple(_louder(plan, below_db)),
        )
    if above_db > 0:
        yield Finding(
            "warning",
            "felt.off",
            f"channel {loudest.index}",
            f"felt although it is OFF: in the worst state the tones of ON taxels move it {above_db:.1f} dB"
            f" (± {felt.error_db[loudest.index]:.0f} dB) above what {through}; the faintest ON taxel is"
            f" {abs(below_db):.1f} dB {'above' if below_db <= 0 else 'below'} what is felt at its own frequency",
            tuple(_softer(plan, above_db)) if below_db + above_db < 0 else (),
        )


def _or_silent(db: float | None) -> float:
    return -inf if db is None else db


def _louder(plan: Plan, below_db: float) -> Iterator[dict[str, float | str]]:
    """Yield spec changes by which every ON taxel would be felt: levels of equal sensation, or more level for all."""
    level_um = plan.spec.drive.level_um
    lowest_um = plan.felt.threshold_um[0] * 10 ** ((plan.channels[0].level_loss_db + MARGIN_DB) / 20)
    equal: dict[str, float | str] = {"drive.level_law": SENSATION}
    if level_um < lowest_um:
        equal["drive.level_um"] = float(at_least(lowest_um))
    if plan.spec.drive.level_law != SENSATION:
        yield equal
    yield {"drive.level_um": float(at_least(level_um * 10 ** ((below_db + MARGIN_DB) / 20)))}


def _softer(plan: Plan, above_db: float) -> Iterator[dict[str, float | str]]:
    """Yield spec changes of level by which no OFF taxel would be felt while every ON taxel still would."""
    drive = plan.spec.drive
    yield {"drive.level_um": float(at_most(drive.level_um * 10 ** (-(above_db + MARGIN_DB) / 20)))}
    if drive.level_law != SENSATION and not drive.threshold_hz:
        yield {"drive.level_law": SENSATION, "drive.level_um": float(at_least(plan.felt.threshold_um[0] * 2))}
