"""Define `Plan`: the pad that will be made, as frozen plain data with a JSON round trip; all later stages read it.

Reading refuses missing entries, entries of another kind, and sizes that no pad has. The last part translates a spec's
`[drive]` table for the physics: its level law and its drive schemes.
"""

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from math import isfinite, log10
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin

import numpy as np

from padgen.core.errors import FileError, Finding, OlderPlanError, SpecError, Verdict, at_least
from padgen.core.files import json_text, read_bounded
from padgen.core.registry import SCHEMES
from padgen.core.rules import Rule, broken_rules
from padgen.core.units import MA, decibel
from padgen.physics.selectivity import Scheme, all_states, channels
from padgen.planner.suspensions import Arrangement, BeamShape, PlateShape, names, suspension
from padgen.planner.thresholds import level_law
from padgen.spec import Spec, TouchTable, make_spec
from padgen.spec.load import LARGEST_PLAN, without_none

__all__ = [
    "CARRIER_OVER_RESONANCE",
    "NOT_COUNTED",
    "NOT_JUDGED",
    "NO_LIFE",
    "NO_RECOIL",
    "TURNS",
    "Beam",
    "Capacity",
    "Cell",
    "Channel",
    "CoilGrid",
    "CoilLoad",
    "Felt",
    "FrameRate",
    "LayoutOption",
    "LeftOut",
    "Pin",
    "Pitch",
    "Plan",
    "Plate",
    "Prints",
    "Push",
    "Pushed",
    "Recoil",
    "Reuse",
    "SchemeFigures",
    "Selectivity",
    "Site",
    "Taxel",
    "Touch",
    "Touched",
    "can_play",
    "carrier_hz",
    "channel_sets",
    "level_law",
    "non_finite_figures",
    "plan_from_json",
    "plan_from_table",
    "plan_to_json",
    "read_as",
    "read_plan",
    "scheme_for",
    "scheme_named",
    "worst_set_db",
]


TURNS = {"+x": (1, 0), "+y": (0, 1), "-x": (-1, 0), "-y": (0, -1)}
"""Direction of a taxel's own x axis as (cosine, sine): exact quarter turns."""


@dataclass(frozen=True, slots=True)
class Capacity:
    """Most channels that one coil holds: `paper` by the paper's Eq. 12, `exact` by the response in all on/off states.

    All are for the plan's drive, equal masses, and resonances on a geometric ladder. `paper_unrounded` is Eq. 12 before
    rounding down, `exact_one_hot` counts one channel on at a time, `ratio` is Eq. 12's ratio of neighbouring
    resonances. `limit` names what prevents more channels on the pad, `breaks` the line of the drive that makes `exact`
    + 1 channels too many. An `exact` equal to `searched_to` means that many or more. With `prints` channels,
    `print_share` of the re-tuned pads keep the asked selectivity when the ratio of neighbours varies from print to
    print by `Prints.ratio_spread`; leakage and other modes are not counted in it.
    """

    paper: int
    exact: int
    ratio: float
    limit: str
    paper_unrounded: float
    exact_one_hot: int
    breaks: str
    searched_to: int
    prints: int = 1


@dataclass(frozen=True, slots=True)
class CoilGrid:
    """The grid of coils; columns follow each other along x, rows along y. `pitch_mm` is the smaller pitch.

    With two `sets` of channels a coil has every second channel: the even ones where row + column is even, the odd ones
    elsewhere.
    """

    rows: int
    columns: int
    pitch_mm: float
    pitch_x_mm: float
    pitch_y_mm: float
    sets: int


@dataclass(frozen=True, slots=True)
class Cell:
    """Division of the cell over one coil: sub-cells along x (`columns`) and y (`rows`), their size, the beams' axis."""

    columns: int
    rows: int
    width_mm: float
    depth_mm: float
    beam_axis: str


@dataclass(frozen=True, slots=True)
class Plate:
    """The moving part, the same on all channels: a plate with the washer's recess below and a boss above.

    `boss_top_mm` is measured from the bed; `post_diameter_mm` is 0 where the recess has no centre post; `gap_mm` is the
    gap between moving parts and frame.
    """

    length_mm: float
    width_mm: float
    thickness_mm: float
    recess_diameter_mm: float
    recess_depth_mm: float
    post_diameter_mm: float
    boss_diameter_mm: float
    boss_top_mm: float
    boss_edge_mm: float
    gap_mm: float


@dataclass(frozen=True, slots=True)
class Beam:
    """The beams of one channel: `count` alike in parallel, with a fillet radius of `fillet_mm` at the roots."""

    width_mm: float
    thickness_mm: float
    length_mm: float
    topology: str
    fillet_mm: float
    count: int
    layers: int


@dataclass(frozen=True, slots=True)
class Pin:
    """The part of a channel's taxels that meets the skin: a boss or a pin on the plate, or a pin on the first beam.

    Its axis is at (`x_mm`, `y_mm`) in the taxel's own axes, its top `top_mm` over the bed. While the mover moves up and
    down by 1, its top moves up and down by `lever`, and sideways by `sway`, because plate and beam tilt; both in the
    working mode, within the relative `lever_error`. Against a push down on its top it has `stiffness_n_per_m`, within
    the relative `stiffness_error`; its top then moves sideways by `lean` times as much as down. The mover rests on the
    coil once the pin is `closed_mm` down. The push ends at `stop_mm`, where the `stop` is: the pin or its beam meets
    the 'coil', or the finger rests on the 'guard'; None where nothing ends it. A push of 1 N, or less where it ends
    before, stresses the beams by `pushed_stress_mpa`, the whole way down by `stop_stress_mpa`; 1 N sideways on its top
    stresses the pin's foot by `foot_stress_mpa`. All without notches.
    """

    on_beam: bool
    shape: str
    diameter_mm: float
    top_mm: float
    fillet_mm: float
    x_mm: float
    y_mm: float
    lever: float
    sway: float
    lever_error: float
    stiffness_n_per_m: float
    stiffness_error: float
    lean: float
    closed_mm: float
    stop: str | None
    stop_mm: float | None
    stop_stress_mpa: float | None
    pushed_stress_mpa: float
    foot_stress_mpa: float

    @property
    def load_lever(self) -> float:
        """Motion of the top as skin loads it, divided by the mover's: vertical and (weighted) sideways combined."""
        return float((self.lever**2 + SIDEWAYS * self.sway**2) ** 0.5)


SIDEWAYS = 2 / 3
"""Stiffness of skin against a flat disc that moves sideways over that against one that moves up and down.

Of an elastic half-space that keeps its volume, 16/3 G a over 8 G a (Mindlin 1949; Johnson, Contact Mechanics, 1985).
"""


@dataclass(frozen=True, slots=True)
class Site:
    """Place of a channel's taxel in its cell, measured from the coil axis.

    The taxel's own axes (beam along +x from the root, see `planner.suspensions`) have their origin at `origin_mm`;
    `along` is the direction ('+x', '-x', '+y', '-y') of their x axis. The sub-cell's centre is `centre_mm`. The
    washer's axis is `washer_mm`, at a distance of `coil_distance_mm` from the coil's. `frame_depth_mm` is the distance
    of the deepest root from the side of its sub-cell. In a turned cell (`Reuse.turned`) all places are turned by 180°.
    """

    centre_mm: tuple[float, float]
    origin_mm: tuple[float, float]
    washer_mm: tuple[float, float]
    along: str
    coil_distance_mm: float
    frame_depth_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class Channel:
    """One frequency slot of a coil; channels are numbered from the lowest resonance.

    Drive: `drive_hz` is the frequency of the channel's line of the current: half the resonance with tones, the
    resonance itself where the current has a constant part. `ring_up_ms` is the time constant, `ring_down_ms` the time
    from ON to quiet.

    Mean pull: `static_um` is its deflection with all channels on, the whole gap where the spring does not balance it.
    The pull goes with the gap as ``gap^-pull_exponent``, which softens the spring and lowers the resonance by the share
    `pull_shift`. Of magnets both are by the core's pull at rest; resonance and stiffness are then those over the core.

    Modes (k,): `mode_shares` are what each adds to the static compliance under a vertical pull at the washer's axis,
    over that of the working mode; `pulled_shares` are the same under the real pull. That pull is `pull_wrench` (6,):
    force and moment (N, N m) per vertical newton, in the taxel's own axes, about the washer's axis at z = 0.
    `mode_motions` (k, 6) are the mass-normalised motions there, `rest_motion` (6,) that of unsolved modes per newton.

    Force: `force_constant_n_per_a2` is the pull on the working mode where the washer hangs, its pulled share included;
    its relative error is at most `force_error`. `line_a2`, the force over it, is the amplitude of the wanted line of
    i², 0 for a washer that the coil does not pull. Steel that has kept some magnetisation adds a pull that goes with
    the current, so that it is as i² + i · `remanent_ma`.

    Stretching: beams that stretch harden, so that the working mode's force is ``k z (1 + hardening_per_mm2 z²)``. At
    its level, about its sag, the taxel resonates higher by the share `level_shift`, and the tone at `resonance_hz`
    moves it `level_loss_db` less.

    Model: `model` ('beam' or 'solid') gave resonance and modes; its own estimate of their relative error is
    `model_error`. `mode_errors` (k,) are the same for `modes_hz`, `sag_error` for `sag_um`, `static_error` for
    `static_um` (pull and stiffness) and `stress_error` for `root_stress_mpa`, all relative. `beam_error`
    is how far the beam model's resonance is off the solid's, None where no solid was solved.
    """

    index: int
    resonance_hz: float
    drive_hz: float
    q: float
    beam: Beam
    effective_mass_g: float
    stiffness_n_per_m: float
    ring_up_ms: float
    ring_down_ms: float
    level_um: float
    target_hz: float
    rule_hz: float
    second_mode_hz: float
    second_mode_share: float
    modes_hz: tuple[float, ...]
    mode_shares: tuple[float, ...]
    pulled_shares: tuple[float, ...]
    mode_motions: tuple[tuple[float, ...], ...]
    rest_motion: tuple[float, ...]
    pull_wrench: tuple[float, ...]
    sag_um: float
    hardening_per_mm2: float
    level_shift: float
    level_loss_db: float
    root_stress_mpa: float
    print_spread: float
    force_mn: float
    force_constant_n_per_a2: float
    force_error: float
    line_a2: float
    pull_exponent: float
    remanent_ma: float
    static_um: float
    pull_shift: float
    model: str
    model_error: float
    mode_errors: tuple[float, ...]
    sag_error: float
    static_error: float
    stress_error: float
    beam_error: float | None
    site: Site
    pin: Pin


@dataclass(frozen=True, slots=True)
class Taxel:
    """One tactile element: a channel, and the place of its boss and washer from the pad's centre.

    `turned` is true where its whole cell is turned by 180° about the coil's axis.
    """

    id: str
    coil: tuple[int, int]
    channel: int
    x_mm: float
    y_mm: float
    coil_distance_mm: float
    turned: bool


@dataclass(frozen=True, slots=True)
class SchemeFigures:
    """Selectivity that a drive scheme would reach with the same channels; None where it was not computed."""

    scheme: str
    one_hot_db: float | None
    all_states_db: float | None
    placed_all_states_db: float | None

    @property
    def reached_db(self) -> float:
        """Worst-state selectivity in dB: the lower of those for equal and for actual pulls; -inf if one is missing."""
        if self.all_states_db is None or self.placed_all_states_db is None:
            return float("-inf")
        return min(self.all_states_db, self.placed_all_states_db)


@dataclass(frozen=True, slots=True)
class Selectivity:
    """Distance in dB of OFF taxels below ON taxels with the planned drive; None where a coil has one channel.

    With two sets of channels, the figures are of the worse one.

    `one_hot_db` and `all_states_db` take all washers as pulled alike and each taxel as one resonator, as the paper's
    bound does. The `placed` figures count that a washer nearer to the coil feels every tone more, and all modes, as the
    pull's wrench excites them. The smaller of the two holds. The modes cost `modes_cost_db` in all states; those left
    out, far from every line, change an amplitude by at most the share `modes_left_out`. `asked_db` is Δy in dB,
    `paper_db` is Eq. 12's figure for the closest pair, `snapping_db` the loss in all states because beams print in
    steps. `optimum_db` is what the optimised resonances reach with equal masses. `level_law` is an exponent,
    'threshold' (by the spec's own curve) or 'sensation'. `matrix_db` has a table for each set of channels: how far
    below its own ON amplitude taxel i (row) is at the tone of channel j; it is empty for many channels.
    """

    drive: str
    level_law: float | str
    one_hot_db: float | None
    all_states_db: float | None
    worst_state: str
    asked_db: float
    placed_one_hot_db: float | None
    placed_all_states_db: float | None
    why: str
    paper_db: float | None
    snapping_db: float | None
    modes_cost_db: float | None
    modes_left_out: float
    optimum_db: float | None
    matrix_db: tuple[tuple[tuple[float, ...], ...], ...]
    schemes: tuple[SchemeFigures, ...]

    @property
    def kept_db(self) -> float | None:
        """Worst-state selectivity in dB: the lower of those for equal and for actual pulls; None for one channel."""
        if self.all_states_db is None or self.placed_all_states_db is None:
            return None
        return min(self.all_states_db, self.placed_all_states_db)

    @property
    def placed_own_modes_db(self) -> float | None:
        """Worst-state selectivity in dB with actual pulls on washers, working modes only; None for one channel."""
        db = self.placed_all_states_db
        return None if db is None else db + (self.modes_cost_db or 0.0)


@dataclass(frozen=True, slots=True)
class CoilLoad:
    """Current, voltage, heat and mean pull of a coil with all channels on, and the largest level that its limits allow.

    Where coils have two sets of channels by turns, each figure is of the coil that takes most. `mean_copper_loss_w` is
    the heat of the coils' mean: times their number it is the pad's. `pull_in_share` is the mean pull over the pull at
    which the softest washer snaps to the coil. `reachable_level_um` is the largest `drive.level_um` that all limits of
    a coil allow, `reachable_by` the limit that it then meets. `idle_w` is the power that the scheme's constant current
    takes with all taxels OFF.
    """

    current_peak_ma: float
    current_rms_ma: float
    voltage_peak_v: float
    copper_loss_w: float
    idle_w: float
    pull_in_share: float
    reachable_level_um: float
    reachable_by: str
    mean_copper_loss_w: float


@dataclass(frozen=True, slots=True)
class FrameRate:
    """Frames per second at which a taxel that is switched OFF is quiet before the next frame, with one drive scheme.

    The other figures are of the contrast of a frame, the smallest ON over the largest OFF amplitude of a coil in dB, in
    the worst case: one taxel was silent before, another had its full level, all others are ON. At `frames_per_s` it is
    `end_db` at the frame's end (None where channels take turns) and `slot_db` over the whole frame, as the root mean
    square of each (`padgen.physics.switching`). `kept_frames_per_s` is the rate up to which a frame keeps `kept_db`
    over its whole time, which is what is asked, and no more than `SLOT_DB`; `braked_frames_per_s` is that rate with a
    brake, at which the contrast is `braked_db`. All are None where they were not computed, rates also where no frame
    is long enough, and with a brake where channels take turns.
    """

    scheme: str
    frames_per_s: float
    end_db: float | None = None
    slot_db: float | None = None
    kept_db: float | None = None
    kept_frames_per_s: float | None = None
    braked_frames_per_s: float | None = None
    braked_db: float | None = None


@dataclass(frozen=True, slots=True)
class Reuse:
    """Leakage between coils that share channels: motion of an OFF taxel by the coils around, in their worst state.

    `turned` names the cells that are turned by 180° so that taxels of one channel are not back to back: 'none', 'odd
    rows' or 'odd columns'. `leaks_db` (n,) is how far each channel's motion stays below its own level when all coils
    play in step; `leak_db` is the worst of them, of channel `leak_channel`. `retuned_leaks_db` (n,) is of a re-tuned
    print: each coil plays its own taxels' measured frequencies, so that lines add as energies. `leak_error` is the
    relative error of a leakage.
    """

    leak_db: float | None
    leak_channel: int | None
    turned: str
    leaks_db: tuple[float | None, ...] = ()
    retuned_leaks_db: tuple[float | None, ...] = ()
    leak_error: float = 0.0

    @property
    def is_known(self) -> bool:
        """True where the leakage is known: its relative error is at most 1."""
        return self.leak_error <= 1

    @property
    def most_leak_db(self) -> float | None:
        """Level of the worst leakage, with its error added, in dB below the ON level; None without leakage."""
        return None if self.leak_db is None else self.leak_db - decibel(1 + self.leak_error)


@dataclass(frozen=True, slots=True)
class Pitch:
    """Spacing of the taxels: smallest and largest distance of neighbouring columns (`x_mm`) and rows (`y_mm`).

    A distance is empty where there is one column or row. `ratio` is the largest over the smallest distance of the worse
    axis. `taken` is the share of the crossings of rows and columns that have a taxel: 1 in a full grid, 0.5 on a
    checkerboard.
    """

    x_mm: tuple[float, ...]
    y_mm: tuple[float, ...]
    ratio: float
    taken: float


@dataclass(frozen=True, slots=True)
class Prints:
    """Selectivity of untouched printed pads: ON over OFF in the worst state, leakage and other modes counted.

    The dB are what the spec's `print_share` of the pads reach: `print_db` with every taxel re-tuned, `planned_db` with
    the driver table as it is, `coupon_db` after a measured coupon has shown the error common to the print, `some_db`
    after some measured taxels have also shown the smooth field over the bed. They are None where nothing moves OFF
    taxels. Once re-tuned, `good_share` of the pads and `good_taxel_share` of the taxels reach the asked selectivity.
    The figures are estimated from `pads` simulated pads, with 95 % confidence within `error_db` and `error_share`.
    `ratio_spread` is the relative sigma of the ratio of a coil's neighbouring resonances, of the worst pair; for a
    single channel it is of two such taxels. `coil_shares` are the shares of re-tuned prints in which each coil is good,
    row by row.
    """

    print_db: float | None
    planned_db: float | None
    coupon_db: float | None
    some_db: float | None
    good_share: float
    good_taxel_share: float
    pads: int
    error_db: float | None
    error_share: float
    ratio_spread: float
    coil_shares: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Touched:
    """The pad under a finger of `skin` of 'low', 'typical' or 'high' stiffness (`padgen.planner.touch`, provisional).

    `resonance_hz` and `q` (n,) are of each channel's touched taxels. `all_states_db` is the selectivity of a coil
    driven as planned, by the taxels' own modes alone; None where a coil has one channel or very many.
    """

    skin: str
    skin_stiffness_n_per_m: float
    resonance_hz: tuple[float, ...]
    q: tuple[float, ...]
    all_states_db: float | None


@dataclass(frozen=True, slots=True)
class Touch:
    """Figures of a pad planned for touch: a `contact`, such as a fingertip, rests on every taxel that is compared.

    Under its typical skin, channels (n,) resonate at `resonance_hz` with `q`, and are driven by tones at `tone_hz`:
    those resonances where `tones` is 'touched', those of the bare taxels where it is 'untouched'. The contactors are
    discs of `contactor_mm`, through which skin loads the movers by `lever` (n,), their `Pin.load_lever`.
    `all_states_db` is of one coil under typical skin, as drawn.

    Of printed pads under drawn skins, one person a pad: `print_db` is what the spec's `print_share` of them keep with
    every bare taxel measured and tones moved accordingly, `planned_db` what they keep with the driver table as it is,
    `other_db` the first with the other kind of `tones` (None where the spec says which), `loose_db` the first where the
    pad lies loose (None where the spec says how it is held). All are the smallest ON over
    the largest OFF amplitude of the worst coil in its worst state, each over its planned level, with leakage, other
    modes, and recoil on the spec's mount. `good_share` of pads keep what is asked; with 95 % confidence the figures of
    `pads` simulated pads are within `error_db` and `error_share`.

    `in_hand_db` is how far the levels of the drive lie above the plan's, so that the weakest ON taxel of `print_share`
    of the pads still has its own. With it, taxels move by `level_um` (n,) under typical skin and by `bare_um` (n,)
    where nothing touches them; `force_mn` and `current_ma` (n,) are the peaks of the force on the mover and of the
    channel's current.
    """

    contact: str
    tones: str
    contactor_mm: float
    lever: tuple[float, ...]
    resonance_hz: tuple[float, ...]
    q: tuple[float, ...]
    tone_hz: tuple[float, ...]
    level_um: tuple[float, ...]
    bare_um: tuple[float, ...]
    force_mn: tuple[float, ...]
    current_ma: tuple[float, ...]
    all_states_db: float | None
    print_db: float | None
    planned_db: float | None
    other_db: float | None
    loose_db: float | None
    good_share: float
    in_hand_db: float
    pads: int
    error_db: float | None
    error_share: float


@dataclass(frozen=True, slots=True)
class Felt:
    """Sensation levels of each channel's taxel (n,) at a fingertip, when driven at its planned level (docs/touch.md).

    `threshold_um` is the amplitude that is just felt at the resonance through the boss, with an error of `error_db`.
    Above it, `on_db` is the level of an ON taxel and `off_db` that of the OFF taxel in its coil's worst state (None
    where it hears nothing), its lines' energies over their thresholds added. A person tells from `least_levels` to
    `most_levels` levels apart up to the ON level, by the least and the most favourable published figures, and as many
    of the felt channels' frequencies as `least_frequencies` to `most_frequencies`.

    Taxels are untouched or, in a plan under a contact, touched and driven for it (`touched_felt`).
    """

    threshold_um: tuple[float, ...]
    error_db: tuple[float, ...]
    on_db: tuple[float, ...]
    off_db: tuple[float | None, ...]
    least_levels: tuple[int, ...]
    most_levels: tuple[int, ...]
    least_frequencies: int
    most_frequencies: int


@dataclass(frozen=True, slots=True)
class Push:
    """Deflection of each channel's OFF taxel (n,) under one static push, and the gap to its coil that is left.

    `push_mn` is a force on the boss; or it is None, and `skin` lies at the height of the frame: 'low', 'typical' or
    'high'. `deflection_mm` and `gap_left_mm` are at the washer's axis, as if no coil were below; `contact` is where the
    tilted washer's rim touches it.
    """

    skin: str
    push_mn: float | None
    deflection_mm: tuple[float, ...]
    gap_left_mm: tuple[float, ...]
    contact: tuple[bool, ...]


@dataclass(frozen=True, slots=True)
class Pushed:
    """Effects of static pushes on OFF taxels: `closing_force_mn` (n,) in mN brings a channel's washer onto its coil.

    With `rim_force_mn` (n,) its rim touches, since it tilts. `closed_stress_mpa` (n,) is the stress at the beams' roots
    where the gap is closed.
    """

    closing_force_mn: tuple[float, ...]
    rim_force_mn: tuple[float, ...]
    closed_stress_mpa: tuple[float, ...]
    pushes: tuple[Push, ...]


@dataclass(frozen=True, slots=True)
class LayoutOption:
    """Another layout that works; `kept_db` is its all-state selectivity, None where a coil has one channel."""

    rows: int
    columns: int
    channels: int
    taxels: int
    margin_mm: float
    kept_db: float | None


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A physical effect, and how the plan treats it.

    If the plan leaves out `term`, the quantity `of` changes by at most `bound`, in `unit` ('1': relative); None where
    no bound holds because the quantity itself breaks down. If `computed`, the plan counts the effect and `bound` is the
    error that remains. `status` is 'bounded'; 'included' where the plan counts all of the effect and other figures have
    the error of its model (`bound` None); or 'unbounded' where nothing in a plan bounds it.
    """

    term: str
    bound: float | None
    unit: str
    of: str
    computed: bool
    status: str = "bounded"


@dataclass(frozen=True, slots=True)
class Recoil:
    """Recoil of the pad, which its ON taxels shake: the masses that move, and the ON over OFF in dB that is left.

    `pad_g` is the mass of pad, washers, coils, and tray with screws or board, `moving_g` that of everything on the
    mount, its base included; None where that does not move. The dB are the smallest ON over the largest OFF amplitude
    in the worst of `images` images by chance: `clamped_db` on a pad that does not move; on the moving one `in_step_db`
    by the driver table, where taxels of a channel move in step, `apart_db` where each is driven at a frequency of its
    own near that of its channel, as re-tuned, so that energies add, and `signed_db` by the table with signs that keep
    the pad still (None in plans: a driver table has none). None where nothing is heard.

    On a steel plate of `base_g`, the pad keeps `based_db`: all but 2 dB of what it keeps clamped or, in plans, so much
    that the asked share of prints keeps what is asked. `base_g` is 0 where the pad does so as it is, and None where the
    heaviest plate that was tried is not enough.

    What moves on the mount reaches down to `lowest_mm` from the pad's underside, has its centre of mass at `centre_mm`
    and the `moments_g_mm2` (3, 3) about it. For unit acceleration of its washer upwards against the pad, a channel's
    working mode takes the forces `momenta_g` (n, 3) and, about the washer's axis at the pad's underside, the moments
    `momenta_g_mm` (n, 3), in the taxel's own axes.
    """

    pad_g: float
    moving_g: float | None
    images: int
    clamped_db: float | None
    in_step_db: float | None
    apart_db: float | None
    signed_db: float | None
    base_g: float | None
    based_db: float | None = None
    lowest_mm: float = 0.0
    centre_mm: tuple[float, ...] = ()
    moments_g_mm2: tuple[tuple[float, ...], ...] = ()
    momenta_g: tuple[tuple[float, ...], ...] = ()
    momenta_g_mm: tuple[tuple[float, ...], ...] = ()

    @property
    def lost_db(self) -> float:
        """Selectivity in dB lost by recoil in the worst on/off image, with balancing signs of motion; 0 if unknown."""
        return 0.0 if self.clamped_db is None or self.signed_db is None else self.clamped_db - self.signed_db

    def kept_db(self, db: float, moving_db: float | None) -> float:
        """Return what is left of a selectivity of `db` in dB when recoil adds energy to the OFF taxels.

        `moving_db` is the figure of the moving pad: `in_step_db`, `apart_db` or `signed_db`.
        """
        if moving_db is None:
            return db
        still = 0.0 if self.clamped_db is None else 10 ** (-self.clamped_db / 10)
        energy = 10 ** (-db / 10) + max(10 ** (-moving_db / 10) - still, 0.0)
        return -10 * log10(energy) if energy > 0 else db


@dataclass(frozen=True, slots=True)
class Warm:
    """Temperatures in °C of the pad with all taxels on for good at their planned level, in air at `room_c`.

    `heat_w` is the heat of all coils at 20 °C, as if each took what the one that takes most does, which with two sets
    of channels is more than `Plan.heat_w`; the rest counts the copper's rise of resistance. `coil_c`, `beam_c` and
    `gap_c` are of the warmest coil, the warmest beams and the air between them, `mean_coil_c` and `mean_beam_c` of
    all coils and all beams.
    Rises over the room have the relative error `error`. They reach two thirds of their end after `warm_up_min` on a
    table that takes up no heat, later on one that does.

    `resonance_shift` is the relative shift of the warmest taxels' resonances, `resonances_hz` (n,) are those
    of the channels, each at the mean temperature of its plates; both by the fall of the plastic's stiffness.
    `levels_um` (n,) are the levels that the currents of the cold pad's drive table leave at these resonances, with
    `lost_db` the loss; its voltages lose `lost_by_voltage_db`, since less current flows in warm copper.
    """

    room_c: float
    heat_w: float
    coil_c: float
    gap_c: float
    beam_c: float
    mean_beam_c: float
    error: float
    warm_up_min: float
    resonance_shift: float
    resonances_hz: tuple[float, ...]
    mean_coil_c: float
    levels_um: tuple[float, ...]
    lost_db: tuple[float, ...]
    lost_by_voltage_db: tuple[float, ...]

    @property
    def beam_rise_k(self) -> float:
        """Rise in K of the warmest beams over the room."""
        return self.beam_c - self.room_c


@dataclass(frozen=True, slots=True)
class Life:
    """Selectivity that prints keep after one re-tuning, as temperatures change and plastic ages (docs/yield.md).

    They are untouched or, where the spec names a contact, under drawn skins. Then they change as `[life]` in the spec
    says. Each print is judged `temperature_range_k` warmer and colder than at re-tuning, aged, with its own Q; the
    worse of the two counts. `print_db` is what the spec's `print_share` of them keep, None where nothing moves OFF
    taxels; `good_share` of them keep what is asked. With 95 % confidence the figures of `pads` simulated pads are
    within `error_db` and `error_share`. `shifts` are the changes of all resonances when it is warm and cold, relative.
    `retune_k` is the largest change of temperature up to which `print_share` of them keep what is asked: at most
    `temperature_range_k`, 0 where it is not kept without any.
    """

    temperature_range_k: float
    shifts: tuple[float, float]
    print_db: float | None
    good_share: float
    retune_k: float
    pads: int
    error_db: float | None
    error_share: float


NOT_COUNTED = Capacity(1, 1, 1.0, "", 1.0, 1, "", 1)
"""Placeholder in a plan whose capacity is not worked out yet."""
NO_LIFE = Life(0.0, (0.0, 0.0), None, 0.0, 0.0, 0, None, 1.0)
"""Placeholder in a plan whose prints are not simulated yet."""
NOT_WARM = Warm(23.0, 0.0, 23.0, 23.0, 23.0, 23.0, 0.0, 0.0, 0.0, (), 23.0, (), (), ())
"""The placeholder in a plan whose temperatures are not worked out yet."""
NO_RECOIL = Recoil(0.0, None, 0, None, None, None, None, None)
"""The recoil of a plan before it is worked out."""
NOT_JUDGED = Verdict("error", "not judged yet", "", "", "", None)
"""The placeholder in a plan that is not `judged` yet."""


@dataclass(frozen=True, slots=True)
class Parts:
    """Devices of the catalogues that can drive all channels: amplifiers, with how many are needed, and sound cards.

    A sound card has an output for each coil's amplifier. What would do on a carrier alone is not among them: a spec
    that names such a device is planned with a carrier.
    """

    amplifiers: dict[str, int]
    sound_cards: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class Plan:
    """The plan of a pad; all later stages work from it and from nothing else.

    Frozen plain data, the keys of ``plan.json``; `padgen.plan` makes one. Lengths are in mm, frequencies in Hz.
    """

    name: str
    verdict: Verdict
    spec: Spec
    capacity: Capacity
    coils: CoilGrid
    cell: Cell
    plate: Plate
    channels: tuple[Channel, ...]
    taxels: tuple[Taxel, ...]
    pitch: Pitch
    selectivity: Selectivity
    load: CoilLoad
    refresh: tuple[FrameRate, ...]
    reuse: Reuse
    prints: Prints
    touched: tuple[Touched, ...]
    layouts: tuple[LayoutOption, ...]
    printing: dict[str, str]
    left_out: tuple[LeftOut, ...]
    findings: tuple[Finding, ...]
    parts: Parts
    pushed: Pushed
    recoil: Recoil
    warm: Warm
    life: Life
    felt: Felt
    touch: Touch | None = None

    def __repr__(self) -> str:
        coils = self.coils
        channels = self.channels
        return (
            f"<Plan {self.name}: {len(self.taxels)} taxels over {coils.rows} x {coils.columns} coils, resonances"
            f" {channels[0].resonance_hz:.1f} ... {channels[-1].resonance_hz:.1f} Hz, {self.selectivity.drive} drive>"
        )

    def _repr_html_(self) -> str:
        from padgen.report.plans import plan_html

        return plan_html(self)

    def plot(self, picture: str = "overview") -> Any:
        """Draw a picture of the plan: each coil's share of good prints and the resonances, or another one by name.

        Parameters
        ----------
        picture : str
            'overview', or what `padgen draw` calls its pictures: 'section', 'responses', 'pad' ...

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        SpecError
            There is no picture of that name.
        """
        from padgen.report.charts import picture as drawn

        return drawn(self, picture)

    def report(self) -> Any:
        """Return the `padgen.report.page.Page` of the plan: ``.save("report.html")`` writes one file for a browser."""
        from padgen.report.page import Page

        return Page(self)

    @property
    def scheme(self) -> Scheme:
        """The planned drive scheme, with the spec's settings and the washers' remanence."""
        return scheme_named(self.spec, self.selectivity.drive, self.channels)

    @property
    def heat_w(self) -> float:
        """Heat in W of all coils with all taxels on at their planned levels, in copper at 20 °C."""
        return self.load.mean_copper_loss_w * self.coils.rows * self.coils.columns

    @property
    def retuned_prints(self) -> "Prints | Touch":
        """Figures of re-tuned prints: those under touch if the spec names a contact, else those untouched."""
        return self.prints if self.touch is None else self.touch

    @property
    def sets(self) -> tuple[tuple[Channel, ...], ...]:
        """The channels of one coil, for each set of channels (two where sets alternate from coil to coil)."""
        return channel_sets(self.channels, self.coils.sets)

    def arrangement(self, channel: Channel) -> Arrangement:
        """Return the geometry in mm of a channel's taxel in its own axes: beams, moving blocks, frame opening."""
        beam = channel.beam
        plate = self.plate
        shape = PlateShape(plate.length_mm, plate.width_mm, plate.thickness_mm)
        size = BeamShape(beam.width_mm, beam.thickness_mm, beam.length_mm)
        return suspension(beam.topology).arrange(shape, size, plate.gap_mm)


def channel_sets(channels: Sequence[Channel], sets: int) -> tuple[tuple[Channel, ...], ...]:
    """Split channels among the sets that alternate from coil to coil, dealing them out to the `sets` sets in turn."""
    return tuple(tuple(channels[k::sets]) for k in range(sets))


NO_FIGURES = (Spec, Taxel, Finding)
"""Parts of a plan whose numbers are bounded already, copied from its channels and cells, or words."""


def non_finite_figures(value: Any, where: str = "") -> Iterator[tuple[str, float]]:
    """Yield place and value of every figure of a plan, or of a part of it, that is not finite."""
    if isinstance(value, float):
        if not isfinite(value):
            yield where, value
    elif isinstance(value, tuple):
        for i, entry in enumerate(value):
            yield from non_finite_figures(entry, f"{where}[{i}]")
    elif is_dataclass(value) and not isinstance(value, NO_FIGURES):
        for item in fields(value):
            yield from non_finite_figures(getattr(value, item.name), f"{where}.{item.name}" if where else item.name)


def plan_to_json(plan: Plan) -> str:
    """Return the plan as JSON text: its fields in their order, the same bytes for the same plan."""
    table = {name: getattr(plan, name) for name in Plan.__dataclass_fields__}
    if plan.touch is None:
        del table["touch"]
    left_out = [name for name, absent in LEFT_OUT.items() if getattr(plan.spec, name) == absent]
    known = (name for name in Spec.__dataclass_fields__ if name not in left_out)
    return json_text(table | {"spec": {name: getattr(plan.spec, name) for name in known}})


LEFT_OUT: dict[str, Any] = {
    "amplifier": None,
    "sound_card": None,
    "ballast": None,
    "touch": TouchTable(),
}
"""Parts of a spec that are left out of ``plan.json`` where they are as here."""
DRAWN = (CoilGrid, Cell, Plate, Beam, Pin, Site, Taxel)
"""Parts with sizes that are drawn. Here every number must be finite; in other parts null stands for an infinite one."""
LARGEST_MM = 1e4
LARGEST_FLOAT = sys.float_info.max
SMALLEST_FLOAT = sys.float_info.min
MAY_BE_0 = ("post_diameter_mm", "boss_edge_mm", "fillet_mm")
KINDS: dict[Any, tuple[tuple[type, ...], str]] = {
    str: ((str,), "text"),
    bool: ((bool,), "true or false"),
    int: ((int,), "a whole number"),
    float: ((int, float), "a number"),
    type(None): ((type(None),), "null"),
}


def read_plan(path: Path) -> Plan:
    """Return the plan in a file; raises `FileError` if the file cannot be read or holds no plan."""
    try:
        text = read_bounded(path, LARGEST_PLAN, "a plan").decode()
    except UnicodeDecodeError as error:
        raise FileError("is not a plan (it is not text)", str(path)) from error
    return plan_from_json(text, str(path))


def plan_from_json(text: str, where: str = "plan.json") -> Plan:
    """Read a plan from its JSON text; `where` names the source in errors.

    Raises
    ------
    FileError
        The text is not the JSON of a plan; `OlderPlanError` where an older padgen wrote it.
    """
    try:
        table = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"is not a plan ({error}); padgen plan makes one", where) from error
    return plan_from_table(table, where)


def plan_from_table(table: Any, where: str) -> Plan:
    """Return the plan that a parsed JSON object holds; raises as `plan_from_json` does."""
    try:
        is_plan = isinstance(table, dict) and "spec" in table
        if is_plan and not ({"verdict", "recoil", "warm", "life"} <= {*table} and _has_warm_levels(table["warm"])):
            raise OlderPlanError("was written by an older padgen; padgen plan makes it anew from its spec", where)
        plan: Plan = read_as(Plan, table, "the plan")
        for broken in broken_rules(_part_rules(plan)):
            raise ValueError(f"{broken.where} {broken.message}")
    except (ValueError, RecursionError, SpecError) as error:
        its = "its spec: " if isinstance(error, SpecError) else ""
        raise FileError(f"is not a plan ({its}{error}); padgen plan makes one", where) from error
    return plan


def _has_warm_levels(warm: Any) -> bool:
    """Return whether the `warm` table of a plan file has the entry `lost_db`, which padgen 0.14.0 did not write."""
    return not isinstance(warm, dict) or "lost_db" in warm


def read_as(kind: Any, value: Any, where: str, drawn: bool = False) -> Any:
    """Return the JSON `value` of an entry as the type `kind`; raises `ValueError` if it is of another type."""
    origin = get_origin(kind)
    kinds = get_args(kind)
    is_table = is_dataclass(kind)
    if (is_table or origin is dict) and not isinstance(value, dict):
        raise ValueError(f"{where} must be a table")
    if kind is Any:  # the value of a field of the spec, as in a cure
        return value
    if kind is Spec:
        return make_spec(without_none(value))
    if is_table:
        entries = {}
        for item in fields(kind):
            place = item.name if kind is Plan else f"{where}.{item.name}"
            if item.name in value:
                entries[item.name] = read_as(item.type, value[item.name], place, kind in DRAWN)
            elif item.default is MISSING:
                raise ValueError(f"{place} is missing")
        return kind(**entries)
    if origin is dict:
        return {name: read_as(kinds[1], entry, f"{where}.{name}") for name, entry in value.items()}
    if origin is tuple:
        endless = kinds[-1] is Ellipsis
        if not isinstance(value, list) or (not endless and len(value) != len(kinds)):
            raise ValueError(f"{where} must be a list" + ("" if endless else f" of {len(kinds)}"))
        each = zip([kinds[0]] * len(value) if endless else kinds, value, strict=True)
        return tuple(read_as(k, entry, f"{where}[{i}]", drawn) for i, (k, entry) in enumerate(each))
    if origin is UnionType:
        fitting = (k for k in kinds if type(value) in KINDS.get(k, ((dict,), ""))[0])
        return read_as(next(fitting, kinds[0]), value, where, drawn)
    if value is None and kind is float and not drawn:
        return None  # JSON has no infinity: a figure without a finite value is written as null
    allowed, what = KINDS[kind]
    if type(value) not in allowed or (kind is float and not abs(value) <= LARGEST_FLOAT):
        raise ValueError(f"{where} must be {what}")
    return value if value is None else kind(value)


def _part_rules(plan: Plan) -> Iterator[Rule]:
    """Yield the rules by which a plan is checked: its parts agree with each other, and sizes are possible for a pad."""
    coils = plan.coils
    channels = plan.channels
    warm_hz = plan.warm.resonances_hz
    yield Rule(bool(channels and plan.taxels), "it", "has no channels or no taxels")
    yield Rule(
        coils.rows > 0 < coils.columns and 0 < coils.sets <= len(channels),
        "coils",
        "must be one or more, with no more sets than channels",
    )
    yield Rule(
        len(warm_hz) == len(channels) and all((hz or 0.0) > 0 for hz in warm_hz),
        "warm.resonances_hz",
        "must have one above 0 for each channel",
    )
    yield Rule(plan.warm.mean_coil_c is not None, "warm.mean_coil_c", "must be a number")
    drawn: dict[str, Any] = {"coils": coils, "cell": plan.cell, "plate": plan.plate}
    for index, channel in enumerate(channels):
        where = f"channels[{index}]"
        known = channel.beam.topology in names() and channel.site.along in TURNS
        yield Rule(channel.index == index, f"{where}.index", f"must be {index}")
        yield Rule(known, where, "has a topology or a direction that there is not")
        drawn |= {f"{where}.beam": channel.beam, f"{where}.site": channel.site}
    for index, taxel in enumerate(plan.taxels):
        row, column = taxel.coil
        drawn[f"taxels[{index}]"] = taxel
        known = 0 <= row < coils.rows and 0 <= column < coils.columns and 0 <= taxel.channel < len(channels)
        yield Rule(known, f"taxels[{index}]", "is of a coil or a channel that there is not")
    for where, part in drawn.items():
        for item in fields(part):
            # Places may be 0 or negative, most sizes not.
            least = 0.0 if item.name in MAY_BE_0 else SMALLEST_FLOAT
            if isinstance(part, (Site, Taxel)):
                least = -LARGEST_MM
            value = getattr(part, item.name)
            sizes = [v for v in (value if isinstance(value, tuple) else (value,)) if isinstance(v, (int, float))]
            yield Rule(
                all(least <= size <= LARGEST_MM for size in sizes),
                f"{where}.{item.name}",
                f"must be a size of a pad, at most {LARGEST_MM:g}",
            )


def scheme_named(spec: Spec, name: str, channels: Sequence[Channel] = ()) -> Scheme:
    """Return the drive scheme called `name` with the settings of `spec`, and the remanence of `channels` if given."""
    kept = 0.0
    for channel_set in channel_sets(channels, spec.coil.sets) if channels else ():
        strongest_a2 = max(c.line_a2 for c in channel_set)
        rho_a = max(c.remanent_ma for c in channel_set) * MA
        kept = max(kept, rho_a**2 / strongest_a2 if strongest_a2 > 0 else 0.0)
    return Scheme(name, spec.drive.bias_ratio, SCHEMES.version(name), kept)


CARRIER_OVER_RESONANCE = 5
"""The carrier over the highest resonance: at twice the carrier a pull of i² is then ten times above every taxel."""


def carrier_hz(spec: Spec, scheme: Scheme, highest_hz: float) -> float | None:
    """Return the carrier frequency in Hz with which AC-coupled devices play a spur-free scheme; None if not needed."""
    needed = spec.blocked_by is not None and scheme.is_root
    return float(at_least(CARRIER_OVER_RESONANCE * highest_hz)) if needed else None


def can_play(spec: Spec, scheme: Scheme) -> bool:
    """Return whether the spec's devices can play a scheme; those that are AC coupled pass no constant current."""
    return spec.blocked_by is None or not scheme.is_biased


def scheme_for(spec: Spec, resonance_hz: np.ndarray) -> Scheme:
    """Return the drive scheme to choose resonances for: the spec's or, for 'auto', the simplest expected to suffice.

    For 'auto' it is linear for magnets; else plain tones if these keep the asked selectivity, else spur-free.
    """
    if spec.drive.scheme != "auto":
        return scheme_named(spec, spec.drive.scheme)
    if spec.force_order == 1:
        return Scheme("linear")
    tones = Scheme("tones")
    keeps = worst_set_db(spec, resonance_hz, np.ones(len(resonance_hz)), tones) >= decibel(spec.delta_y)
    return tones if keeps else Scheme("spur-free")


def worst_set_db(spec: Spec, resonance_hz: np.ndarray, mass: np.ndarray, scheme: Scheme) -> float:
    """Return the lowest worst-state selectivity in dB of the channel sets, to which channels (n,) are dealt in turn."""
    level = level_law(spec)(resonance_hz)
    sets = spec.coil.sets
    dealt = (slice(k, None, sets) for k in range(sets))
    return min(all_states(channels(resonance_hz[k], spec.q_min, level[k], mass[k]), scheme).db for k in dealt)
