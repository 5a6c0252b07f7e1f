"""Define `Spec`, the description of the wanted pad: frozen, each field with unit, bounds and one line of meaning.

`Material`, `Printer`, `Spread`, `Washer`, `Coil`, `Amplifier` and `SoundCard` are catalogue entries: a spec names one
and may override any of its fields.
"""

from dataclasses import dataclass, field
from math import ceil
from typing import Any

from padgen.core.registry import COILS, SCHEMES, SUSPENSIONS
from padgen.spec.fields import choice, entry_name, flag, folder_name, numbers, quantity, text

__all__ = [
    "Amplifier",
    "Coil",
    "DriveTable",
    "LimitsTable",
    "Material",
    "Model",
    "MountTable",
    "PadTable",
    "Printer",
    "SoundCard",
    "Spec",
    "Spread",
    "SuspensionTable",
    "TaxelTable",
    "Washer",
]

STRUCTURE_MODELS = ("beam", "solid")
LAYER_SHARE = 1e-6
"""Share of a layer by which a height may exceed whole layers through rounding."""


@dataclass(frozen=True, slots=True)
class PadTable:
    """The printed pad: an active area divided into cells, and a border around it."""

    width_mm: float = quantity(50.0, unit="mm", low=5, high=500, doc="active area along x")
    depth_mm: float = quantity(50.0, unit="mm", low=5, high=500, doc="active area along y")
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
    glue_spread_mg: float = quantity(2.0, unit="mg", low=0, high=1000, doc="spread of the glue from taxel to taxel")
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
    source: str = text("", doc="where the figures come from")


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
    others vary from taxel to taxel.
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
    bed_meshed: bool = flag(True, doc="whether the bed's height is probed (meshed) before every print")
    source: str = text("", doc="where the figures come from")

    @property
    def bed_field_mm(self) -> float:
        """Sigma of the field in mm, for a bed that is meshed or not."""
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
    source: str = text("", doc="where the figures come from")


@dataclass(frozen=True, slots=True)
class Coil:
    """A coil on an optional core, with its top `gap_mm` below the washers of a pad that does not sag.

    `gap_mm` and `reuse` may be left to the search (None, 'auto'); the spec in a plan has the values found.
    """

    name: str = entry_name(doc="name in the catalogue")
    outer_diameter_mm: float = quantity(unit="mm", low=0.5, high=200, doc="outside of the winding")
    inner_diameter_mm: float = quantity(unit="mm", low=0.1, high=199, doc="inside of the winding")
    length_mm: float = quantity(unit="mm", low=0.1, high=500, doc="length of winding and core")
    turns: float = quantity(unit="turns", low=1, high=1e6, doc="turns")
    resistance_ohm: float = quantity(unit="Ω", low=1e-3, high=1e6, doc="resistance")
    inductance_mh: float = quantity(unit="mH", low=0, high=1e5, doc="inductance")
    core_diameter_mm: float = quantity(unit="mm", low=0, high=199, doc="core; 0 is an air core")
    core_relative_permeability: float = quantity(unit="1", low=1, high=1e6, doc="of the core")
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

    @property
    def sets(self) -> int:
        """Number of sets of channels: 2 where coils alternate between two sets, else 1."""
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
    level_law: float = quantity(
        1.0,
        unit="1",
        low=0,
        high=2,
        doc="ON amplitude falls as 1/f^p: 0 equal displacement, 1 velocity, 2 acceleration",
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
    """The model of the resonances and their largest error (docs/accuracy.md)."""

    structure: str = choice(
        "auto",
        of=("auto", *STRUCTURE_MODELS),
        doc="beam, or solid: finite elements of the printed solid; auto takes solid in a build where the beam model's"
        " own error exceeds the tolerance",
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
    def is_fast(self) -> bool:
        """True where the pad is fastened to a base that does not move."""
        fastened = self.kind in ("screwed", "glued")
        return fastened and self.base_mass_g is None and self.stiffness_n_per_m is None


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
        doc="amplitude ratio ON over OFF that is asked for: 10 is 20 dB, 7 is 17, 5 is 14",
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
    washer: Washer = field(kw_only=True)
    coil: Coil = field(kw_only=True)
    amplifier: Amplifier | None = None
    sound_card: SoundCard | None = None
    suspension: SuspensionTable = field(default_factory=SuspensionTable)
    drive: DriveTable = field(default_factory=DriveTable)
    model: Model = field(default_factory=Model)
    limits: LimitsTable = field(default_factory=LimitsTable)
    mount: MountTable = field(default_factory=MountTable)

    @property
    def leaves_layout_free(self) -> bool:
        """True where the search may choose the grid of coils, and with it gap, reuse and drive."""
        return not self.coil.grid and not self.resonances_hz

    @property
    def feeds(self) -> tuple[tuple[str, Amplifier | SoundCard], ...]:
        """The devices between computer and coils that the spec names, each with the word for its kind."""
        named = (("amplifier", self.amplifier), ("sound card", self.sound_card))
        return tuple((word, device) for word, device in named if device is not None)

    @property
    def blocked_by(self) -> str | None:
        """The device that keeps direct current from the coils, as "the AC-coupled ..."; None where none is named."""
        blocking = (f"the AC-coupled {word} {device.name!r}" for word, device in self.feeds if device.coupling == "AC")
        return next(blocking, None)

    @property
    def passing_cure(self) -> dict[str, Any]:
        """The change of the spec, fields by their dotted names, after which every device passes direct current."""
        cure: dict[str, Any] = {
            f"{word.replace(' ', '_')}.coupling": "DC" for word, device in self.feeds if device.coupling == "AC"
        }
        return cure | ({"sound_card.corner_hz": None} if self.corner_hz else {})

    @property
    def corner_hz(self) -> float:
        """Corner in Hz of the high-pass through which the coils are fed; 0 where there is none that is known."""
        return (self.sound_card.corner_hz or 0.0) if self.sound_card else 0.0

    @property
    def recess_depth_mm(self) -> float:
        """Depth in mm of the recess in a plate's underside: washer and glue, rounded up to whole layers."""
        printer = self.printer
        return printer.height_mm(printer.layers_up_to(self.washer.thickness_mm + self.taxel.glue_gap_mm))
