"""Print the tables of docs/accuracy.md on the whole pad: reduction against one mesh, shifts and bounds, growth.

Run ``OPENBLAS_NUM_THREADS=1 python docs/measure_pad.py [full|shifts|large]``; seconds are processor time,
imports excluded. ``full`` meshes 2 x 2 cells as one solid and takes a few minutes and 4 GB.
"""

import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from padgen.planner import Plan, make_plan
from padgen.planner.frame_give import flexibility_bounds
from padgen.spec import load_spec, parse_spec
from padgen.verify.elastic_mesh import Fineness, meshed
from padgen.verify.elastic_modes import assembled, energy
from padgen.verify.pad_interface import Degrees
from padgen.verify.pad_modes import PadModes, crosstalk, driven_taxels, frequency_shifts, pad_modes
from padgen.verify.pad_reduction import ReducedPad, Resolution, pad_materials, reduced_pad
from padgen.verify.pad_solids import CLAMPINGS, TURNS, border_corner, border_side, taxel_tile
from padgen.verify.pad_tiles import Elements

SMALL = """
name = "two-by-two"
resolution = 8
band_hz = [50, 200]
q_min = 15
resonances_hz = [56, 76]
pad = { width_mm = 25, depth_mm = 25 }
coil = { grid = [2, 2] }
suspension = { topology = "cantilever", tune = "width" }
"""
TEMPLATES = ("paper-16", "paper-32", "quad-64", "resin-fine")
MESH = Fineness(levels=0, largest_mm=4.0, grading=0.5, curvature=2.0, per_edge=1.0)
"""The coarsest that Netgen meshes the whole pad with."""
HIGHEST_HZ = 245.0


def write_steps(plan: Plan, folder: Path) -> dict[int, Path]:
    """The taxels' STEP files; in a process of its own, for the CAD kernel and the engine do not mix."""
    from padgen.solid.formats.step import write_taxel_step

    paths = {channel.index: folder / f"{plan.name}-{channel.index}.step" for channel in plan.channels}
    for channel in plan.channels:
        write_taxel_step(plan, channel, paths[channel.index])
    return paths


def steps_of(plan: Plan, folder: Path) -> dict[int, Path]:
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(write_steps, plan, folder).result()


def placed(tile: Any, quarters: int, x: float, y: float) -> Iterator[Any]:
    """A tile's solids turned and moved so that its centre comes to (x, y)."""
    from netgen.occ import Axis, Z

    box = tile.box
    for solid in tile.shape.solids:
        moved = solid.Move((-(box.x0 + box.x1) / 2, -(box.y0 + box.y1) / 2, 0))
        moved = moved.Rotate(Axis((0, 0, 0), Z), 90 * quarters) if quarters else moved
        for part in moved.Move((x, y, 0)).solids:
            part.name = solid.name
            for face in part.faces:
                face.name = "default"
            yield part


def border(plan: Plan) -> Iterator[Any]:
    pad, coils, cell = plan.spec.pad, plan.coils, plan.cell
    off_x, off_y = (pad.width_mm + pad.border_mm) / 2, (pad.depth_mm + pad.border_mm) / 2
    for quarters, x, y in ((0, -1, -1), (1, 1, -1), (2, 1, 1), (3, -1, 1)):
        yield from placed(border_corner(plan, "free"), quarters, x * off_x, y * off_y)
    for k in range(coils.columns * cell.columns):
        x = (k + 0.5) * cell.width_mm - pad.width_mm / 2
        for quarters, y in ((0, -off_y), (2, off_y)):
            yield from placed(border_side(plan, True, "free"), quarters, x, y)
    for k in range(coils.rows * cell.rows):
        y = (k + 0.5) * cell.depth_mm - pad.depth_mm / 2
        for quarters, x in ((0, -off_x), (2, off_x)):
            yield from placed(border_side(plan, False, "free"), quarters, x, y)


def whole_solid(plan: Plan, steps: dict[int, Path], clamping: str) -> Any:
    """All tiles glued; washers are named ``washer0``, ``washer1``, … in the order of the plan's taxels."""
    from netgen.occ import Glue

    solids = list(border(plan))
    for number, taxel in enumerate(plan.taxels):
        channel = plan.channels[taxel.channel]
        centre = np.array(channel.site.centre_mm) * (-1 if taxel.turned else 1)
        coil = (np.array(taxel.coil[::-1]) - (np.array([plan.coils.columns, plan.coils.rows]) - 1) / 2) * np.array(
            [plan.coils.pitch_x_mm, plan.coils.pitch_y_mm]
        )
        quarters = (TURNS[channel.site.along] + 2 * taxel.turned) % 4
        for solid in placed(taxel_tile(plan, channel, steps[channel.index], "free"), quarters, *(coil + centre)):
            solid.name = f"washer{number}" if solid.name == "washer" else solid.name
            solids.append(solid)
    shape = Glue(solids)
    hole, half = plan.spec.pad.hole_diameter_mm, plan.spec.pad
    corner = np.array([half.width_mm + half.border_mm, half.depth_mm + half.border_mm]) / 2
    for face in shape.faces if clamping == "corners" else ():
        low, high = (np.array([p.x, p.y, p.z]) for p in face.bounding_box)
        if np.allclose((high - low)[:2], hole, atol=1e-3) and np.allclose(abs(low + high)[:2] / 2, corner, atol=1e-3):
            face.name = "held"
    return shape


def whole_response(plan: Plan, steps: dict[int, Path], clamping: str, order: int, modes: int) -> tuple[Any, ...]:
    """Frequencies (k,), washers' motion (taxels, k) and static rest (taxels, taxels) of the pad in one mesh."""
    import ngsolve as ngs
    from scipy.sparse.linalg import LinearOperator, eigsh

    mesh = meshed(whole_solid(plan, steps, clamping), MESH)
    base = pad_materials(plan)
    materials = {name: base["washer" if name.startswith("washer") else "printed"] for name in set(mesh.GetMaterials())}
    system = assembled(mesh, materials, order, "held")
    shift = (2 * np.pi * 60) ** 2
    u, v = system.space.TnT()
    form = ngs.BilinearForm(system.space, symmetric=True)
    for name, material in materials.items():
        inertia = shift * 1e-9 * material.density_kg_per_m3 * ngs.InnerProduct(u, v)
        form += (energy(material, u, v) + inertia) * ngs.dx(definedon=mesh.Materials(name))
    form.Assemble()
    inverse = form.mat.Inverse(system.space.FreeDofs(), "sparsecholesky")
    into, out = form.mat.CreateColVector(), form.mat.CreateColVector()

    def solve(load: np.ndarray) -> np.ndarray:
        into.FV().NumPy()[:] = np.ravel(load)
        out.data = inverse * into
        return np.array(out.FV().NumPy())

    shape = (system.free.size,) * 2
    mass = LinearOperator(shape, lambda x: system.mass_times(np.ravel(x) * system.free), dtype=float)
    inverted = LinearOperator(shape, solve, dtype=float)
    square, vectors = eigsh(mass, modes, M=mass, sigma=-shift, OPinv=inverted, tol=1e-8)
    vectors /= np.sqrt(np.einsum("ik,ik->k", vectors, system.mass_times(vectors)))
    loads = np.array([washer_load(system.space, f"washer{k}") for k in range(len(plan.taxels))])
    motion = loads @ vectors
    rest = loads @ np.array([solve(load) for load in loads]).T - motion / (square + shift) @ motion.T
    return np.sqrt(np.maximum(square, 0)) / (2 * np.pi), motion, rest, int(system.free.sum())


def washer_load(space: Any, name: str) -> np.ndarray:
    """Load of 1 N upwards, spread over a washer."""
    import ngsolve as ngs

    on = ngs.dx(definedon=space.mesh.Materials(name))
    form = ngs.LinearForm(space)
    form += space.TestFunction()[2] * on
    form.Assemble()
    return np.array(form.vec.FV().NumPy()) / ngs.Integrate(ngs.CoefficientFunction(1) * on, space.mesh)


def against_one_mesh(folder: Path) -> Iterator[str]:
    plan = make_plan(parse_spec(SMALL))
    steps = steps_of(plan, folder)
    yield "| clamping | order | degrees | worst frequency % | shift of peak % | crosstalk: level dB, difference dB |"
    yield "|---|---|---|---|---|---|"
    for clamping, order in (("free", 3), ("corners", 4)):
        frequency, motion, rest, _ = whole_response(plan, steps, clamping, order, 26 if clamping == "free" else 20)
        for degrees in (Degrees(3, 1), Degrees(5, 2), Degrees(6, 3)):
            pad = reduced_pad(plan, steps, clamping, Resolution(degrees, Elements(order, MESH)))
            modes = pad_modes(pad, HIGHEST_HZ)
            count = min(len(frequency), len(modes.frequency_hz))
            real = frequency[:count] > 1
            off = np.abs(modes.frequency_hz[:count][real] / frequency[:count][real] - 1).max()
            levels, peaks = compared(pad, modes, frequency, motion, rest)
            yield f"| {clamping} | {order} | {tuple(degrees)} | {100 * off:.2f} | {100 * peaks:.2f} | {levels} |"


def compared(
    pad: ReducedPad, modes: PadModes, frequency: np.ndarray, motion: np.ndarray, rest: np.ndarray
) -> tuple[str, float]:
    """Levels of the driven taxels' neighbours with the difference, loudest first, and the peak's difference."""
    found, worst = [], 0.0
    for driven, one in zip(driven_taxels(pad), crosstalk(pad, modes), strict=True):
        q = pad.plan.channels[pad.plan.taxels[driven].channel].q
        hertz = one.resonance_hz * np.linspace(0.99, 1.01, 201)
        loss = (2 * np.pi * frequency) ** 2 * (1 + 1j / q)
        answer = [np.abs(motion[driven] / (loss - (2 * np.pi * f) ** 2) @ motion.T + rest[driven]) for f in hertz]
        at = int(np.argmax([row[driven] for row in answer]))
        worst = max(worst, abs(hertz[at] / one.resonance_hz - 1))
        level = 20 * np.log10(answer[at][driven] / answer[at])
        found += [(level[k], one.below_db[k] - level[k]) for k in range(len(level)) if k != driven]
    return ", ".join(f"{level:.0f} ({off:+.2f})" for level, off in sorted(found)), worst


def shifts(folder: Path) -> Iterator[str]:
    yield "| template | clamping | channel | shift % lowest, mean, highest | bound % | loudest neighbour dB |"
    yield "|---|---|---|---|---|---|"
    for name in TEMPLATES:
        plan = make_plan(load_spec(name))
        steps = steps_of(plan, folder)
        before: ReducedPad | None = None
        for clamping in CLAMPINGS:
            pad = reduced_pad(plan, steps, clamping, Resolution(elements=Elements(3)), before)
            before = before or pad
            modes = pad_modes(pad)
            bounds = flexibility_bounds(plan, clamping)
            for shift, one in zip(frequency_shifts(pad, modes), crosstalk(pad, modes), strict=True):
                share = ", ".join(f"{100 * v:+.3f}" for v in (shift.lowest, shift.mean, shift.highest))
                loudest = one.below_db[one.below_db > 0].min()
                bound = 100 * bounds[shift.channel]
                yield f"| {name} | {clamping} | {shift.channel} | {share} | {bound:.2f} | {loudest:.1f} |"


def large(folder: Path) -> Iterator[str]:
    plan = make_plan(load_spec("big-512"))
    steps = steps_of(plan, folder)
    yield "| 16 x 16 cells | degrees | unknowns | tiles s | modes | s | crosstalk s | frame's own modes Hz |"
    yield "|---|---|---|---|---|---|---|---|"
    for degrees in (Degrees(3, 1), Degrees(5, 2)):
        times = [time.process_time()]
        pad = reduced_pad(plan, steps, "corners", Resolution(degrees, Elements(3)))
        times.append(time.process_time())
        modes = pad_modes(pad, accuracy=1e-3)
        times.append(time.process_time())
        crosstalk(pad, modes)
        times.append(time.process_time())
        seconds = np.diff(times)
        frame = ", ".join(f"{f:.0f}" for f in modes.frame_hz)
        yield (
            f"| corners | {tuple(degrees)} | {pad.assembly.size} | {seconds[0]:.1f} | {len(modes.frequency_hz)}"
            f" | {seconds[1]:.1f} | {seconds[2]:.1f} | {frame} |"
        )


def main() -> None:
    tables = {"full": against_one_mesh, "shifts": shifts, "large": large}
    asked = sys.argv[1:] or list(tables)
    with tempfile.TemporaryDirectory() as folder:
        for name in asked:
            for line in tables[name](Path(folder)):
                print(line, flush=True)
            print()


if __name__ == "__main__":
    main()
