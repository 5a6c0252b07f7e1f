"""`Plan`: what will be made. Frozen plain data with a JSON round trip; the contract between stages."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from padgen.core.files import json_text
from padgen.core.finding import Finding
from padgen.core.registry import SCHEMES
from padgen.physics.selectivity import Scheme
from padgen.planner.suspensions import Arrangement, BeamShape, PlateShape, suspension
from padgen.spec import Spec

__all__ = [
    "Beam",
    "Capacity",
    "Cell",
    "Channel",
    "CoilGrid",
    "CoilLoad",
    "FrameRate",
    "LayoutOption",
    "LeftOut",
    "Pitch",
    "Plan",
    "Plate",
    "Prints",
    "Reuse",
    "SchemeFigures",
    "Selectivity",
    "Site",
    "Taxel",
    "Touched",
    "channel_sets",
    "plan_to_json",
]


@dataclass(frozen=True, slots=True)
class Capacity:
    """Channels of one coil: `paper` by Eq. 12, `exact` by the response in all states with the plan's drive.

    `paper_unrounded` is Eq. 12 before rounding down, `exact_one_hot` counts one channel on at a
    time, `ratio` the smallest ratio of neighbours, `limit` what keeps the pad from more, `breaks`
    the line that makes one channel more than `exact` too many. An `exact` of `searched_to` means that
    or more. All are of one coil with equal masses and channels evenly in octaves. `prints` are the channels per coil
    of which `print_share` of the pads keep what is asked, re-tuned, where the ratio of every two neighbours differs
    from print to print as `Prints.ratio_spread` says; leakage and other modes are not counted.
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
    """Coils in rows (along y) and columns (along x); `pitch_mm` is the smaller of the two.

    With two `sets` of channels a coil has every second one: of even numbers where row + column is
    even, of odd numbers elsewhere.
    """

    rows: int
    columns: int
    pitch_mm: float
    pitch_x_mm: float
    pitch_y_mm: float
    sets: int


@dataclass(frozen=True, slots=True)
class Cell:
    """How the cell over one coil is divided: sub-cells along x and y, their size, the beams' axis."""

    columns: int
    rows: int
    width_mm: float
    depth_mm: float
    beam_axis: str


@dataclass(frozen=True, slots=True)
class Plate:
    """The moving part, alike on all channels: plate, recess below it, boss above it.

    `boss_top_mm` is above the bed, `post_diameter_mm` 0 where the recess has no centre post;
    `gap_mm` is kept between all that moves and the frame.
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
    """The beams of one channel; `fillet_mm` at the roots, `count` in parallel."""

    width_mm: float
    thickness_mm: float
    length_mm: float
    topology: str
    fillet_mm: float
    count: int
    layers: int


@dataclass(frozen=True, slots=True)
class Site:
    """Where a channel's taxel lies in its cell, seen from the coil axis.

    The taxel's own axes (beam along +x from the root, see `planner.suspensions`) have their origin
    at `origin_mm`; `along` is the direction ('+x', '-x', '+y', '-y') of the own x axis. The
    sub-cell's centre is `centre_mm`, the washer's axis `washer_mm`, `coil_distance_mm` away from the
    coil's. `frame_depth_mm` is how far the deepest root lies from the side of its sub-cell. In a cell
    that is turned (`Reuse.turned`) all of it is turned by 180°.
    """

    centre_mm: tuple[float, float]
    origin_mm: tuple[float, float]
    washer_mm: tuple[float, float]
    along: str
    coil_distance_mm: float
    frame_depth_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class Channel:
    """One frequency slot of a coil, lowest first.

    `drive_hz` is the frequency of the channel's line of the current: half the resonance with tones,
    the resonance itself where the current has a constant part. `ring_up_ms` is the time constant,
    `ring_down_ms` the time from ON to quiet. `static_um` is the mean pull's deflection with all
    channels on, where it balances (the whole gap where it does not); the pull falls with the gap as
    ``gap^-pull_exponent``, which softens the spring and lowers the resonance by `pull_shift`.
    `mode_shares` are what the modes (k,) add to the static compliance, over the working one, under a vertical pull
    at the washer's axis, `pulled_shares` by the `pull_wrench` (6,) that there is: N and N m per vertical newton, own
    axes, about that axis at z = 0. `force_constant_n_per_a2` is the pull on the working mode where the washer hangs,
    with its pulled share, and may be off by `force_error`, relative; `line_a2`, the force over it, is the amplitude of
    the wanted line of i², 0 for a washer that the coil does not pull.
    `mode_motions` (k, 6) are the washer's there, mass-normalised, `rest_motion` (6,) that of unsolved modes per newton.
    Beams that stretch harden: the working mode's force is ``k z (1 + hardening_per_mm2 z²)``. At its level, about its
    sag, it resonates higher by the share `level_shift`, and the tone at `resonance_hz` moves it `level_loss_db` less.
    `model` ('beam' or 'solid') gave the resonance and the modes, which may be off by `model_error` by
    its own estimate; `beam_error` is how far the beam model's resonance is off the solid's, None where
    no solid was solved.
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
    static_um: float
    pull_shift: float
    model: str
    model_error: float
    beam_error: float | None
    site: Site


@dataclass(frozen=True, slots=True)
class Taxel:
    """One tactile element: a place on the pad (of boss and washer, from its centre) and a channel.

    `turned` tells that its whole cell is turned by 180° about the coil's axis.
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
    """What a drive scheme would reach with the same channels; None where it was not computed."""

    scheme: str
    one_hot_db: float | None
    all_states_db: float | None
    placed_all_states_db: float | None

    @property
    def reached_db(self) -> float:
        """What is kept in all states, unequal pull and all modes counted; -inf where it was not computed."""
        if self.all_states_db is None or self.placed_all_states_db is None:
            return float("-inf")
        return min(self.all_states_db, self.placed_all_states_db)


@dataclass(frozen=True, slots=True)
class Selectivity:
    """How far OFF taxels stay below ON taxels with the planned drive; None where one channel has no other.

    With two sets of channels, of the worse one.

    The first figures take all washers as pulled alike and each taxel as one resonator, as the paper's bound
    does; the `placed` ones count that a nearer washer feels every tone more, and all modes, by the pull's
    wrench: what holds is the smaller. `modes_cost_db` is what these cost in all states, `modes_left_out` bounds
    the relative error of an amplitude by those far from every line. `asked_db` is Δy in dB, `paper_db` what Eq.
    12 promises for the closest pair, `snapping_db` what it costs in all states that beams print in steps. For
    equal masses `optimum_db` is what the optimised resonances reach. `level_law` is an exponent or 'threshold'.
    `matrix_db` has, for each set of channels, how far below its own ON amplitude taxel i (row) is at the tone
    of channel j; empty for many.
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
        """What the planned drive keeps in all states, unequal pull and all modes counted; None for one channel."""
        if self.all_states_db is None or self.placed_all_states_db is None:
            return None
        return min(self.all_states_db, self.placed_all_states_db)

    @property
    def placed_own_modes_db(self) -> float | None:
        """The placed figure in all states with each taxel's own mode alone; None for one channel."""
        db = self.placed_all_states_db
        return None if db is None else db + (self.modes_cost_db or 0.0)


@dataclass(frozen=True, slots=True)
class CoilLoad:
    """What the drive asks of one coil and its amplifier with all channels on.

    `pull_in_share` is the mean pull over the one at which the softest washer snaps to the coil.
    `reachable_level_um` is the largest `drive.level_um` that every limit allows, `reachable_by` the
    limit that it meets. `idle_w` is what the constant current of a scheme takes with all taxels OFF.
    """

    current_peak_ma: float
    current_rms_ma: float
    voltage_peak_v: float
    copper_loss_w: float
    idle_w: float
    pull_in_share: float
    reachable_level_um: float
    reachable_by: str


@dataclass(frozen=True, slots=True)
class FrameRate:
    """Frames a second at which an OFF taxel has become quiet, switching included, before the next frame."""

    scheme: str
    frames_per_s: float


@dataclass(frozen=True, slots=True)
class Reuse:
    """What the neighbouring coils, in their worst state, do to a taxel that is OFF.

    `turned` names the cells that are turned by 180° so that taxels of one channel are not back to back:
    'none', 'odd rows' or 'odd columns'. `leaks_db` has how far below its own level each channel (n,) stays,
    `leak_db` the worst of them, all coils in step. `retuned_leaks_db` is of a print whose coils each play their own
    taxels' measured frequencies, so that lines add as energies; `leak_error` is what a leakage may be off by, relative.
    """

    leak_db: float | None
    leak_channel: int | None
    turned: str
    leaks_db: tuple[float | None, ...] = ()
    retuned_leaks_db: tuple[float | None, ...] = ()
    leak_error: float = 0.0


@dataclass(frozen=True, slots=True)
class Pitch:
    """Smallest and largest distance of neighbouring columns (along x) and rows, empty where there is one alone.

    `ratio` is the largest over the smallest distance, of the worse axis; `taken` the share of the crossings of rows and
    columns that hold a taxel: 1 in a full grid, 0.5 on a checkerboard.
    """

    x_mm: tuple[float, ...]
    y_mm: tuple[float, ...]
    ratio: float
    taken: float


@dataclass(frozen=True, slots=True)
class Prints:
    """Selectivity that printed pads keep, untouched: the worst state's ON over OFF, leakage and other modes counted.

    `print_db` is what the share of pads that the spec asks for (`print_share`) reaches once each taxel is re-tuned;
    `planned_db` with the driver table as it is, `coupon_db` once a coupon has told what is common to the print,
    `some_db` once some taxels have told the smooth field over the bed as well. `good_share` of the pads and
    `good_taxel_share` of the taxels reach what is asked, re-tuned. The dB are None where no taxel hears another.
    Estimated from `pads` simulated ones: with 95 % confidence within `error_db` and `error_share`.
    `ratio_spread` is the sigma of the ratio of a coil's neighbouring resonances, relative, of the worst pair; that of
    one channel is of two such taxels. `coil_shares` are of each coil, row by row: its good prints, re-tuned.
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
    """The pad under a finger whose `skin` is 'low', 'typical' or 'high' (`padgen.physics.skin`, provisional).

    Resonance and Q of each channel's taxels, and what a coil driven as planned keeps in all states, own modes alone;
    None where a coil has one channel or very many.
    """

    skin: str
    skin_stiffness_n_per_m: float
    resonance_hz: tuple[float, ...]
    q: tuple[float, ...]
    all_states_db: float | None


@dataclass(frozen=True, slots=True)
class LayoutOption:
    """A layout that would do as well; `kept_db` is what it keeps in all states, None for one channel."""

    rows: int
    columns: int
    channels: int
    taxels: int
    margin_mm: float
    kept_db: float | None


@dataclass(frozen=True, slots=True)
class LeftOut:
    """An effect that the physics knows, and what the plan does about it.

    Leaving out `term` changes the quantity `of` by at most `bound`, in `unit` ('1': relative); None where no bound
    holds, since the quantity itself breaks down. Where `computed`, the plan counts it and `bound` is what
    remains. `status` is 'bounded'; 'included' where a plan counts it whole, and what its model may be off by is in
    other figures (`bound` None); or 'unbounded' where nothing that a plan knows bounds it.
    """

    term: str
    bound: float | None
    unit: str
    of: str
    computed: bool
    status: str = "bounded"


@dataclass(frozen=True, repr=False)
class Plan:
    """The whole plan; every later stage reads this and nothing else.

    Frozen plain data, the keys of ``plan.json``; `padgen.plan` makes one. Lengths are in mm, frequencies in Hz.
    """

    name: str
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

    def __repr__(self) -> str:
        coils, channels = self.coils, self.channels
        return (
            f"<Plan {self.name}: {len(self.taxels)} taxels over {coils.rows} x {coils.columns} coils, resonances"
            f" {channels[0].resonance_hz:.1f} ... {channels[-1].resonance_hz:.1f} Hz, {self.selectivity.drive} drive>"
        )

    def _repr_html_(self) -> str:
        from padgen.report.plan_view import plan_html

        return plan_html(self)

    def plot(self) -> Any:
        """Draw the pad, with each coil's share of good prints, and its resonances; a `matplotlib.figure.Figure`."""
        from padgen.report.plan_view import plan_figure

        return plan_figure(self)

    @property
    def scheme(self) -> Scheme:
        """The drive scheme with the settings of the spec."""
        name = self.selectivity.drive
        return Scheme(name, self.spec.drive.bias_ratio, SCHEMES.version(name))

    @property
    def sets(self) -> tuple[tuple[Channel, ...], ...]:
        """The channels of one coil, for each kind of coil that there is."""
        return channel_sets(self.channels, self.coils.sets)

    def arrangement(self, channel: Channel) -> Arrangement:
        """Beams, blocks and window of a channel's taxel in its own axes."""
        beam, plate = channel.beam, self.plate
        shape = PlateShape(plate.length_mm, plate.width_mm, plate.thickness_mm)
        size = BeamShape(beam.width_mm, beam.thickness_mm, beam.length_mm)
        return suspension(beam.topology).arrange(shape, size, plate.gap_mm)


def channel_sets(channels: Sequence[Channel], sets: int) -> tuple[tuple[Channel, ...], ...]:
    """Deal `channels` out in turn."""
    return tuple(tuple(channels[k::sets]) for k in range(sets))


def plan_to_json(plan: Plan) -> str:
    """The plan as JSON text, keys in the order of the fields; the same plan gives the same bytes."""
    return json_text(plan)
