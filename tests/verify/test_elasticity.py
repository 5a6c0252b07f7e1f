"""3-D elasticity of one taxel, and of solids with published modes.

NGSolve and build123d cannot share a process: this one makes STEP files, a child solves them.
"""

import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from padgen.core.errors import SolverError
from padgen.verify.elasticity import (
    CLAMPED,
    PRINTED,
    SETTINGS,
    WASHER,
    Elastic,
    Fineness,
    Mirror,
    Orthotropy,
    SolidModes,
    SolidTaxel,
    _by_settings,
    _drafted,
    accurate,
    assembled_system,
    clamped_shape,
    coarse_mesh,
    converged_modes,
    edge_angles,
    eigenmodes,
    factored,
    layered,
    meshed,
    mirrors_of,
    rigid_loads,
    solve_modes,
    stiffness_pa,
    taxel_shape,
)

REFERENCE = json.loads((Path(__file__).parents[1] / "reference" / "taxel_modes.json").read_text())
POLYMER, STEEL = Elastic(3e9, 0.36, 1240.0), Elastic(200e9, 0.3, 7900.0)
METAL = Elastic(200e9, 0.3, 8000.0)
RING_MM3 = np.pi * (2.0**2 - 1.0**2) * 0.5


def write_steps(folder: Path) -> None:
    """Write the STEP files of taxel_modes.json and some bad ones."""
    import build123d as b

    def block(x0: float, x1: float, width: float, height: float) -> Any:
        return b.Solid.make_box(x1 - x0, width, height, b.Plane((x0, -width / 2, 0)))

    def disc(radius: float, low: float, height: float) -> Any:
        return b.Solid.make_cylinder(radius, height, b.Plane((3.25, 0, low)))

    def export(name: str, *solids: Any) -> None:
        b.export_step(b.Compound(children=list(solids)), folder / f"{name}.step")

    washer = disc(2.0, 0, 0.5).cut(disc(1.0, 0, 0.5))
    plate = block(0, 6.5, 5.0, 1.6).fuse(disc(1.25, 1.6, 1.0)).cut(washer)
    for name, case in {**REFERENCE["cases"], "paper-thin": {"l_mm": 15.0, "w_mm": 1.0, "t_mm": 0.02}}.items():
        printed = block(-case["l_mm"], 0, case["w_mm"], case["t_mm"]).fuse(plate).solids()[0]
        export(name, printed, washer)
        if name == "base":
            export("one", printed)
            export("loose", printed, washer.moved(b.Location((0, 0, -1))))
            export("overlapping", printed, washer.moved(b.Location((0, 0, 0.2))))
            export("large", *(solid.scale(100) for solid in (printed, washer)))


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("steps")
    write_steps(folder)
    return folder


@pytest.fixture(scope="module")
def child() -> Iterator[ProcessPoolExecutor]:
    with ProcessPoolExecutor(1, get_context("spawn")) as solver:
        yield solver


def taxel(steps: Path, name: str, scale: float = 1.0) -> SolidTaxel:
    return SolidTaxel(steps / f"{name}.step", POLYMER, STEEL, RING_MM3 * scale**3, 3.25 * scale, clamp="root")


def off_reference(found: SolidModes, name: str) -> np.ndarray:
    return found.modes.frequency_hz / REFERENCE["cases"][name]["modes_hz"] - 1


def box(x: float, y: float, z: float) -> Any:
    from netgen.occ import Box, Pnt

    solid = Box(Pnt(0, 0, 0), Pnt(x, y, z)).solids[0]
    solid.name = PRINTED
    return solid


def solid_modes(
    solid: Any, material: Elastic, order: int, modes: int, fineness: Fineness, flat: str | None = None
) -> list[float]:
    """Return frequencies in Hz of a solid in mm whose faces have names."""
    from ngsolve import SetNumThreads

    SetNumThreads(1)
    system = assembled_system(meshed(solid, fineness), {PRINTED: material}, order, flat=flat)
    return [float(f) for f in eigenmodes(system, factored(system), modes).frequency_hz]


def bar_modes(material: Elastic, axis: int) -> list[float]:
    """Return the modes of a bar of 8 × 1 × 1 mm along `axis`, clamped at one end."""
    from netgen.occ import X, Y, Z

    sides = [1.0, 1.0, 1.0]
    sides[axis] = 8.0
    solid = box(*sides)
    solid.faces.Min((X, Y, Z)[axis]).name = CLAMPED
    return solid_modes(solid, material, 5, 8, Fineness(levels=0, per_face=2.0))


def plate_modes() -> list[float]:
    from netgen.occ import X

    solid = box(100.0, 100.0, 1.0)
    solid.faces.Min(X).name = CLAMPED
    return solid_modes(solid, METAL, 4, 6, Fineness(levels=0, largest_mm=25.0, per_face=5.0))


def tapered(corners: list[tuple[float, float]]) -> Any:
    """Return the solid between a rectangle at x = 0 and another at x = 1000 mm (widths and heights in mm)."""
    from netgen.occ import Pnt, Segment, ThruSections, Wire

    wires = []
    for x, (width, height) in zip((0.0, 1000.0), corners, strict=True):
        y = width / 2
        z = height / 2
        points = [Pnt(x, -y, -z), Pnt(x, y, -z), Pnt(x, y, z), Pnt(x, -y, z)]
        wires.append(Wire([Segment(points[k - 1], points[k]) for k in range(4)]))
    solid = ThruSections(wires, solid=True).solids[0]
    solid.name = PRINTED
    return solid


def tapered_beam_modes() -> list[float]:
    from netgen.occ import X

    solid = tapered([(40.0, 40.0), (10.0, 10.0)])
    solid.faces.Min(X).name = CLAMPED
    return solid_modes(solid, Elastic(200e9, 0.3, 7800.0), 4, 10, Fineness(levels=0))


def membrane_modes() -> list[float]:
    """Return the modes of the upper half of NAFEMS FV32's membrane, at a hundredth of its size."""
    from netgen.occ import Face, Pnt, Segment, Wire, X, Z

    outline = [(0.0, -25.0), (100.0, -5.0), (100.0, 5.0), (0.0, 25.0)]
    points = [Pnt(x, y, 0.0) for x, y in outline]
    solid = Face(Wire([Segment(points[k - 1], points[k]) for k in range(4)])).Extrude(0.25 * Z).solids[0]
    solid.name = PRINTED
    solid.faces.Min(X).name = CLAMPED
    solid.faces.Min(Z).name = "flat"
    return solid_modes(solid, METAL, 4, 6, Fineness(levels=0, largest_mm=16.0, per_face=5.0), "flat")


@pytest.mark.soak
def test_the_reference_taxel(steps: Path, child: ProcessPoolExecutor) -> None:
    """Taxel `base`: f₁ within 0.1 %, the other modes within 0.5 %; the reference is good to 1e-4."""
    found = child.submit(solve_modes, taxel(steps, "base"), 4, 2).result()
    assert off_reference(found, "base")[0] == pytest.approx(0, abs=1e-3)
    assert off_reference(found, "base") == pytest.approx(0, abs=5e-3)
    assert found.modes.working == 0


def test_frequencies_fall_to_the_reference(steps: Path, child: ProcessPoolExecutor) -> None:
    """A finer conforming space is softer: frequencies fall with the order on one mesh, never below the reference."""
    off = [off_reference(child.submit(solve_modes, taxel(steps, "base"), p, 1).result(), "base") for p in (2, 3, 4)]
    for coarse, fine in pairwise(off):
        assert (fine < coarse).all()
    assert (off[-1] > -2e-4).all()
    # The working mode's error falls by two at least with each order, until layers bound it.
    assert off[1][0] < off[0][0] / 2


@pytest.mark.parametrize("name", ["base", "slender", "foil"])
def test_the_estimate_holds(steps: Path, child: ProcessPoolExecutor, name: str) -> None:
    """The true error of the working mode is at most the estimate, and that 0.1 %; the reference is good to 1.5e-5."""
    found = child.submit(converged_modes, taxel(steps, name), 1e-2).result()
    error = abs(off_reference(found, name)[0])
    assert error - 1.5e-5 <= found.working_error <= 1e-3


def whole_and_half(given: SolidTaxel) -> tuple[tuple[Mirror, ...], SolidModes, SolidModes]:
    """Return the planes of symmetry of a taxel, its modes, and those of the half beside them."""
    draft = _drafted(given)
    mirrors = mirrors_of(draft.shape, given.washer_x_mm)
    found = [_by_settings(given, one, SETTINGS[:1], 0, 3, 1.0) for one in (draft, _drafted(given, mirrors))]
    return mirrors, found[0], found[1]


def test_half_of_a_symmetric_taxel_has_its_modes(steps: Path, child: ProcessPoolExecutor) -> None:
    """Modes and compliances of the half are the whole's, on another mesh: within 0.1 % and 0.4 %."""
    mirrors, whole, half = child.submit(whole_and_half, taxel(steps, "base")).result()
    assert mirrors == (Mirror(1, 0.0),)
    hz, other = (found.modes.frequency_hz[found.modes.working] for found in (whole, half))
    assert other == pytest.approx(hz, rel=1e-3)
    even = [0, 2, 4]  # forces along x and z, and the moment about y
    for found in (whole, half):
        bent = found.modes.motion / (2 * np.pi * found.modes.frequency_hz[:, None])
        found.modes.rest[:] += bent.T @ bent
    mesh = np.ix_(even, even)
    assert half.modes.rest[mesh] == pytest.approx(whole.modes.rest[mesh], rel=4e-3, abs=1e-12)
    assert not half.modes.motion[:, [1, 3, 5]].any()
    assert half.unknowns < 0.7 * whole.unknowns


def test_the_half_takes_over_where_the_whole_is_not_good_enough(steps: Path, child: ProcessPoolExecutor) -> None:
    """A finer setting of the half lowers the working mode's error; the other modes stay as the whole has them."""
    first = child.submit(converged_modes, taxel(steps, "base"), 1.0).result()
    found = child.submit(converged_modes, taxel(steps, "base"), 0.9 * first.working_error).result()
    assert found.setting > 0
    assert found.working_error < 0.9 * first.working_error
    error = abs(off_reference(found, "base")[0])
    assert error - 1.5e-5 <= found.working_error
    others = np.arange(6) != found.modes.working
    assert (found.modes.frequency_hz == first.modes.frequency_hz)[others].all()


def lowest_hz(step: Path, order: int, share: float) -> float:
    """Return f₁ with a `share` of the elements of `order`, and the others of order 2."""
    mesh = meshed(clamped_shape(taxel_shape(step, RING_MM3), "root"), Fineness(levels=1))
    rich = np.arange(mesh.ne) < share * mesh.ne
    system = assembled_system(mesh, {PRINTED: POLYMER, WASHER: STEEL}, order, rich=rich)
    return float(eigenmodes(system, factored(system), 1).frequency_hz[0])


def test_elements_of_mixed_order_make_a_space_between(steps: Path, child: ProcessPoolExecutor) -> None:
    """The spaces are nested, so frequencies fall; without elements of higher order the space is order 2's."""
    plain, none, some, all_of_them = (
        child.submit(lowest_hz, steps / "base.step", *case).result()
        for case in ((2, 1.0), (3, 0.0), (3, 0.5), (3, 1.0))
    )
    assert none == pytest.approx(plain, rel=1e-9)
    assert none > some > all_of_them > 0.9 * none


def test_modes_and_rest_give_the_static_compliance(steps: Path, child: ProcessPoolExecutor) -> None:
    """Modes and rest add up to the same static answer for any number of modes, within the solver's 1e-6."""
    whole = []
    for modes in (2, 6):
        found = child.submit(solve_modes, taxel(steps, "base"), 2, 0, modes).result().modes
        assert found.motion.shape == (modes, 6)
        part = found.motion.T @ (found.motion / (2 * np.pi * found.frequency_hz[:, None]) ** 2)
        whole.append(part + found.rest)
    assert whole[0] == pytest.approx(whole[1], rel=1e-5, abs=1e-6 * np.abs(whole[1]).max())


def test_glue_rides_on_the_washer(steps: Path, child: ProcessPoolExecutor) -> None:
    """df/f = −½ φ² dm to first order, with φ the washer's mass-normalised motion: 2 mg within 2 % of the shift."""
    bare, glued = (
        child.submit(solve_modes, taxel(steps, "base")._replace(glue_kg=kg), 2, 1).result().modes for kg in (0.0, 1e-8)
    )
    # The glue also turns with the washer about its own centre, z = 0.25 mm: the shift is 1 to 4 % larger.
    rise = bare.motion[0, :3] + np.cross(bare.motion[0, 3:], [0, 0, 0.25e-3])
    expected = -0.5e-8 * float(rise @ rise)
    assert glued.frequency_hz[0] / bare.frequency_hz[0] - 1 == pytest.approx(expected, rel=0.05)


def test_a_hundred_times_the_size(steps: Path, child: ProcessPoolExecutor) -> None:
    """Frequencies go with 1/length; the meshes differ a little."""
    small = child.submit(solve_modes, taxel(steps, "base"), 2, 1).result().modes
    large = child.submit(solve_modes, taxel(steps, "large", 100.0), 2, 1).result().modes
    assert large.frequency_hz[0] * 100 == pytest.approx(small.frequency_hz[0], rel=2e-3)


def rounding(step: Path, order: int) -> list[bool]:
    """Return whether blocks, then single components, keep the softest direction through rounding."""
    mesh = meshed(clamped_shape(taxel_shape(step, RING_MM3), "root"), Fineness(levels=0, per_face=100.0))
    kept = []
    for blocks in (True, False):
        system = assembled_system(mesh, {PRINTED: POLYMER, WASHER: STEEL}, order, blocks=blocks)
        solve = factored(system)
        loads = rigid_loads(system, WASHER, 7900.0, 3.25)
        kept.append(accurate(system, solve, loads, np.array([solve(load) for load in loads.T]).T))
    return kept


def test_rounding_is_noticed(steps: Path, child: ProcessPoolExecutor) -> None:
    """With blocks a foil's answer is wrong by 90 % and the solver silent; with single components it is right."""
    assert child.submit(rounding, steps / "foil.step", 2).result() == [False, True]
    assert child.submit(rounding, steps / "base.step", 2).result() == [True, True]


def test_bars_along_and_across_the_layers(child: ProcessPoolExecutor) -> None:
    """Without Poisson's ratio the axial mode is sin(πx/2l) exactly, with f = √(E/ρ)/4l of the bar's own axis.

    Order 5 on 8 × 1 × 1 mm resolves a quarter wave to 1e-6.
    """
    axes = Orthotropy((3e9, 2.8e9, 1.8e9), (0.9e9, 0.95e9, 1.1e9), (0.0, 0.0, 0.0))
    layered = Elastic(0.0, 0.0, 1240.0, axes)
    for axis in (0, 2):
        expected = np.sqrt(axes.modulus_pa[axis] / 1240.0) / (4 * 8e-3)
        found = np.array(child.submit(bar_modes, layered, axis).result())
        assert np.abs(found / expected - 1).min() < 1e-6


def test_orthotropy_of_equal_axes_is_isotropy(child: ProcessPoolExecutor) -> None:
    shear = 3e9 / 2 / 1.36
    same = POLYMER._replace(axes=Orthotropy((3e9,) * 3, (shear,) * 3, (0.36,) * 3))
    assert stiffness_pa(same) == pytest.approx(stiffness_pa(POLYMER), rel=1e-12)
    one, other = (child.submit(bar_modes, material, 0).result() for material in (POLYMER, same))
    assert other == pytest.approx(one, rel=1e-8)


def test_a_square_cantilever_plate(child: ProcessPoolExecutor) -> None:
    """VPCS SDLS01, Barton 1951: λ² = 2πf a² √(ρh/D).

    His Ritz values are up to 0.7 % high; a thickness of a/100 costs 0.2 %.
    """
    flexural = METAL.modulus_pa * 1e-9 / 12 / (1 - 0.3**2)
    scale = 2 * np.pi * 0.1**2 * np.sqrt(METAL.density_kg_per_m3 * 1e-3 / flexural)
    found = np.array(child.submit(plate_modes).result()) * scale
    assert found == pytest.approx([3.492, 8.525, 21.43, 27.33, 31.11, 54.44], rel=0.01)


def test_a_tapered_cantilever(child: ProcessPoolExecutor) -> None:
    """VPCS SDLL09, Mabie and Rogers 1972, with λ of the tip's section.

    A solid is softer in shear: by 0.1 % in the first mode, rising with (kh)² to 2 % in the fourth. Each mode comes
    twice, up and sideways.
    """
    scale = 2 * np.pi / (np.sqrt(200e9 / 7800) * 0.01 / np.sqrt(12))
    found = np.array(child.submit(tapered_beam_modes).result()) * scale
    assert found[:8:2] == pytest.approx(found[1:8:2], rel=1e-3)
    expected = np.array([23.289, 73.9, 165.23, 299.7])
    assert found[0] == pytest.approx(expected[0], rel=2e-3)
    assert found[:8:2] == pytest.approx(expected, rel=0.02)


def test_a_tapered_membrane(child: ProcessPoolExecutor) -> None:
    """NAFEMS FV32; at a hundredth of the size frequencies are a hundred times as high.

    Finer meshes of order 4 settle within 0.06 % of all six modes; this one is allowed 0.2 %.
    """
    found = np.array(child.submit(membrane_modes).result()) / 100
    assert found == pytest.approx([44.623, 130.03, 162.70, 246.05, 379.90, 391.44], rel=2e-3)


def angles_of(step: Path) -> list[float]:
    return sorted(round(angle) for angle in edge_angles(coarse_mesh(taxel_shape(step, RING_MM3))).values())


def test_reentrant_edges_are_found(steps: Path, child: ProcessPoolExecutor) -> None:
    """Taxel `base` has four edges of 270°: three where the beam meets the plate, and the circle under the boss."""
    angles = child.submit(angles_of, steps / "base.step").result()
    assert [angle for angle in angles if angle > 190] == [270] * 4


@pytest.mark.parametrize(
    ("name", "change", "sentence"),
    [
        ("missing", {}, "cannot be read as STEP"),
        ("one", {}, "must hold two solids"),
        ("loose", {}, "does not touch"),
        ("overlapping", {}, "overlap"),
        ("base", {"washer_volume_mm3": 9.9}, "washer of 9.9 mm³, holds"),
    ],
)
def test_what_cannot_be_solved(
    steps: Path, child: ProcessPoolExecutor, name: str, change: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(SolverError, match=sentence):
        child.submit(solve_modes, taxel(steps, name)._replace(**change), 2, 0).result()


def test_refusals_call_a_taxel_by_its_name(steps: Path, child: ProcessPoolExecutor) -> None:
    """A message names the taxel, since its file may lie in a folder that is gone when the message is read."""
    lost = taxel(steps, "base")._replace(washer_volume_mm3=1.0)
    for one, where in ((lost, str(lost.step)), (lost._replace(name="my-pad, channel 3"), "my-pad, channel 3")):
        with pytest.raises(SolverError) as refused:
            child.submit(solve_modes, one, 2, 0).result()
        assert str(refused.value).startswith(f"{where}: must hold two solids, printed part and washer")


def test_a_file_that_is_no_step(tmp_path: Path, child: ProcessPoolExecutor) -> None:
    (tmp_path / "empty.step").write_text("")
    with pytest.raises(SolverError, match="STEP"):
        child.submit(solve_modes, taxel(tmp_path, "empty"), 2, 0).result()


@pytest.mark.soak
def test_a_print_in_layers_is_softer_across_them():
    """By its own entries the compliance is 1/ratio as large across the layers, and unchanged along them."""
    plain = Elastic(3e9, 0.36, 1240.0)
    assert layered(plain, 1.0) == plain
    soft, same = (np.linalg.inv(stiffness_pa(m)) for m in (layered(plain, 0.6), plain))
    assert soft[:2, :2] == pytest.approx(same[:2, :2])
    assert soft[2, 2] == pytest.approx(same[2, 2] / 0.6)
    assert soft[0, 2] == pytest.approx(same[0, 2])
    assert np.diag(soft)[3:] == pytest.approx(np.diag(same)[3:] / [0.6, 0.6, 1.0])
