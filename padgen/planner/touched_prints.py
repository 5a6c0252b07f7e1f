"""Plan a pad for the finger or palm that its spec names: tones, levels, and what prints keep under random skins.

Skin is part of every taxel: at each frequency it adds a spring, a damper and a mass to the bare taxel's own. Tones are
at the resonances under typical skin, with forces that give the taxels their levels there, or stay at those of the bare
taxels with the forces of the bare taxels; the kind that keeps more is taken.

A simulated pad is a print (`padgen.planner.printed_pads`) and a person. The person's skin is drawn once, each of its
figures from a distribution whose 5, 50 and 95 % are the catalogue's low, typical and high skin (a log-normal on either
side of the middle); how it is pressed is drawn once, too; and every taxel has skin of its own about that. Taxels that
are compared are all touched. Of each coil, in every state, the smallest ON is compared with the largest OFF amplitude,
each over its planned level, and a pad is as good as its worst coil.

To what an OFF taxel hears of its own coil are added, as energies: leakage of the coils around, at the same tones and so
in the same ratio to its ON amplitude as untouched; its other modes, which skin leaves alone; and the pad's recoil on
the spec's mount, as with typical skin on every taxel.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf, sqrt
from typing import Any, NamedTuple

import numpy as np

from padgen.core.errors import Finding, at_most
from padgen.core.units import GRAM, MA, MM, MN, MS, UM
from padgen.physics.contact import Contact, Contactor, LoadedTaxels, loaded_resonance
from padgen.physics.resonator import relative_energy, ring_up_time
from padgen.physics.schemes import current_lines_a
from padgen.physics.selectivity import Channels, off_energy, scheme_lines
from padgen.planner.channels import driven, heard_modes, wanted_line_a2
from padgen.planner.plan import Channel, Felt, Plan, Touch, Touched, channel_sets, level_law
from padgen.planner.printed_pads import (
    DRAWN,
    MOST_DRAWN,
    PADS,
    QUICK_PADS,
    SURE_SHARE,
    Coils,
    Design,
    Drift,
    Drifted,
    design_of,
    drawn_drift,
    drawn_prints,
    leaked_energy,
    quantile_error,
    rising_db,
    share_error,
    spreads_of,
)
from padgen.planner.shaken_pad import recoil_energy
from padgen.planner.touch import contact_of, contactor_of, felt_levels, indentation_mm, lever_of, skin_spreads
from padgen.spec import Spec

__all__ = [
    "TouchedPrints",
    "judge_touched_prints",
    "planned_touch",
    "played_channels",
    "played_plan",
    "touched_channels",
    "touched_felt",
    "touched_figures",
    "touched_pads",
    "touched_plan",
]

TONES = ("touched", "untouched")
"""The kinds of tones: at the resonances under typical skin, or at those of the bare taxels."""
MOST_TOUCHED = 1 << 17
"""Most touched taxels that are simulated once `PADS` pads have shown what they keep."""
UNMOVED = 1e-30
"""Line that stands in for that of a mover that its coil does not pull."""
OF_SKIN = 200
"""First of the streams of random numbers for skin."""
GRID = np.linspace(-0.8, 0.8, 321)
"""Logarithms of a printed taxel's resonance over its planned one at which touched tones are worked out; straight lines
between them are off by 1e-6 at most."""


def touched_channels(spec: Spec, planned: Sequence[Channel], contact: Contact | None = None) -> tuple[Channel, ...]:
    """Return the channels with their resonance and Q under `contact` (default: typical skin), and the forces they need.

    Stiffness, mass, resonance and Q are those of the touched taxels, and forces and lines those that give them their
    levels by the level law. The working mode moves with them; other modes stay.
    """
    contact = contact or contact_of(spec, "typical")
    lever = lever_of(spec, planned)
    stiffness, mass_g, q = np.array([(c.stiffness_n_per_m, c.effective_mass_g, c.q) for c in planned]).T
    hz, touched_q = loaded_resonance(contact, contactor_of(spec), stiffness, mass_g * GRAM, q, lever)
    added = contact.impedance(hz, contactor_of(spec)).through(lever)
    level = level_law(spec)(hz)
    level_um = spec.drive.level_um * level / level[0]
    result = []
    for k, channel in enumerate(planned):
        stiff = float(stiffness[k] + added.stiffness[k])
        heavier = 1 + float(added.mass[k]) / (mass_g[k] * GRAM)
        quality = float(touched_q[k])
        force_mn = float(level_um[k]) * UM * stiff / quality / MN
        tau_ms = float(ring_up_time(hz[k], quality)) / MS
        working = int(np.argmax(channel.mode_shares))
        modes_hz = list(channel.modes_hz)
        modes_hz[working] = float(hz[k])
        motions = list(channel.mode_motions)
        motions[working] = tuple(part / sqrt(heavier) for part in motions[working])
        result.append(
            replace(
                channel,
                resonance_hz=float(hz[k]),
                q=quality,
                effective_mass_g=channel.effective_mass_g * heavier,
                stiffness_n_per_m=stiff,
                ring_up_ms=tau_ms,
                ring_down_ms=channel.ring_down_ms * tau_ms / channel.ring_up_ms,
                level_um=float(level_um[k]),
                modes_hz=tuple(modes_hz),
                mode_motions=tuple(motions),
                force_mn=force_mn,
                line_a2=wanted_line_a2(force_mn, channel.force_constant_n_per_a2),
                root_stress_mpa=channel.root_stress_mpa * float(level_um[k]) / channel.level_um,
            )
        )
    return tuple(result)


def touched_plan(plan: Plan) -> Plan:
    """Return a plan whose channels are those under typical skin on every taxel, for tables and drives."""
    channels_ = touched_channels(plan.spec, plan.channels)
    return replace(plan, channels=driven(plan.spec, channels_, plan.scheme))


class TouchedPrints(NamedTuple):
    """Simulated pads (p,) under random skins: squared ON over OFF in each one's worst coil, squared weakest ON level.

    The second is over that taxel's planned level. The first is inf where nothing moves OFF taxels.
    """

    ratio: np.ndarray
    weakest: np.ndarray

    def kept_db(self, share: float) -> float | None:
        """Return the dB of selectivity that a `share` of the pads keep; None if in any pad no OFF taxel moves."""
        return _reached_db(self.ratio, share) if np.isfinite(self.ratio).all() else None

    def errors(self, need: float, share: float) -> tuple[float, float]:
        """Return half-widths of 95 % intervals: of the share of pads with `ratio` at least `need`, and of the dB."""
        good = float((self.ratio >= need).mean())
        kept_db, _ = rising_db(np.minimum(self.ratio, np.finfo(float).max), share)
        return share_error(good, len(self.ratio)), quantile_error(kept_db, share)

    def weakest_db(self, share: float) -> float:
        """Return the level, in dB above planned, that the weakest ON taxel at least reaches in a `share` of pads."""
        return _reached_db(self.weakest, share)


def _or_inf(db: float | None) -> float:
    return inf if db is None else db


def _reached_db(energy: np.ndarray, share: float) -> float:
    sorted_db, reached = rising_db(energy, share)
    return float(sorted_db[reached])


class _AddedEnergies(NamedTuple):
    """Squared amplitudes (n,) that leakage, other modes and recoil add to OFF taxels, relative to those when ON.

    `leaks` (2, n) are of the coils around, driven by the table and re-tuned; `modes` is by their other modes, and
    `recoil`, one number for all channels, by the motion of the pad.
    """

    leaks: np.ndarray
    modes: np.ndarray
    recoil: float


def _added_energies(plan: Plan, tones: str) -> _AddedEnergies:
    """Return the squared amplitudes that leakage, other modes and recoil add to OFF taxels, under tones of one kind."""
    played = touched_plan(plan).channels if tones == TONES[0] else plan.channels
    modes = np.zeros(len(plan.channels))
    for own_set, played_set in zip(plan.sets, channel_sets(played, plan.spec.coil.sets), strict=True):
        if len(own_set) < 2:
            continue
        taxels = _lines_of(own_set)
        drivers = _lines_of(played_set)
        heard = heard_modes(plan.spec, own_set, np.maximum(taxels.line, drivers.line))
        more = off_energy(taxels, plan.scheme, heard, drivers) - off_energy(taxels, plan.scheme, None, drivers)
        modes[[channel.index for channel in own_set]] = np.maximum(more, 0.0)
    mount = plan.spec.mount
    moves = mount.is_said and not mount.is_immovable
    return _AddedEnergies(leaked_energy(plan), modes, recoil_energy(touched_plan(plan)) if moves else 0.0)


def _lines_of(channel_set: Sequence[Channel]) -> Channels:
    hz, q, line = np.array([(c.resonance_hz, c.q, c.line_a2) for c in channel_set]).T
    return Channels(hz, q, np.maximum(line, UNMOVED))


def touched_pads(
    plan: Plan,
    pads: int,
    tones: str,
    retuned: bool,
    design: Design | None = None,
    as_drawn: str = "",
    drift: Drift | None = None,
) -> TouchedPrints:
    """Simulate `pads` prints under reproducibly random skins, driven by `tones` (of `TONES`); return what they keep.

    Where they are `retuned`, every bare taxel's resonance is measured and its tone moved; else tones and forces are the
    plan's. Where they are `as_drawn`, they are as planned, and all skin is that, 'low', 'typical' or 'high'. With a
    `drift`, what was re-tuned is judged after it.
    """
    design = design or design_of(plan, None)
    spec = plan.spec
    spreads = spreads_of(spec)
    if as_drawn:
        spreads = spreads.none()
    beside = _added_energies(plan, tones)
    taxels = len(design.channel)
    ratio = np.full(pads, inf)
    weakest = np.full(pads, inf)
    unit = max(min(DRAWN // taxels, MOST_DRAWN), 1)
    lever = lever_of(spec, plan.channels)
    for number in range(-(-pads // unit)):
        count = min(unit, pads - number * unit)
        part = slice(number * unit, number * unit + count)
        drawn = drawn_prints(design, spreads, 0, number, count)
        log_x = np.clip(drawn.log_x[2], GRID[0], GRID[-1])
        later = None if drift is None else drawn_drift(drift, taxels, 0, number, count)
        skin = _Skin(spec, number, count, taxels, as_drawn)
        for coils in design.coils:
            known = np.zeros_like(log_x) if not retuned else log_x
            known_pull = np.zeros_like(log_x) if not retuned else drawn.log_pull[2]
            one = _TouchedCoil(plan, design, coils, lever, np.exp(log_x), np.exp(drawn.log_pull[2]), later)
            on, off = one.energies(skin, tones, known, known_pull)
            leak = beside.leaks[int(retuned), coils.channels, None, None] * on
            off += leak + beside.modes[coils.channels, None, None] + beside.recoil
            ratio[part] = np.minimum(ratio[part], design.kept * _worst(on, off))
            weakest[part] = np.minimum(weakest[part], design.kept * on.min((0, 1)))
    return TouchedPrints(ratio, weakest)


def _worst(on: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Return the smallest ratio (pads,) of an ON to an OFF energy, over all pairs of taxels of one coil."""
    count = len(on)
    worst = np.full(on.shape[-1], inf)
    for k in range(count):
        others = np.delete(on, k, 0).min(0) if count > 1 else on[k]
        with np.errstate(divide="ignore"):
            worst = np.minimum(worst, (others / off[k]).min(0))
    return worst


class _Skin:
    """Random skin on a block of pads: a person and a depth of pressing for each pad, and differences among taxels."""

    def __init__(self, spec: Spec, number: int, pads: int, taxels: int, as_drawn: str) -> None:
        self.spec = spec
        self.as_drawn = as_drawn
        touch = spec.touch
        self.fields = skin_spreads(spec)
        people, places, pressing = (
            np.random.default_rng(np.random.SeedSequence(0, spawn_key=(number, OF_SKIN + k))) for k in range(3)
        )
        count = len(self.fields)
        of_people = people.standard_normal((pads, count))
        if touch.person is not None:
            from statistics import NormalDist  # which loads much

            of_people[:] = NormalDist().inv_cdf(touch.person)
        # (figures, taxels, pads)
        self.people = np.broadcast_to(of_people.T[:, None], (count, taxels, pads))
        self.places = touch.places * places.standard_normal((pads, count, taxels)).transpose(1, 2, 0)
        pressed = indentation_mm(spec) + touch.pressing_mm * pressing.standard_normal(pads)
        self.pressed_mm = np.maximum(pressed, 0.0)

    def of(self, taxels: np.ndarray) -> tuple[Contact, Contactor]:
        """Return contact model and contact disc of taxels by their indices, with parameters (*taxels.shape, pads)."""
        if self.as_drawn:
            return contact_of(self.spec, self.as_drawn), contactor_of(self.spec)
        z = self.people[:, taxels]
        factors = [
            np.exp(z[k] * np.where(z[k] > 0, upper, lower) + self.places[k, taxels])
            for k, (lower, upper) in enumerate(self.fields.values())
        ]
        contactor = contactor_of(self.spec)._replace(indentation=self.pressed_mm * MM)
        return contact_of(self.spec, "typical", dict(zip(self.fields, factors, strict=True))), contactor


class _TouchedCoil:
    """All coils with the same set of channels, on a block of simulated touched pads; arrays (channels, coils, pads)."""

    def __init__(
        self,
        plan: Plan,
        design: Design,
        coils: Coils,
        lever: np.ndarray,
        x: np.ndarray,
        pull: np.ndarray,
        later: Drifted | None,
    ) -> None:
        spec = plan.spec
        self.plan = plan
        self.design = design
        self.coils = coils
        self.members = [plan.channels[k] for k in coils.channels]
        self.lever = lever[coils.channels]
        self.hz = design.resonance_hz[coils.channels]
        self.q = design.q[coils.channels]
        self.mass = design.mass_g[coils.channels] * GRAM
        self.stiffness = self.mass * (2 * np.pi * self.hz) ** 2
        self.pull = design.pull[coils.channels]
        self.typical = contact_of(spec, "typical")
        self.contactor = contactor_of(spec)
        self.x = x[coils.taxels]
        self.pulled = pull[coils.taxels]
        self.q_ratio: np.ndarray | None = None
        if later is not None:
            self.x = self.x * np.exp(later.log_x[coils.taxels])
            self.q_ratio = np.exp(later.log_q[coils.taxels])

    def energies(
        self, skin: _Skin, tones: str, known: np.ndarray, known_pull: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return squared amplitudes of ON taxels, and of OFF ones in the worst state, relative to planned levels.

        `known` and `known_pull` (taxels, pads) are the logarithms of resonance and pull that the tones follow.
        """
        drivers, level = self._played_lines(tones, known[self.coils.taxels], known_pull[self.coils.taxels])
        count = len(self.hz)
        on = np.zeros(self.x.shape)
        off = np.zeros(self.x.shape)
        join = np.maximum if self.plan.scheme.takes_turns else np.add
        for lines in scheme_lines(drivers, self.plan.scheme):
            for i in range(count):
                contact, contactor = skin.of(self.coils.taxels[i])
                force = (self.pull[i] * self.pulled[i] / level[i]) ** 2 * lines.square
                heard = force / np.abs(self._dynamic_stiffness(i, lines.hz, contact, contactor)) ** 2
                of_others = np.ones(len(lines.makers[0]), bool)
                for maker in lines.makers:
                    of_others &= maker != i
                if len(lines.makers) == 1:
                    on[i] = heard[0, i]
                for energy in heard.sum(0)[of_others]:
                    off[i] = join(off[i], energy)
        return on, off

    def _played_lines(self, tones: str, known: np.ndarray, known_pull: np.ndarray) -> tuple[Channels, np.ndarray]:
        """Return frequencies and strengths of the tones that are played, and the levels (by the level law) aimed at."""
        hz = np.empty(known.shape)
        force = np.empty(known.shape)
        law = self.design.law
        for k in range(len(self.hz)):
            bare = LoadedTaxels(
                self.typical,
                self.contactor,
                self.stiffness[k] * np.exp(2 * GRID),
                np.full(len(GRID), self.mass[k]),
                np.full(len(GRID), self.q[k]),
                self.lever[k],
            )
            tone_hz = self.hz[k] * np.exp(GRID)
            dynamic = bare.stiffness / bare.q
            if tones == TONES[0]:
                tone_hz, _ = loaded_resonance(*bare)
                dynamic = np.abs(self._of_typical(bare, tone_hz))
            hz[k] = np.exp(np.interp(known[k], GRID, np.log(tone_hz)))
            if self.q_ratio is None:
                force[k] = np.exp(np.interp(known[k], GRID, np.log(dynamic * law(tone_hz))))
                continue
            # Re-tuning finds every taxel's own Q.
            measured = bare._replace(stiffness=self.stiffness[k] * np.exp(2 * known[k]), mass=self.mass[k])
            measured = measured._replace(q=self.q[k] * self.q_ratio[k])
            dynamic = measured.stiffness / measured.q
            if tones == TONES[0]:
                dynamic = np.abs(self._of_typical(measured, hz[k]))
            force[k] = dynamic * law(hz[k])
        level = law(hz)
        line = force / (self.pull[:, None, None] * np.exp(known_pull))
        return Channels(hz, self.q[:, None, None] * np.ones(hz.shape), line), level

    @staticmethod
    def _of_typical(bare: LoadedTaxels, hz: np.ndarray) -> np.ndarray:
        omega = 2 * np.pi * hz
        without = bare.stiffness - bare.mass * omega**2 + 1j * omega * np.sqrt(bare.stiffness * bare.mass) / bare.q
        return np.asarray(
            without + bare.contact.impedance(hz, bare.contactor).through(bare.lever).dynamic_stiffness(hz)
        )

    def _dynamic_stiffness(self, i: int, hz: np.ndarray, contact: Contact, contactor: Contactor) -> np.ndarray:
        """Return force over displacement in N/m of touched taxels at `hz` (kinds of line, lines, coils, pads)."""
        stiffness = self.stiffness[i] * self.x[i] ** 2
        q = self.q[i] if self.q_ratio is None else self.q[i] * self.q_ratio[i]
        omega = 2 * np.pi * hz
        without = stiffness - self.mass[i] * omega**2 + 1j * omega * np.sqrt(stiffness * self.mass[i]) / q
        return np.asarray(without + contact.impedance(hz, contactor).through(self.lever[i]).dynamic_stiffness(hz))


def planned_touch(plan: Plan, design: Design, quick: bool = False) -> Touch | None:
    """Return resonances, drive and selectivity of a pad under its spec's contact; None where the spec names none.

    `design` is the plan's (`design_of`). With `quick`, few pads are simulated, and only as re-tuned.
    """
    spec = plan.spec
    if spec.touch.is_untouched:
        return None
    share = spec.print_share
    kinds = TONES if spec.touch.tones == "auto" else (spec.touch.tones,)
    tried = {kind: touched_pads(plan, QUICK_PADS, kind, True, design) for kind in kinds}
    kept_db = {kind: fingers.kept_db(share) for kind, fingers in tried.items()}
    tones = max(kinds, key=lambda kind: _or_inf(kept_db[kind]))
    fingers = tried[tones]
    pads = QUICK_PADS
    planned_db = None
    if not quick:
        pads = PADS
        fingers = touched_pads(plan, pads, tones, True, design)
        unsure = (fingers.errors(design.need, share)[0] / SURE_SHARE) ** 2
        enough = min(int(unsure * pads), MOST_TOUCHED // len(plan.taxels))
        if enough > pads:
            pads = enough
            fingers = touched_pads(plan, pads, tones, True, design)
        planned_db = touched_pads(plan, PADS, tones, False, design).kept_db(share)
    error_share, error_db = fingers.errors(design.need, share)
    in_hand_db = max(-fingers.weakest_db(share), 0.0)
    touched = touched_channels(spec, plan.channels)
    played = _played(spec, plan.channels, tones, in_hand_db)
    currents = np.zeros(len(played))
    for channel_set in channel_sets(played, spec.coil.sets):
        lines = np.array([channel.line_a2 for channel in channel_set])
        currents[[channel.index for channel in channel_set]] = current_lines_a(plan.scheme, lines, spec.drive.headroom)
    return Touch(
        contact=spec.touch.contact,
        tones=tones,
        contactor_mm=2 * float(contactor_of(spec).radius) / MM,
        lever=tuple(lever_of(spec, plan.channels).tolist()),
        resonance_hz=tuple(channel.resonance_hz for channel in touched),
        q=tuple(channel.q for channel in touched),
        tone_hz=tuple(channel.resonance_hz for channel in played),
        level_um=tuple(_moved_um(t, p.resonance_hz, p.force_mn) for t, p in zip(touched, played, strict=True)),
        bare_um=tuple(_moved_um(b, p.resonance_hz, p.force_mn) for b, p in zip(plan.channels, played, strict=True)),
        force_mn=tuple(channel.force_mn for channel in played),
        current_ma=tuple((currents / MA).tolist()),
        all_states_db=touched_pads(plan, 1, tones, True, design, as_drawn="typical").kept_db(share),
        print_db=fingers.kept_db(share),
        planned_db=planned_db,
        other_db=next((db for kind, db in kept_db.items() if kind != tones), None),
        loose_db=None if quick else _loose_db(plan, fingers),
        good_share=float((fingers.ratio >= design.need).mean()),
        in_hand_db=in_hand_db,
        pads=pads,
        error_db=error_db,
        error_share=error_share,
    )


def _loose_db(plan: Plan, fingers: TouchedPrints) -> float | None:
    """Return the dB that the asked share of prints keeps while lying loose; None if the spec says how a pad is held.

    Every OFF taxel is taken to hear the recoil, and the weakest ON taxel of a pad to be compared with it.
    """
    if plan.spec.mount.is_said:
        return None
    shaken = recoil_energy(touched_plan(plan)) / fingers.weakest
    return TouchedPrints(1 / (1 / fingers.ratio + shaken), fingers.weakest).kept_db(plan.spec.print_share)


def played_channels(plan: Plan) -> tuple[Channel, ...]:
    """Return the channels with the frequencies, levels and forces of the drive, made for the plan's contact if any.

    Their resonances are the tones, and their levels and forces have in hand what the weakest touched taxel loses.
    """
    touch = plan.touch
    if touch is None:
        return plan.channels
    return driven(plan.spec, _played(plan.spec, plan.channels, touch.tones, touch.in_hand_db), plan.scheme)


def played_plan(plan: Plan) -> Plan:
    """Return the plan with its `played_channels` as channels and without its contact, for tables of a drive."""
    return plan if plan.touch is None else replace(plan, channels=played_channels(plan), touch=None)


def _played(spec: Spec, planned: Sequence[Channel], tones: str, in_hand_db: float) -> tuple[Channel, ...]:
    """Return channels with their resonances replaced by the tones' frequencies, and with forces raised by `in_hand_db`.

    Their levels are those under typical skin, or where these are larger those of bare taxels under the same tones.
    """
    louder = 10 ** (in_hand_db / 20)
    result = []
    for bare, touched in zip(planned, touched_channels(spec, planned), strict=True):
        played = touched if tones == TONES[0] else bare
        force_mn = played.force_mn * louder
        level_um = max(_moved_um(taxel, played.resonance_hz, force_mn) for taxel in (bare, touched))
        result.append(
            replace(
                played,
                level_um=level_um,
                force_mn=force_mn,
                line_a2=wanted_line_a2(force_mn, played.force_constant_n_per_a2),
                root_stress_mpa=played.root_stress_mpa * level_um / played.level_um,
            )
        )
    return tuple(result)


def _moved_um(channel: Channel, tone_hz: float, force_mn: float) -> float:
    """Return the amplitude in µm of a taxel under a force in mN at a tone."""
    static_um = force_mn * MN / channel.stiffness_n_per_m / UM
    return float(static_um * channel.q * np.sqrt(relative_energy(tone_hz, channel.resonance_hz, channel.q)))


def judge_touched_prints(plan: Plan) -> Iterator[Finding]:
    """Yield a warning if too few touched prints reach the asked dB, else a note if they must be re-tuned for that."""
    touch = plan.touch
    if touch is None or touch.print_db is None:
        return
    wanted = plan.spec.print_share
    asked_db = plan.selectivity.asked_db
    if touch.good_share < wanted:
        yield Finding(
            "warning",
            "touch.share",
            "pad",
            f"touched, with every taxel re-tuned, {touch.good_share:.0%} of {plan.spec.touch.prints_text} keep the"
            f" {asked_db:.1f} dB of ON over OFF that are asked for; {wanted:.0%} keep {touch.print_db:.1f} dB;"
            " padgen plan --explain ranks what would help",
            tuple(_touch_cures(plan, touch.print_db)),
        )
    elif touch.planned_db is not None and touch.planned_db < asked_db:
        yield Finding(
            "note",
            "touch.spread",
            "pad",
            f"expect to measure and re-tune every taxel: driven as planned, {wanted:.0%} of"
            f" {plan.spec.touch.prints_text} keep {touch.planned_db:.1f} dB",
        )


def touched_figures(plan: Plan, design: Design) -> tuple[Touched, ...]:
    """Return resonances, Q and selectivity under low, typical and high skin, driven by the tones of the plan."""
    touch = plan.touch
    if touch is None:
        return plan.touched
    return tuple(
        replace(
            touched,
            all_states_db=touched_pads(plan, 1, touch.tones, True, design, touched.skin).kept_db(0.5),
        )
        for touched in plan.touched
    )


def touched_felt(plan: Plan) -> Felt:
    """Return how far touched taxels of a plan, as they are driven, vibrate above the threshold of feeling."""
    touch = plan.touch
    if touch is None:
        return plan.felt
    touched = touched_channels(plan.spec, plan.channels)
    levelled = tuple(
        replace(channel, level_um=level_um) for channel, level_um in zip(touched, touch.level_um, strict=True)
    )
    return felt_levels(plan.spec, levelled, plan.scheme)


NEARER = 0.8
"""Share of a pin's place that may keep what is asked."""


def _touch_cures(plan: Plan, kept_db: float) -> Iterator[dict[str, Any]]:
    """Yield spec changes by which touched prints may pass: pins nearer the roots, fewer taxels, a lower `delta_y`."""
    spec = plan.spec
    share = spec.pin_share
    if share is not None:
        yield {"contactor.place": round(share * NEARER, 3)}
    if spec.resonances_hz and len(spec.resonances_hz) > 2 * spec.coil.sets:
        outer = (*spec.resonances_hz[: spec.coil.sets], *spec.resonances_hz[-spec.coil.sets :])
        yield {"resonances_hz": list(outer), "resolution": plan.coils.rows * plan.coils.columns * 2}
    if kept_db > ROUNDED_DB:
        yield {"delta_y": float(at_most(10 ** ((kept_db - ROUNDED_DB) / 20)))}


ROUNDED_DB = 0.2
"""Distance below what is kept of what is asked instead: few prints may keep a little less."""
