"""Define `Spec`, the description of the wanted pad: frozen, each field with unit, bounds and one line of meaning.

`Material`, `Printer`, `Spread`, `Washer`, `Magnet`, `Ballast`, `Coil`, `Amplifier` and `SoundCard` are catalogue
entries: a spec names one and may override any of its fields.
"""

from dataclasses import dataclass, field
from math import ceil, hypot, pi, sqrt
from typing import Any

from padgen.core.errors import listed, number
from padgen.core.registry import COILS, MOVERS, SCHEMES, SUSPENSIONS
from padgen.spec.fields import choice, entry_name, flag, folder_name, numbers, quantity, text

__all__ = [
    "Amplifier",
    "Ballast",
    "Coil",
    "ContactorTable",
    "DriveTable",
    "GuardTable",
    "LifeTable",
    "LimitsTable",
    "Magnet",
    "Material",
    "Model",
    "MountTable",
    "MoverTable",
    "PadTable",
    "Printer",
    "SoundCard",
    "Spec",
    "Spread",
    "SuspensionTable",
    "TaxelTable",
    "TouchTable",
    "Washer",
]

STRUCTURE_MODELS = ("beam", "solid")
GUARD_PLAY_MM = 0.6
"""Room round a pin in a hole of the guard plate: screws of M3 in their holes, and prints."""
EDGE_SHARE = 0.2
"""Largest chamfer of a pin's edge over its diameter."""
MAGNETIC = 2.0
"""Smallest relative permeability of a washer or of ballast that counts as magnetic."""
LAYER_SHARE = 1e-6
"""Share of a layer by which a height may exceed whole layers through rounding."""


@dataclass(frozen=True, slots=True)
class PadTable:
    """The printed pad: an active area divided into cells, and a border around it."""

    width_mm: float = quantity(50.0, unit="mm", low=5, high=1000, doc="active area along x")
    depth_mm: float = quantity(50.0, unit="mm", low=5, high=1000, doc="active area along y")
    frame_thickness_mm: float = quantity(4.0, unit="mm", low=0.5, high=20, doc="height of ribs and border")
    rib_mm: float = quantity(1.0, unit="mm", low=0.2, high=20, doc="smallest width of the ribs between taxels")
    border_mm: float = quantity(6.0, unit="mm", low=1, high=50, doc="width of the border around the active area")
    hole_diameter_mm: float = quantity(
        3.4, unit="mm", low=0, high=20, doc="corner mounting holes in the border; 0 leaves them out (3.4: M3)"
    )


@dataclass(frozen=True, slots=True)
class TaxelTable:
    """The moving part: a plate with a boss above and a washer recess below."""

    plate_thickness_mm: float = quantity(4.0, unit="mm", low=0.4, high=20, doc="thickness of the plate")
    plate_length_mm: float | None = quantity(
        None, unit="mm", low=1, high=100, doc="plate along the beam; washer recess and walls when absent"
    )
    plate_width_mm: float | None = quantity(
        None, unit="mm", low=1, high=100, doc="plate across the beam; washer recess and walls when absent"
    )
    boss_diameter_mm: float = quantity(2.5, unit="mm", low=0.5, high=30, doc="touch boss")
    boss_protrusion_mm: float = quantity(1.0, unit="mm", low=0, high=10, doc="height of the boss above the frame")
    boss_edge_mm: float = quantity(0.3, unit="mm", low=0, high=5, doc="chamfer that breaks the edge of the boss")
    fillet_mm: float = quantity(0.3, unit="mm", low=0, high=5, doc="fillets at the roots of the beams")
    washer_clearance_mm: float = quantity(
        0.25, unit="mm", low=0, high=2, doc="how much wider its recess is than the washer"
    )
    glue_gap_mm: float = quantity(
        0.1,
        unit="mm",
        low=0,
        high=1,
        doc="how much deeper its recess is than the washer, rounded up to whole layers",
    )
    glue_mg: float = quantity(0.0, unit="mg", low=0, high=1000, doc="mass of glue per taxel; weigh ten")
    glue_spread_mg: float | None = quantity(
        None,
        unit="mg",
        low=0,
        high=1000,
        doc="spread of the glue from taxel to taxel; the printer's spread when absent",
    )
    centre_post: bool = flag(False, doc="a post in the recess that centres the washer by its bore")


@dataclass(frozen=True, slots=True)
class Material:
    """A printed polymer."""

    name: str = entry_name(doc="name in the catalogue")
    process: str = choice(of=("fdm", "resin"), doc="process that prints it")
    youngs_modulus_gpa: float = quantity(unit="GPa", low=1e-3, high=300, doc="flexural modulus of the print")
    poisson_ratio: float = quantity(unit="1", low=0, high=0.499, doc="Poisson's ratio")
    density_g_per_cm3: float = quantity(unit="g/cm³", low=0.1, high=20, doc="density")
    fatigue_stress_mpa: float = quantity(unit="MPa", low=0.1, high=2000, doc="stress that many cycles allow")
    cross_layer_ratio: float = quantity(
        1.0,
        unit="1",
        low=0.05,
        high=1,
        doc="stiffness across the layers of a print over that along them",
    )
    glass_c: float | None = quantity(
        None, unit="°C", low=-150, high=400, doc="glass point or heat deflection temperature; not judged when absent"
    )
    softening_per_k: float = quantity(
        0.005, unit="1/K", low=0, high=0.1, doc="share of its stiffness that the print loses per K, near 23 °C"
    )
    dynamic_ratio: float | None = quantity(
        None,
        unit="1",
        low=1,
        high=10,
        doc="stiffness at the resonances over youngs_modulus_gpa, which slow tests find; no bound when absent",
    )
    wet_ratio: float | None = quantity(
        None,
        unit="1",
        low=0.01,
        high=1,
        doc="stiffness once the print has taken up water from humid air, over the dry print's; no bound when absent",
    )
    nozzle_c: float | None = quantity(
        None, unit="°C", low=0, high=500, doc="temperature of the nozzle in the slicer's files; that of PLA when absent"
    )
    bed_c: float | None = quantity(
        None, unit="°C", low=0, high=250, doc="temperature of the bed in the slicer's files; that of PLA when absent"
    )
    dynamic: bool = flag(False, doc="plan by the stiffness at the resonances, with dynamic_ratio")
    wet: bool = flag(False, doc="plan by the stiffness of the wet print, with wet_ratio")
    source: str = text("", doc="where the figures come from")

    @property
    def modulus_gpa(self) -> float:
        """Young's modulus in GPa that plans use: times `dynamic_ratio` if `dynamic`, times `wet_ratio` if `wet`."""
        dynamic = self.dynamic_ratio or 1.0
        wet = self.wet_ratio or 1.0
        return self.youngs_modulus_gpa * (dynamic if self.dynamic else 1.0) * (wet if self.wet else 1.0)


@dataclass(frozen=True, slots=True)
class Printer:
    """A printer with the settings that the pad is sized for."""

    name: str = entry_name(doc="name in the catalogue")
    process: str = choice(of=("fdm", "resin"), doc="process")
    nozzle_mm: float = quantity(unit="mm", low=0.01, high=2, doc="nozzle diameter (resin: pixel)")
    line_width_mm: float = quantity(unit="mm", low=0.01, high=3, doc="one extrusion line; smallest wall")
    smallest_beam_mm: float = quantity(unit="mm", low=0.01, high=3, doc="smallest width of a beam")
    layer_mm: float = quantity(unit="mm", low=0.01, high=1, doc="layer height")
    first_layer_mm: float = quantity(unit="mm", low=0.01, high=1, doc="height of the first layer")
    smallest_beam_layers: int = quantity(unit="layers", low=1, high=100, doc="fewest layers of a beam")
    smallest_gap_mm: float = quantity(unit="mm", low=0.01, high=3, doc="smallest gap that stays open")
    longest_bridge_mm: float = quantity(unit="mm", low=0, high=100, doc="longest span without support")
    steepest_overhang_deg: float = quantity(
        unit="deg", low=0, high=89, doc="largest overhang from the vertical without support"
    )
    bed_x_mm: float = quantity(unit="mm", low=10, high=2000, doc="bed along x")
    bed_y_mm: float = quantity(unit="mm", low=10, high=2000, doc="bed along y")
    bed_z_mm: float = quantity(unit="mm", low=10, high=2000, doc="build height")
    xy_compensation_mm: float = quantity(
        unit="mm", low=-1, high=1, doc="slicer's XY size compensation that lays beams at their drawn width"
    )
    shortest_beam_mm: float = quantity(
        0.0, unit="mm", low=0, high=10, doc="shortest beam, without its flare, that the slicer lays at its drawn width"
    )
    smallest_pin_mm: float | None = quantity(
        None,
        unit="mm",
        low=0.01,
        high=10,
        doc="smallest diameter of an upright pin that stands by itself; two lines when absent",
    )
    hole_loss_mm: float = quantity(
        0.0,
        unit="mm",
        low=0,
        high=1,
        doc="how much narrower than drawn the slicer lays a round recess",
    )
    width_step_mm: float = quantity(
        1e-3, unit="mm", low=1e-6, high=3, doc="steps in which a beam can be wider than the smallest (resin: pixel)"
    )
    z_offset_mm: float = quantity(
        0.0, unit="mm", low=-0.5, high=0.5, doc="how much thicker than drawn beams print (padgen calibrate finds it)"
    )
    width_offset_mm: float = quantity(
        0.0, unit="mm", low=-0.5, high=0.5, doc="how much wider than drawn beams print (padgen calibrate finds it)"
    )
    source: str = text("", doc="where the figures come from")

    @property
    def least_pin_mm(self) -> float:
        """Smallest diameter in mm of a pin that prints: `smallest_pin_mm`, or two line widths without it."""
        return self.smallest_pin_mm or 2 * self.line_width_mm

    def layers_up_to(self, height_mm: float) -> int:
        """Return the smallest number of layers, one or more, that reaches a height."""
        return max(ceil((height_mm - self.first_layer_mm) / self.layer_mm - LAYER_SHARE) + 1, 1)

    def height_mm(self, layers: int) -> float:
        """Return the height in mm of a number of layers, the first one included."""
        return round(self.first_layer_mm + (layers - 1) * self.layer_mm, 9)


@dataclass(frozen=True, slots=True)
class Spread:
    """Spread between prints of one drawing: the standard deviation of each cause (sources in docs/yield.md).

    A `bias` is the same in every print of a printer. Calibration or re-tuning removes it, so that simulated prints do
    not have it. A `common` error is the same in all beams of a print, the `field` varies smoothly over the bed, and all
    others vary from taxel to taxel. `bead_ratio` is no deviation: what it does to the ratios of channels is alike in
    every simulated print.
    """

    name: str = entry_name(doc="name in the catalogue")
    process: str = choice(of=("fdm", "resin"), doc="process that it is of")
    z_bias_mm: float = quantity(
        unit="mm",
        low=0,
        high=1,
        doc="how far beams' thickness is off in every print until the printer is calibrated",
    )
    modulus_bias: float = quantity(
        unit="1", low=0, high=1, doc="how far the modulus is off in every print, relative, until it is calibrated"
    )
    common_z_mm: float = quantity(unit="mm", low=0, high=1, doc="spread of the beams' thickness from print to print")
    common_modulus: float = quantity(
        unit="1", low=0, high=1, doc="spread of the modulus from print to print, relative (spool, dryness)"
    )
    field_z_mm: float = quantity(unit="mm", low=0, high=1, doc="spread of thickness over a bed that is meshed")
    unmeshed_field_z_mm: float = quantity(unit="mm", low=0, high=1, doc="spread of thickness over another bed")
    field_length_mm: float = quantity(
        unit="mm", low=20, high=1000, doc="distance at which the field's correlation has fallen to 1/e"
    )
    thickness_mm: float = quantity(unit="mm", low=0, high=1, doc="spread of the beams' thickness from taxel to taxel")
    width_mm: float = quantity(unit="mm", low=0, high=1, doc="spread of the beams' width from taxel to taxel")
    length_mm: float = quantity(unit="mm", low=0, high=1, doc="spread of the beams' length from taxel to taxel")
    bead_ratio: float = quantity(
        1.0,
        unit="1",
        low=0.1,
        high=1,
        doc="stiffness across the beads of a layer over that along them, in every print; plans take 1",
    )
    common_beads: float = quantity(
        0.0, unit="1", low=0, high=1, doc="spread of that ratio from print to print, relative"
    )
    beads: float = quantity(0.0, unit="1", low=0, high=1, doc="spread of that ratio from taxel to taxel, relative")
    common_gap_mm: float = quantity(
        0.0, unit="mm", low=0, high=1, doc="spread of the gap from pad to pad (height of the tray, its feet and coils)"
    )
    gap_mm: float = quantity(
        0.0, unit="mm", low=0, high=1, doc="spread of the gap from taxel to taxel (washers' seats in their recesses)"
    )
    common_glue_mg: float = quantity(
        0.0, unit="mg", low=0, high=1000, doc="spread of the glue per taxel from pad to pad, about taxel.glue_mg"
    )
    glue_mg: float = quantity(0.0, unit="mg", low=0, high=1000, doc="spread of the glue from taxel to taxel")
    bed_meshed: bool = flag(True, doc="whether the bed's height is probed (meshed) before every print")
    source: str = text("", doc="where the figures come from")

    @property
    def bed_field_mm(self) -> float:
        """Sigma in mm of the thickness error that varies smoothly over the bed; less if the bed is probed."""
        return self.field_z_mm if self.bed_meshed else self.unmeshed_field_z_mm


@dataclass(frozen=True, slots=True)
class Washer:
    """A flat washer."""

    name: str = entry_name(doc="name in the catalogue")
    outer_diameter_mm: float = quantity(unit="mm", low=0.5, high=100, doc="outer diameter")
    inner_diameter_mm: float = quantity(unit="mm", low=0, high=99, doc="bore")
    thickness_mm: float = quantity(unit="mm", low=0.05, high=20, doc="thickness")
    density_g_per_cm3: float = quantity(unit="g/cm³", low=0.5, high=25, doc="density")
    relative_permeability: float = quantity(unit="1", low=1, high=1e6, doc="1 is not magnetic")
    coercivity_a_per_m: float = quantity(
        200.0, unit="A/m", low=0, high=1e5, doc="coercivity of the steel; drive.remanent_share of it is kept"
    )
    source: str = text("", doc="where the figures come from")


@dataclass(frozen=True, slots=True)
class Magnet:
    """A disc or ring magnetised along its axis."""

    name: str = entry_name(doc="name in the catalogue")
    outer_diameter_mm: float = quantity(unit="mm", low=0.5, high=100, doc="outer diameter")
    inner_diameter_mm: float = quantity(unit="mm", low=0, high=99, doc="bore; 0 is a disc")
    thickness_mm: float = quantity(unit="mm", low=0.05, high=20, doc="thickness, along which it is magnetised")
    size_tolerance_mm: float = quantity(0.1, unit="mm", low=0, high=2, doc="how far its sizes may be off")
    grade: str = text("n42", doc="grade of its material, a catalogue name; it gives the fields below")
    remanence_low_t: float = quantity(1.28, unit="T", low=0.01, high=1.5, doc="least remanence Br of the grade")
    remanence_high_t: float = quantity(1.32, unit="T", low=0.01, high=1.5, doc="largest remanence Br of the grade")
    coercivity_ka_per_m: float = quantity(
        955.0, unit="kA/m", low=1, high=1e4, doc="least intrinsic coercivity Hcj at 20 °C"
    )
    remanence_per_k: float = quantity(-0.0012, unit="1/K", low=-0.1, high=0, doc="change of the remanence, as a share")
    coercivity_per_k: float = quantity(
        -0.0075, unit="1/K", low=-0.1, high=0.1, doc="change of the coercivity, as a share"
    )
    recoil_permeability: float = quantity(1.05, unit="1", low=1, high=10, doc="relative permeability of its recoil")
    limit_c: float = quantity(80.0, unit="°C", low=-50, high=600, doc="largest temperature of the grade")
    density_g_per_cm3: float = quantity(7.5, unit="g/cm³", low=0.5, high=25, doc="density")
    polarity: str = choice(
        "alike",
        of=("alike", "alternating"),
        doc="alike: all north poles up; alternating: up and down from coil to coil, like a chessboard's colours, with"
        " the leads of every second coil swapped",
    )
    source: str = text("", doc="where the figures come from")


@dataclass(frozen=True, slots=True)
class Ballast:
    """A mass that is pressed upright into the plate above the washer or magnet, which is glued under it."""

    name: str = entry_name(doc="name in the catalogue")
    width_mm: float = quantity(unit="mm", low=0.5, high=50, doc="diameter; of a hexagon across its flats")
    height_mm: float = quantity(unit="mm", low=0.1, high=20, doc="height along the axis")
    density_g_per_cm3: float = quantity(unit="g/cm³", low=0.5, high=25, doc="mass over the volume by these sizes")
    relative_permeability: float = quantity(unit="1", low=1, high=1e6, doc="1 is not magnetic")
    shape: str = choice("round", of=("round", "hexagon"), doc="round: a pin, disc or ring; hexagon: a nut")
    inner_diameter_mm: float = quantity(0.0, unit="mm", low=0, high=49, doc="bore; 0 is a solid part")
    source: str = text("", doc="where the figures come from")

    @property
    def is_magnetic(self) -> bool:
        """True of steel that a magnet or a coil magnetises."""
        return self.relative_permeability >= MAGNETIC

    @property
    def area_mm2(self) -> float:
        """Area in mm² of its cross-section."""
        face = sqrt(3) / 2 if self.shape == "hexagon" else pi / 4
        return face * self.width_mm**2 - pi / 4 * self.inner_diameter_mm**2

    @property
    def mass_g(self) -> float:
        """Mass in g."""
        return self.area_mm2 * self.height_mm * self.density_g_per_cm3 * 1e-3

    @property
    def corners_mm(self) -> float:
        """Largest width in mm: a round part's diameter, or a hexagon's size across corners.

        A hexagon's corners point across the beam.
        """
        return self.width_mm * (2 / sqrt(3) if self.shape == "hexagon" else 1.0)

    @property
    def round_mm(self) -> float:
        """Diameter in mm of the disc with the same area as the outline.

        As a disc a hexagon has 0.8 % less moment about its axis, and half of that across.
        """
        return self.width_mm * (sqrt(2 * sqrt(3) / pi) if self.shape == "hexagon" else 1.0)


@dataclass(frozen=True, slots=True)
class MoverTable:
    """The kind of part that the coil moves: a steel washer or a magnet."""

    kind: str = choice(
        "washer",
        of=MOVERS.names,
        doc="washer: steel, pulled by the square of the current; magnet: pulled and pushed by the current itself",
    )


@dataclass(frozen=True, slots=True)
class Coil:
    """A coil on an optional core, with its top `gap_mm` below the washers of a pad that does not sag.

    `gap_mm`, `reuse` and a board coil's sizes may be left to the search (None, 'auto', `sizing` 'auto'); the spec in a
    plan has the values found.
    """

    name: str = entry_name(doc="name in the catalogue")
    outer_diameter_mm: float = quantity(unit="mm", low=0.5, high=200, doc="outside of the winding")
    inner_diameter_mm: float = quantity(unit="mm", low=0.1, high=199, doc="inside of the winding")
    length_mm: float = quantity(
        unit="mm", low=0.1, high=500, doc="length of winding and core; of a board coil, its board's thickness"
    )
    turns: float = quantity(unit="turns", low=1, high=1e6, doc="turns")
    resistance_ohm: float = quantity(unit="Ω", low=1e-3, high=1e6, doc="resistance")
    inductance_mh: float = quantity(unit="mH", low=0, high=1e5, doc="inductance")
    core_diameter_mm: float = quantity(unit="mm", low=0, high=199, doc="core; 0 is an air core")
    core_relative_permeability: float = quantity(unit="1", low=1, high=1e6, doc="of the core")
    core_coercivity_a_per_m: float = quantity(
        100.0, unit="A/m", low=0, high=1e5, doc="coercivity of the core; drive.remanent_share of it is kept"
    )
    kind: str = choice("solenoid", of=COILS.names, doc="what winding and core are like (padgen/planner/coils)")
    gap_mm: float = quantity(
        None,
        unit="mm",
        low=0.05,
        high=100,
        doc="coil top to washer underside, before sag; when absent searched for, 1 on a grid or with resonances given",
    )
    grid: tuple[int, int] | None = numbers(
        None, unit="coils", low=1, high=1000, count=2, doc="[rows, columns]; searched for when absent"
    )
    reuse: str = choice(
        "auto",
        of=("auto", "same", "alternate"),
        doc="same: all coils have the same resonances; alternate: two sets take turns like a chessboard's colours,"
        " so that a coil's tones fall between its neighbours' channels; auto: searched for, same on a grid or with"
        " resonances given",
    )
    power_limit_w: float = quantity(0.5, unit="W", low=1e-4, high=1e4, doc="heat that one coil bears for long")
    source: str = text("", doc="where the figures come from")
    house: str = text("", doc="rules of the house that makes a board coil (board_houses.csv)")
    sizing: str = choice(
        "given",
        of=("given", "auto"),
        doc="auto: the search finds the outer diameter of a board coil, of those that its cell has room for; so it does"
        " where no diameter is given",
    )
    layers: int | None = quantity(None, unit="layers", low=2, high=16, doc="copper layers of a board coil")
    track_mm: float | None = quantity(None, unit="mm", low=0.02, high=10, doc="width of a board coil's tracks")
    space_mm: float | None = quantity(None, unit="mm", low=0.02, high=10, doc="space between a board coil's tracks")
    copper_um: float | None = quantity(None, unit="µm", low=5, high=500, doc="outer copper of a board coil, as made")
    inner_copper_um: float | None = quantity(None, unit="µm", low=5, high=500, doc="inner copper of a board coil")
    wiring: str = choice(
        "series",
        of=("series", "parallel"),
        doc="layers of a board coil in series, or its upper and its lower ones each in parallel",
    )
    shape: str = choice(
        "round",
        of=("round", "rectangular"),
        doc="of a board coil's spirals; of a rectangular one outer_diameter_mm is the size along x",
    )
    outer_depth_mm: float | None = quantity(
        None, unit="mm", low=0.5, high=200, doc="outer size along y of a rectangular board coil"
    )
    connector: str = text("", doc="what the coils of a board are plugged to (connectors.csv)")

    @property
    def sides_mm(self) -> tuple[float, float]:
        """Outer size in mm along x and along y; twice the diameter of a round coil."""
        return self.outer_diameter_mm, self.outer_depth_mm or self.outer_diameter_mm

    @property
    def size_text(self) -> str:
        """Size of the coil as text: its diameter, or the sides of a rectangular one."""
        sides_mm = self.sides_mm[:1] if self.shape == "round" else self.sides_mm
        return " x ".join(map(number, sides_mm)) + " mm"

    def off_axis_mm(self, place_mm: tuple[float, float]) -> float:
        """Return how far off the axis a place in mm lies.

        Off a rectangular coil that is along x, or along y in proportion to its sides, whichever is more.
        """
        if self.shape == "round":
            return hypot(*place_mm)
        width_mm, depth_mm = self.sides_mm
        return max(abs(place_mm[0]), abs(place_mm[1]) * width_mm / depth_mm)

    @property
    def face_mm2(self) -> float:
        """Area in mm² that the coil covers, cut corners and all."""
        return self._area_mm2(self.sides_mm)

    @property
    def bore_mm2(self) -> float:
        """Area in mm² of the winding's bore."""
        return self._area_mm2(self.bore_sides_mm)

    def _area_mm2(self, sides_mm: tuple[float, float]) -> float:
        x, y = sides_mm
        return pi / 4 * x * y if self.shape == "round" else x * y

    @property
    def mean_turn_mm(self) -> float:
        """Length in mm of a turn half way between the bore and the outside, corners counted as sharp."""
        mean_mm = (sum(self.sides_mm) + sum(self.bore_sides_mm)) / 2
        return pi / 2 * mean_mm if self.shape == "round" else 2 * mean_mm

    @property
    def bore_sides_mm(self) -> tuple[float, float]:
        """Size in mm of the winding's bore along x and along y."""
        x, y = self.sides_mm
        winding_mm = min(x, y) - self.inner_diameter_mm
        return x - winding_mm, y - winding_mm

    @property
    def sets(self) -> int:
        """Number of sets of resonances: 2 where neighbouring coils alternate between two, 1 where all are alike."""
        return 2 if self.reuse == "alternate" else 1


@dataclass(frozen=True, slots=True)
class Amplifier:
    """An amplifier with a channel for each coil, or a sound card or board that drives coils by itself."""

    name: str = entry_name(doc="name in the catalogue, or of your own")
    channels: int = quantity(unit="channels", low=1, high=100_000, doc="outputs, one for each coil")
    coupling: str = choice(of=("AC", "DC"), doc="AC: no direct current passes; DC: it does")
    voltage_v: float = quantity(unit="V", low=0.01, high=1e5, doc="largest voltage at a coil, peak")
    current_a: float = quantity(unit="A", low=1e-4, high=1e4, doc="largest current of a channel, peak")
    source: str = text("", doc="where the figures come from")


@dataclass(frozen=True, slots=True)
class SoundCard:
    """A sound card whose outputs feed the coils' amplifiers, one each."""

    name: str = entry_name(doc="name in the catalogue, or of your own")
    channels: int = quantity(unit="channels", low=1, high=100_000, doc="outputs, one for each coil")
    coupling: str = choice(of=("AC", "DC"), doc="AC: no direct current passes; DC: it does")
    corner_hz: float | None = quantity(
        None, unit="Hz", low=0.001, high=1000, doc="-3 dB corner of its first-order high-pass, where it is AC coupled"
    )
    full_scale_v: float | None = quantity(
        None, unit="V", low=0.001, high=1e3, doc="peak voltage of a full-scale sample, unloaded"
    )
    output_ohm: float | None = quantity(None, unit="Ω", low=0, high=1e5, doc="impedance of an output")
    assumed: str = text("", doc="figures that no maker's text states, as names of fields")
    source: str = text("", doc="where the figures come from")


@dataclass(frozen=True, slots=True)
class SuspensionTable:
    """The kind of suspension, and the dimensions of its beams that may be tuned."""

    topology: str = choice(
        "auto",
        of=lambda: ("auto", *SUSPENSIONS.families(), *SUSPENSIONS.names()),
        doc="kind of suspension; auto takes the one least sensitive to printing, serpentine for each channel the number"
        " of legs that is",
    )
    tune: str = choice(
        "width+thickness+length",
        of=("width", "width+thickness", "width+length", "width+thickness+length"),
        doc="what may differ between channels; no more of it does than the resonances take",
    )
    thickness_mm: float | None = quantity(
        None, unit="mm", low=0.01, high=20, doc="thickness of all beams; a whole number of layers"
    )
    length_mm: float | None = quantity(None, unit="mm", low=0.1, high=300, doc="length of all beams")


@dataclass(frozen=True, slots=True)
class DriveTable:
    """The drive of the coils, the levels of the taxels, and the amplifier."""

    scheme: str = choice(
        "auto",
        of=lambda: ("auto", *SCHEMES.names()),
        doc="what the coil's current is made of (docs/driving.md); auto takes the simplest that is selective enough",
    )
    level_um: float = quantity(10.0, unit="µm", low=1e-4, high=5000, doc="ON amplitude of the lowest channel")
    level_law: float | str = quantity(
        1.0,
        unit="1",
        low=0,
        high=2,
        doc="ON amplitude falls as 1/f^p: 0 equal displacement, 1 velocity, 2 acceleration; 'sensation': equally far"
        " above the detection threshold of a fingertip",
        words=("sensation",),
    )
    threshold_file: str | None = text(
        None, doc="CSV of frequency in Hz and detection threshold in µm, beside the spec: levels of equal sensation"
    )
    threshold_hz: tuple[float, ...] | None = numbers(
        None, unit="Hz", low=1e-3, high=1e7, doc="the curve's frequencies, rising; in place of threshold_file"
    )
    threshold_um: tuple[float, ...] | None = numbers(
        None, unit="µm", low=1e-6, high=1e5, doc="the curve's thresholds, one for each of threshold_hz"
    )
    bias_ratio: float = quantity(
        5.0, unit="1", low=0.1, high=1e3, doc="biased: constant current over the largest tone's; 5 is spurs of -20 dB"
    )
    headroom: float = quantity(
        0.05, unit="1", low=0, high=10, doc="spur-free: constant force above the sum of the tones', as a share of it"
    )
    remanent_share: float = quantity(
        0.0,
        unit="1",
        low=0,
        high=1,
        doc="how magnetised washers and cores are, over their coercivity: 0 of demagnetised steel, 0.25 is usual"
        " (assumed), 1 once a magnet has touched them",
    )
    least_frames_per_s: float = quantity(
        1.0, unit="1/s", low=0, high=1e6, doc="fewest frames per second for which auto lets channels take turns"
    )
    voltage_limit_v: float = quantity(
        30.0,
        unit="V",
        low=0.01,
        high=1e5,
        doc="peak voltage of the amplifier that feeds a coil; at most that of [amplifier], where there is one",
    )
    bandwidth_hz: float | None = quantity(
        None,
        unit="Hz",
        low=1,
        high=1e7,
        doc="highest frequency that the amplifier passes; half the sample rate when absent",
    )


@dataclass(frozen=True, slots=True)
class Model:
    """The model of the resonances, and the relative error above which plans warn (docs/accuracy.md)."""

    structure: str = choice(
        "auto",
        of=("auto", *STRUCTURE_MODELS),
        doc="beam, or solid: finite elements of the printed solid; auto is beam, or with --tolerance solid where the"
        " beam model may be off by more",
    )
    tolerance: float = quantity(
        0.02,
        unit="1",
        low=1e-4,
        high=0.5,
        doc="relative error of a resonance from which on plans warn: 0.02 is 2 %",
    )


@dataclass(frozen=True, slots=True)
class LimitsTable:
    """Limits of the pad as a whole."""

    power_w: float | None = quantity(
        None, unit="W", low=1e-4, high=1e6, doc="heat of all coils together with all taxels on; no limit when absent"
    )
    room_c: float = quantity(23.0, unit="°C", low=-20, high=60, doc="temperature of the air around the pad")


@dataclass(frozen=True, slots=True)
class LifeTable:
    """Changes that a pad must bear after its taxels were re-tuned once (docs/yield.md)."""

    temperature_range_k: float = quantity(
        10.0, unit="K", low=0, high=60, doc="how much warmer or colder than at re-tuning the pad may be in use"
    )
    ageing: float = quantity(
        0.005, unit="1", low=0, high=0.3, doc="spread of the resonances' change by creep and ageing, from pad to pad"
    )
    common_q: float = quantity(0.1, unit="1", low=0, high=1, doc="spread of Q about q_min from pad to pad, relative")
    q: float = quantity(0.1, unit="1", low=0, high=1, doc="spread of Q from taxel to taxel, relative")

    @property
    def changes_text(self) -> str:
        """Words for the changes since re-tuning that a pad must bear, to follow 'when', e.g. 'the plastic has aged'."""
        changes = []
        if self.temperature_range_k:
            changes.append(f"the room is {number(self.temperature_range_k)} K warmer or colder")
        if self.ageing:
            changes.append("the plastic has aged")
        if self.common_q or self.q:
            changes.append("Q is not as planned")
        if not changes:
            return "nothing has changed"
        return listed(changes)


@dataclass(frozen=True, slots=True)
class MountTable:
    """The place of the pad in use: what holds it, and what is below it (docs/recoil.md)."""

    kind: str = choice(
        "unsaid",
        of=("unsaid", "resting", "skin", "foam", "screwed", "glued"),
        doc="what holds the pad: resting, skin or foam: it lies loose; screwed or glued: fastened to the base, which"
        " does not move where base_mass_g is absent; unsaid: planned as held still, with what it keeps loose beside it",
    )
    base_mass_g: float | None = quantity(
        None, unit="g", low=1e-3, high=1e6, doc="mass of a plate below pad and tray that moves with them"
    )
    stiffness_n_per_m: float | None = quantity(
        None, unit="N/m", low=1e-3, high=1e12, doc="stiffness of skin, foam or feet below all of it; loose when absent"
    )
    q: float | None = quantity(
        None, unit="1", low=0.01, high=1e6, doc="quality factor of the vertical motion on that stiffness; 2 when absent"
    )

    @property
    def is_said(self) -> bool:
        """True where the spec says how the pad is held."""
        return self != MountTable()

    @property
    def is_immovable(self) -> bool:
        """True where the pad is fastened to a base that does not move."""
        fastened = self.kind in ("screwed", "glued")
        return fastened and self.base_mass_g is None and self.stiffness_n_per_m is None


PRINTS_AND = {"fingertip": " and fingers", "palm": " and hands", "own": " and contacts"}
"""Words for the contacts that are drawn at random beside prints, by what lies on the taxels."""


@dataclass(frozen=True, slots=True)
class TouchTable:
    """The finger or palm on the taxels, under which the pad is to choose them (docs/touch.md)."""

    contact: str = choice(
        "none",
        of=("none", "fingertip", "palm", "own"),
        doc="what lies on the taxels: none plans untouched taxels; fingertip, palm: skin of the catalogue; own: that of"
        " k_n_per_m, c_n_s_per_m and m_g",
    )
    tones: str = choice(
        "auto",
        of=("auto", "touched", "untouched"),
        doc="which resonances the tones are at: those under typical skin, or those of taxels that nobody touches; auto"
        " takes what keeps more under touch",
    )
    search: str = text(
        "auto",
        doc="parts that the search decides: mover (or magnet, washer: one of that kind), coil, ballast, suspension,"
        " contactor, resonances, joined by +; none; auto: those that the spec leaves out, where it leaves the grid of"
        " coils and the resonances open",
    )
    person: float | None = quantity(
        None,
        unit="1",
        low=0.05,
        high=0.95,
        doc="the one person the pad is for: share of people with softer skin; people are drawn from all when absent",
    )
    people: float | None = quantity(
        None,
        unit="1",
        low=0,
        high=3,
        doc="spread between people, sigma of ln of each figure of skin; when absent low and high skin of the catalogue"
        " are 5 % and 95 % of people, and a contact of one's own is of one person",
    )
    places: float = quantity(
        0.25, unit="1", low=0, high=3, doc="spread of a person's skin from taxel to taxel, sigma of ln (assumed)"
    )
    indentation_mm: float | None = quantity(
        None,
        unit="mm",
        low=0,
        high=0.5,
        doc="how far a contactor at rest presses the skin in, which stiffens it: e times for each 0.5 mm (assumed);"
        " when absent, what it stands proud of a guard plate, 0 without one",
    )
    pressing_mm: float = quantity(
        0.0,
        unit="mm",
        low=0,
        high=0.5,
        doc="spread of indentation_mm from touch to touch; the catalogue's low and high skin have the usual pressing",
    )
    hz: tuple[float, ...] | None = numbers(
        None,
        unit="Hz",
        low=1e-3,
        high=1e7,
        doc="own: frequencies of the lists below, rising and over the whole band; absent where each is one number",
        single=True,
    )
    k_n_per_m: tuple[float, ...] | None = numbers(
        None, unit="N/m", low=1e-6, high=1e9, doc="own: stiffness of the contact, one number or a list", single=True
    )
    c_n_s_per_m: tuple[float, ...] | None = numbers(
        None, unit="N s/m", low=0, high=1e6, doc="own: damping of the contact, one number or a list", single=True
    )
    m_g: tuple[float, ...] | None = numbers(
        None, unit="g", low=0, high=1e4, doc="own: mass that moves with it, one number or a list", single=True
    )

    @property
    def is_untouched(self) -> bool:
        """True where the pad is planned for taxels that nobody touches."""
        return self.contact == "none"

    @property
    def prints_text(self) -> str:
        """Words for the random samples that a pad is judged by: 'prints', or under touch 'prints and fingers'."""
        return f"prints{PRINTS_AND.get(self.contact, '')}"


@dataclass(frozen=True, slots=True)
class ContactorTable:
    """The part of a taxel that meets the skin (docs/contactor.md): a boss on the plate, or a pin on plate or beam."""

    diameter_mm: float | None = quantity(
        None,
        unit="mm",
        low=0.1,
        high=30,
        doc="diameter of the pin; when absent, on the plate that of the boss, on a beam the smallest that prints",
    )
    shape: str = choice("flat", of=("flat", "dome"), doc="its top: flat, or half a ball")
    place: float | str = quantity(
        "plate",
        unit="1",
        low=0.1,
        high=1,
        doc="where it stands: on the plate ('plate' or 1), or at a share of the length of the first beam from its root",
        words=("plate",),
    )
    protrusion_mm: float | None = quantity(
        None,
        unit="mm",
        low=0,
        high=10,
        doc="its height above the frame, or above the guard plate; taxel.boss_protrusion_mm when absent",
    )
    fillet_mm: float = quantity(
        0.2, unit="mm", low=0, high=5, doc="fillet round the foot of a pin, where there is room"
    )


@dataclass(frozen=True, slots=True)
class GuardTable:
    """A printed plate over the pad, on its screws, with a hole for each pin (docs/contactor.md)."""

    thickness_mm: float | None = quantity(
        None, unit="mm", low=0.4, high=20, doc="thickness of the plate above its pockets; no guard plate when absent"
    )
    clearance_mm: float = quantity(
        0.4, unit="mm", low=0.1, high=10, doc="depth of its pockets, in which plates and beams move, above the frame"
    )
    hole_diameter_mm: float | None = quantity(
        None, unit="mm", low=0.2, high=60, doc="diameter of its holes; when absent twice that of the pin, or 1.2 more"
    )


FOUND_SCHEMES = ("spur-free", "biased")
"""Drive schemes that the search for the fewest coils tries beside the automatic one, where the spec leaves it open."""


@dataclass(frozen=True, slots=True)
class Spec:
    """The description of a wanted pad; `name`, `resolution`, `band_hz` and `q_min` have no default."""

    name: str = folder_name(doc="name of the pad and of its folder", most=80)
    resolution: int = quantity(unit="taxels", low=1, high=100_000, doc="target number of taxels")
    band_hz: tuple[float, float] = numbers(
        unit="Hz", low=0.01, high=1e6, count=2, doc="[lowest, highest] frequency of the resonances"
    )
    q_min: float = quantity(
        unit="1",
        low=0.5,
        high=1e9,
        doc="smallest quality factor of a taxel: cycles until a pluck has decayed to 4 %",
    )
    delta_y: float = quantity(
        10.0,
        unit="1",
        low=1e-6,
        high=1e9,
        doc="amplitude ratio ON over OFF that is asked for: 10 is 20 dB, 7 is 17, 5 is 14; or delta_db = 14",
    )
    print_share: float = quantity(
        0.9,
        unit="1",
        low=0.5,
        high=0.999,
        doc="share of the prints that are to keep delta_y once they are re-tuned",
    )
    spacing: str = choice(
        "spread",
        of=("spread", "closest", "optimised"),
        what="spacing of the resonances",
        doc="spread: the band is shared evenly in octaves; closest: the paper's ladder from the lowest slot;"
        " optimised: the best all-state selectivity that the drive scheme can have",
    )
    resonances_hz: tuple[float, ...] | None = numbers(
        None,
        unit="Hz",
        low=0.01,
        high=1e6,
        doc="explicit resonances, one per channel, lowest first (with alternate sets: one from each in turn)",
    )
    pad: PadTable = field(default_factory=PadTable)
    taxel: TaxelTable = field(default_factory=TaxelTable)
    material: Material = field(kw_only=True)
    printer: Printer = field(kw_only=True)
    spread: Spread = field(kw_only=True)
    washer: Washer | None = None
    magnet: Magnet | None = None
    ballast: Ballast | None = None
    coil: Coil = field(kw_only=True)
    mover: MoverTable = field(default_factory=MoverTable)
    amplifier: Amplifier | None = None
    sound_card: SoundCard | None = None
    suspension: SuspensionTable = field(default_factory=SuspensionTable)
    drive: DriveTable = field(default_factory=DriveTable)
    model: Model = field(default_factory=Model)
    limits: LimitsTable = field(default_factory=LimitsTable)
    life: LifeTable = field(default_factory=LifeTable)
    mount: MountTable = field(default_factory=MountTable)
    touch: TouchTable = field(default_factory=TouchTable)
    contactor: ContactorTable = field(default_factory=ContactorTable)
    guard: GuardTable = field(default_factory=GuardTable)

    @property
    def pin_share(self) -> float | None:
        """Share of the first beam's length at which a pin stands on it; None where the contactor is on the plate."""
        place = self.contactor.place
        return float(place) if isinstance(place, (int, float)) and place < 1 else None

    @property
    def contact_diameter_mm(self) -> float:
        """Diameter in mm of what meets the skin: of the pin, or of the boss."""
        default = self.taxel.boss_diameter_mm if self.pin_share is None else self.printer.least_pin_mm
        return self.contactor.diameter_mm or default

    @property
    def contact_edge_mm(self) -> float:
        """Chamfer in mm at the top of boss or pin: 0 for a dome, at most a fifth of a pin's diameter."""
        if self.contactor.shape == "dome":
            return 0.0
        if self.contactor == ContactorTable():
            return self.taxel.boss_edge_mm
        return min(self.taxel.boss_edge_mm, self.contact_diameter_mm * EDGE_SHARE)

    @property
    def guard_height_mm(self) -> float:
        """Height in mm of the guard plate's top above the frame; 0 without one."""
        return self.guard.clearance_mm + self.guard.thickness_mm if self.guard.thickness_mm else 0.0

    @property
    def guard_hole_mm(self) -> float:
        """Diameter in mm of the guard plate's holes: by default twice the pin's, or the pin's plus play if more."""
        pin_mm = self.contact_diameter_mm
        return self.guard.hole_diameter_mm or max(2 * pin_mm, pin_mm + 2 * GUARD_PLAY_MM)

    @property
    def contact_proud_mm(self) -> float:
        """Height in mm by which boss or pin stands proud of the frame, or of the guard plate if there is one."""
        proud_mm = self.contactor.protrusion_mm
        return self.taxel.boss_protrusion_mm if proud_mm is None else proud_mm

    @property
    def contact_top_mm(self) -> float:
        """Height in mm above the bed of the top of boss or pin."""
        return self.pad.frame_thickness_mm + self.guard_height_mm + self.contact_proud_mm

    @property
    def washer_or_magnet(self) -> Washer | Magnet:
        """The washer or magnet in a taxel's recess, which the coil moves."""
        part = self.magnet or self.washer
        assert part is not None, "make_spec gives a spec the part of its mover"
        return part

    @property
    def ballast_argument(self) -> tuple[Ballast, ...]:
        """The ballast as a tuple of one, or of none without ballast, to be unpacked as a function's last arguments."""
        return () if self.ballast is None else (self.ballast,)

    @property
    def mover_table_name(self) -> str:
        """Name of the spec's table of the part that the coil moves: 'washer' or 'magnet'."""
        return "magnet" if self.magnet else "washer"

    @property
    def force_order(self) -> int:
        """Exponent of the current in the coil's force on the part it moves: 2 for a steel washer, 1 for a magnet."""
        return int(MOVERS.get(self.mover.kind, "mover.kind").FORCE_ORDER)

    @property
    def leaves_layout_free(self) -> bool:
        """True if coil.grid and resonances_hz are absent: the search may choose grid, gap, coil.reuse and drive."""
        return not self.coil.grid and not self.resonances_hz

    @property
    def may_have_found_scheme(self) -> bool:
        """True where `drive.scheme` may come from the search for the fewest coils, not from the spec's author."""
        return self.leaves_layout_free and self.force_order == 2 and self.drive.scheme in FOUND_SCHEMES

    @property
    def drive_devices(self) -> tuple[tuple[str, Amplifier | SoundCard], ...]:
        """Pairs (kind, device) of the amplifier and sound card that the spec names; kind is the word for it."""
        named = (("amplifier", self.amplifier), ("sound card", self.sound_card))
        return tuple((word, device) for word, device in named if device is not None)

    @property
    def blocked_by(self) -> str | None:
        """The first named device that blocks direct current, as "the AC-coupled ..."; None where none does."""
        blocking = (
            f"the AC-coupled {word} {device.name!r}" for word, device in self.drive_devices if device.coupling == "AC"
        )
        return next(blocking, None)

    @property
    def dc_coupling_change(self) -> dict[str, Any]:
        """The spec change that makes every named AC-coupled device pass direct current: values by dotted field name."""
        cure: dict[str, Any] = {
            f"{word.replace(' ', '_')}.coupling": "DC" for word, device in self.drive_devices if device.coupling == "AC"
        }
        return cure | ({"sound_card.corner_hz": None} if self.corner_hz else {})

    @property
    def corner_hz(self) -> float:
        """Corner in Hz of the sound card's high-pass; 0 where there is none or it is not known."""
        return (self.sound_card.corner_hz or 0.0) if self.sound_card else 0.0

    @property
    def recess_depth_mm(self) -> float:
        """Depth in mm of the recess in a plate's underside: washer or magnet, and glue, rounded up to whole layers."""
        return self._whole_layers_mm(self.mover_top_mm)

    @property
    def pocket_top_mm(self) -> float:
        """Height in mm of the ballast's top above the pad's underside; 0 without ballast.

        The ballast is pressed against the roof of its pocket, which is a whole number of layers high.
        """
        if self.ballast is None:
            return 0.0
        return self._whole_layers_mm(
            self.washer_or_magnet.thickness_mm + self.taxel.glue_gap_mm + self.ballast.height_mm
        )

    @property
    def mover_top_mm(self) -> float:
        """Height in mm above the pad's underside of the top of washer or magnet, which meets recess roof or ballast."""
        if self.ballast is None:
            return self._whole_layers_mm(self.washer_or_magnet.thickness_mm + self.taxel.glue_gap_mm)
        return self.pocket_top_mm - self.ballast.height_mm

    @property
    def mover_low_mm(self) -> float:
        """Height in mm of the underside of washer or magnet above the pad's underside."""
        return self.mover_top_mm - self.washer_or_magnet.thickness_mm

    def _whole_layers_mm(self, height_mm: float) -> float:
        """Return a height in mm rounded up to whole layers."""
        return self.printer.height_mm(self.printer.layers_up_to(height_mm))
