"""Print the table of docs/accuracy.md on beams that stretch: bridges by geometrically non-linear finite elements.

Run ``python docs/measure_stretching.py``. The solid is the taxel's STEP file with a St. Venant-Kirchhoff material,
third-order elements, pulled at its washer; Newton's method in steps of the load.
"""

import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
import padgen as pg
from padgen.make.solid_tuning import solid_taxel
from padgen.planner.plan import Channel, Plan
from padgen.solid.formats.step import write_taxel_step

ORDER = 3
NEWTON = 12
SMALL = 1e-10
SPECS: tuple[dict[str, Any], ...] = (
    {"resonances_hz": [70, 120]},
    {"resonances_hz": [180, 370]},
    {"resonances_hz": [100, 200], "material": "tough-resin", "printer": "resin-0.05"},
)


def planned(changes: dict[str, Any]) -> Plan:
    return pg.plan(
        {
            "name": "bridge",
            "resolution": 16,
            "band_hz": [50, 400],
            "q_min": 15,
            "suspension": {"topology": "bridge"},
            **changes,
        }
    )


def secants(taxel: Any, forces_n: list[float]) -> list[tuple[float, float]]:
    """Return the washer's displacement in m and secant stiffness in N/m under each force, in a process of its own."""
    import ngsolve as ngs

    from padgen.verify.elasticity import CLAMPED, PRINTED, WASHER, clamped_shape, coarse_mesh, taxel_shape

    shape = clamped_shape(taxel_shape(taxel.step, taxel.washer_volume_mm3), taxel.clamp)
    mesh = ngs.Mesh(coarse_mesh(shape))
    mesh.Curve(ORDER)
    space = ngs.VectorH1(mesh, order=ORDER, dirichlet=CLAMPED)
    u = space.TrialFunction()
    where = mesh.Materials(WASHER)
    volume = ngs.Integrate(1, mesh, definedon=where)
    deform = ngs.Id(3) + ngs.Grad(u)
    strain = 0.5 * (deform.trans * deform - ngs.Id(3))
    pull = ngs.Parameter(0.0)
    form = ngs.BilinearForm(space, symmetric=True)
    for name, material in taxel.materials.items():
        # MPa and mm: newtons.
        e = material.modulus_pa * 1e-6
        nu = material.poisson
        shear = e / 2 / (1 + nu)
        lame = e * nu / (1 + nu) / (1 - 2 * nu)
        square = shear * ngs.InnerProduct(strain, strain) + lame / 2 * ngs.Trace(strain) ** 2
        form += ngs.Variation(square * ngs.dx(definedon=mesh.Materials(name)))
    form += ngs.Variation(-pull / volume * u[2] * ngs.dx(definedon=where))
    found = ngs.GridFunction(space)
    residual = None
    step = None
    result = []
    assert PRINTED in taxel.materials
    for force in forces_n:
        pull.Set(force)
        for _ in range(NEWTON):
            residual = found.vec.CreateVector()
            step = found.vec.CreateVector()
            form.Apply(found.vec, residual)
            form.AssembleLinearization(found.vec)
            step.data = form.mat.Inverse(space.FreeDofs(), inverse="sparsecholesky") * residual
            found.vec.data -= step
            if abs(ngs.InnerProduct(step, residual)) < SMALL * force**2 * 1e-3:
                break
        moved_m = ngs.Integrate(found[2], mesh, definedon=where) / volume * 1e-3
        result.append((moved_m, force / moved_m))
    return result


def rows(plan: Plan, channel: Channel) -> list[str]:
    k = channel.stiffness_n_per_m
    alpha = channel.hardening_per_mm2 * 1e6
    levels = [1e-6, 33e-6, 87e-6, 150e-6]
    forces = [k * z * (1 + alpha * z**2) for z in levels]
    with tempfile.TemporaryDirectory() as folder:
        step = Path(folder, "taxel.step")
        write_taxel_step(plan, channel, step)
        taxel = solid_taxel(plan, channel, step)
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            found = pool.submit(secants, taxel, forces).result()
    out = []
    beam = channel.beam
    first = found[0][1]
    for moved, secant in found[1:]:
        by_beam = 1 + alpha * moved**2
        out.append(
            f"| {beam.width_mm:.3f} x {beam.thickness_mm:.2f} x {beam.length_mm:.2f} | {channel.resonance_hz:.1f} |"
            f" {moved * 1e6:.1f} | {secant:.2f} | {secant / first:.4f} | {by_beam:.4f} |"
            f" {100 * (by_beam * first / secant - 1):+.2f} |"
        )
    return out


def main() -> None:
    print("| beams w x t x l mm | Hz | moved µm | secant N/m by FE | over small motion | 1 + α z² | off % |")
    print("|---|---|---|---|---|---|---|")
    for changes in SPECS:
        plan = planned(changes)
        for channel in plan.channels:
            print("\n".join(rows(plan, replace(channel))), flush=True)


if __name__ == "__main__":
    main()
