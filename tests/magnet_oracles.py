"""Oracles for the pull on magnets: turns of wire in the field of magpylib's magnets, and fields by finite elements.

magpylib (BSD-3-Clause) has the field of cylinders in closed form. NGSolve solves fields with cores; a magnet is there a
body of permeability 1 within which the source field has its magnetisation.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss

from padgen.core.units import MM
from padgen.physics.magnetics import MU_0, CoilSource, SteelRing, Winding
from padgen.physics.magnets import DiscMagnet


class Case(NamedTuple):
    """A coil, a magnet and its place in m."""

    coil: CoilSource
    magnet: DiscMagnet
    gap: float
    offset: float


def random_cases(count: int, seed: int, core: bool) -> list[Case]:
    """Return random magnets, one in four a ring, over random coils, without a core one in three flat as on boards."""
    rng = np.random.default_rng(seed)
    cases = []
    while len(cases) < count:
        outer = rng.uniform(4, 20) * MM
        inner = outer * rng.uniform(0.15, 0.8)
        turns = float(np.round(10 ** rng.uniform(1, 3.2)))
        if rng.random() < 1 / 3 and not core:
            layers = int(rng.integers(1, 7))
            pitch = rng.uniform(0.1, 0.5) * MM
            each = turns / layers
            windings = tuple(Winding(outer, inner, -n * pitch, -n * pitch - 0.035 * MM, each) for n in range(layers))
        else:
            windings = (Winding(outer, inner, 0.0, -rng.uniform(1, 20) * MM, turns),)
        coil = CoilSource(windings)
        if core:
            length = windings[0].length * rng.uniform(0.8, 1.3)
            recess = rng.choice([0.0, rng.uniform(0, 1) * MM])
            thick = inner * min(rng.uniform(0.5, 1), 0.98)  # slivers of air beside a core mesh badly
            coil = CoilSource(windings, thick, length, 10 ** rng.uniform(0.7, 3.5), -recess)
        wide = rng.uniform(1, 8) * MM
        hole = wide * rng.uniform(0.2, 0.7) if rng.random() < 0.25 else 0.0
        magnet = DiscMagnet(wide, hole, rng.uniform(0.5, 4) * MM, rng.uniform(1.0, 1.45))
        gap = 10 ** rng.uniform(np.log10(0.3), np.log10(5)) * MM
        offset = rng.choice([0.0, rng.uniform(0, 1) * outer])
        cases.append(Case(coil, magnet, gap, float(offset)))
    return cases


def _magpylib_field(magnet: DiscMagnet, points: np.ndarray) -> np.ndarray:
    """Return B (n, 3) in T at points (n, 3) in m from the middle of the magnet's underside."""
    from magpylib.magnet import Cylinder

    total = np.zeros_like(points)
    for diameter, sign in ((magnet.outer_diameter, 1), (magnet.inner_diameter, -1)):
        if diameter > 0:
            body = Cylinder(
                polarization=(0, 0, sign * magnet.polarisation),
                dimension=(diameter, magnet.height),
                position=(0, 0, magnet.height / 2),
            )
            total += body.getB(points)
    return total


def force_on_turns(case: Case, fineness: int = 1) -> np.ndarray:
    """Return pull, side force and moment (3,) per ampere as `MagnetPull`, from the force of the magnet on all turns."""
    total = np.zeros(3)
    angle = (np.arange(48 * fineness) + 0.5) * np.pi / (48 * fineness)  # the other half is its mirror image
    cosine = np.cos(angle)
    for winding in case.coil.windings:
        thick = winding.length > 1e-4
        across, weight_across = leggauss(10 * fineness)
        along, weight_along = leggauss(10 * fineness if thick else 1)
        inner, outer = winding.inner_diameter / 2, winding.outer_diameter / 2
        radius = inner + (outer - inner) * (across + 1) / 2
        height = winding.bottom + winding.length * (along + 1) / 2
        weight = (
            winding.turns * np.multiply.outer(weight_across / 2 * 2 * np.pi * radius, weight_along / 2) / len(angle)
        )
        r, z, c = np.meshgrid(radius, height, cosine, indexing="ij")
        s = np.broadcast_to(np.sin(angle), c.shape)
        points = np.stack([r * c - case.offset, r * s, z - case.gap], -1)
        b_x, b_y, b_z = np.moveaxis(_magpylib_field(case.magnet, points.reshape(-1, 3)).reshape(points.shape), -1, 0)
        # Of dl × B on the turns, along x and z; the magnet has the opposite.
        upwards = weight * (b_x * c + b_y * s).sum(-1)
        sideways = -weight * (c * b_z).sum(-1)
        arm = weight * (points[..., 0] * (b_x * c + b_y * s)).sum(-1)
        moment = sideways * (height - case.gap) - arm
        total += [-upwards.sum(), sideways.sum(), moment.sum()]
    return total


def flux_linkage(case: Case, gap: float) -> float:
    """Return the flux in Wb of the magnet, `gap` m above the coil, through all of its turns, by magpylib."""
    node, weight = leggauss(32)
    angle = (np.arange(64) + 0.5) * np.pi / 64
    flux = 0.0
    for winding in case.coil.windings:
        inner, outer = winding.inner_diameter / 2, winding.outer_diameter / 2
        height = winding.bottom + winding.length * (node + 1) / 2
        for low, high in ((0.0, inner), (inner, outer)):
            radius = low + (high - low) * (node + 1) / 2
            enclosing = np.clip((outer - radius) / (outer - inner), 0, 1)  # share of the turns that enclose this radius
            r, z, a = np.meshgrid(radius, height, angle, indexing="ij")
            points = np.stack([r * np.cos(a) - case.offset, r * np.sin(a), z - gap], -1)
            b_z = _magpylib_field(case.magnet, points.reshape(-1, 3))[:, 2].reshape(r.shape).mean(-1)
            area = np.pi * radius * (high - low) * weight
            flux += winding.turns * float((area * enclosing) @ b_z @ weight / 2)
    return flux


def magnets_force(magnet: DiscMagnet, apart: np.ndarray, fineness: int = 1) -> np.ndarray:
    """Return the force (3,) in N on a magnet at `apart` (3,) in m from an equal one, by the field on its faces."""
    node, weight = leggauss(12 * fineness)
    inner, outer = magnet.inner_diameter / 2, magnet.outer_diameter / 2
    angle = (np.arange(48 * fineness) + 0.5) * 2 * np.pi / (48 * fineness)
    radius = inner + (outer - inner) * (node + 1) / 2
    area = np.repeat(np.pi * radius * (outer - inner) * weight, len(angle)) / len(angle)
    x, y = (np.multiply.outer(radius, wave).ravel() for wave in (np.cos(angle), np.sin(angle)))
    total = np.zeros(3)
    for z, sign in ((magnet.height, 1), (0.0, -1)):
        points = np.stack([x, y, np.full_like(x, z)], -1) + apart
        total += sign * magnet.polarisation / MU_0 * area @ _magpylib_field(magnet, points)
    return total


def _magnetised(
    mesh: Any, coil: CoilSource, current: float, magnets: dict[str, float], height: Any, radius: Any
) -> Any:
    """Return T_z in A/m of a current in A and of magnets by the names of their bodies, with their polarisation in T."""
    from padgen.verify.field_solid import winding_source

    within = {name: polarisation / MU_0 for name, polarisation in magnets.items()}
    return winding_source(coil, current, radius, height)[0] + mesh.MaterialCF(within, default=0)


def _coaxial_field(coil: CoilSource, body: SteelRing, low: float, current: float, polarisation: float) -> Any:
    """Return the field of the coil at `current` in A and of a magnetised `body` on its axis, from `low` m on."""
    from padgen.verify import field_solid, ng

    mesh, far = field_solid._half_plane(coil, body, low, 4)
    source = ng.CF((0, _magnetised(mesh, coil, current, {"washer": polarisation}, ng.y, ng.x)))
    steels: dict[str, Any] = {"core": coil.core_permeability}
    return field_solid.solve_scalar(mesh, source, steels, far, 5, 2 * np.pi * ng.x)


def force_by_elements(case: Case, shift: float) -> np.ndarray:
    """Return pull and side force (3, 2) per ampere at the gap, and `shift` m below and above, by one solved field.

    A magnet of permeability 1 does not change that field, so the half plane does for any place of its faces. All of
    these lie in one body of air with elements of its own.
    """
    low = case.gap - 1.5 * shift
    wide = 2.02 * (case.offset + case.magnet.outer_diameter / 2)
    body = SteelRing(wide, 0.0, case.gap + case.magnet.height + 1.5 * shift - low, 1.0)
    field = _coaxial_field(case.coil, body, low, 1.0, 0.0)
    magnet = case.magnet
    node, weight = leggauss(16)
    inner, outer = magnet.inner_diameter / 2, magnet.outer_diameter / 2
    radius = inner + (outer - inner) * (node + 1) / 2
    angle = (np.arange(32) + 0.5) * np.pi / 32
    area = np.repeat(np.pi * radius * (outer - inner) * weight, 32) / 32
    x, y = (np.multiply.outer(radius, wave).ravel() for wave in (np.cos(angle), np.sin(angle)))
    away = np.hypot(x + case.offset, y)
    forces = np.zeros((3, 2))
    for force, gap in zip(forces, (case.gap, case.gap - shift, case.gap + shift), strict=True):
        for z, sign in ((gap + magnet.height, 1), (gap, -1)):
            h = np.array(field.field(field.mesh(away / MM, np.full_like(away, z / MM))))
            force += (
                sign * magnet.polarisation * np.array([-area @ h[:, 1], area @ (h[:, 0] * (x + case.offset) / away)])
            )
    return forces


def coaxial_core_pull(case: Case) -> tuple[float, float]:
    """Return the pull in N of the core on the magnet on its axis, by virtual work and by the stress on its surface."""
    from padgen.verify.field_solid import body_wrench

    magnet = case.magnet
    body = SteelRing(magnet.outer_diameter, magnet.inner_diameter, magnet.height, 1.0)
    wrench = body_wrench(_coaxial_field(case.coil, body, case.gap, 0.0, magnet.polarisation), "washer", (0, 0, 0))
    return -float(wrench.virtual_work[2]), -float(wrench.surface[2])


def core_pull_by_elements(case: Case, others: list[tuple[float, float]], order: int = 3) -> np.ndarray:
    """Return force and moment (2, 6), by virtual work and by stress, on a magnet over a core and beside others.

    By elements in space. The others are equal, at (x, y) in m; the moment is about the middle of the underside.
    """
    from padgen.verify import field_solid, ng

    magnet = case.magnet
    body = SteelRing(magnet.outer_diameter, magnet.inner_diameter, magnet.height, 1.0)
    placed = [field_solid.PlacedWasher(body, case.gap, x, y) for x, y in [(case.offset, 0.0), *others]]
    half = all(washer.y_m == 0 for washer in placed)
    mesh, far = field_solid._mesh(case.coil, placed, half, 1, 0.7)
    within = {f"washer{i}": magnet.polarisation for i in range(len(placed))}
    source = ng.CF((0, 0, _magnetised(mesh, case.coil, 0.0, within, ng.z, ng.sqrt(ng.x**2 + ng.y**2))))
    steels: dict[str, Any] = {"core": case.coil.core_permeability}
    solved = field_solid.solve_scalar(mesh, source, steels, far, order, 2.0 if half else 1.0)
    wrench = field_solid.body_wrench(solved, "washer0", (case.offset / MM, 0.0, case.gap / MM))
    return np.stack([wrench.virtual_work, wrench.surface])


def mean_field(magnet: DiscMagnet) -> tuple[float, float]:
    """Return H_z in A/m within the magnet: its mean, and in the middle of the upper face (of a ring, of its width)."""
    node, weight = leggauss(60)
    inner, outer = magnet.inner_diameter / 2, magnet.outer_diameter / 2
    radius = inner + (outer - inner) * (node + 1) / 2
    height = magnet.height * (node + 1) / 2
    r, z = np.meshgrid(radius, height, indexing="ij")
    points = np.stack([r.ravel(), np.zeros(r.size), z.ravel()], -1)
    inside = (_magpylib_field(magnet, points)[:, 2] - magnet.polarisation) / MU_0
    share = radius * weight / (radius * weight).sum()
    middle = np.array([[(inner + outer) / 2 if inner else 0.0, 0.0, magnet.height * (1 - 1e-6)]])
    top = (_magpylib_field(magnet, middle)[0, 2] - magnet.polarisation) / MU_0
    return float(share @ inside.reshape(r.shape) @ weight / 2), float(top)


def radial_field_square(magnet: DiscMagnet, below: float) -> float:
    """Return ∫ B_r² dA in T²·m² over a plane `below` m under the magnet."""
    node, weight = leggauss(200)
    t = (node + 1) / 2
    scale = magnet.outer_diameter
    radius = scale * t / (1 - t)
    points = np.stack([radius, np.zeros_like(radius), np.full_like(radius, -below)], -1)
    b_r = _magpylib_field(magnet, points)[:, 0]
    return float((2 * np.pi * radius * b_r**2 * scale / (1 - t) ** 2) @ weight / 2)


def force_with_steel(case: Case, steel: SteelRing, shift: float) -> float:
    """Return the pull in N per ampere on a magnet and the steel on top of it, both on the coil's axis, by elements.

    By the field of the coil with the steel in it, at places `shift` m below and above: the energy of the magnet there
    changes by the force on both, as the steel answers the magnet as it lets the magnet feel the coil.
    """
    from padgen.verify import field_solid, ng

    magnet = case.magnet
    node, weight = leggauss(12)
    inner, outer = magnet.inner_diameter / 2, magnet.outer_diameter / 2
    radius = inner + (outer - inner) * (node + 1) / 2
    height = magnet.height * (node + 1) / 2
    ring = np.pi * (outer - inner) * radius * weight
    energies = []
    for gap in (case.gap - shift, case.gap + shift):
        mesh, far = field_solid._half_plane(case.coil, steel, gap + magnet.height, 4)
        source = ng.CF((0, _magnetised(mesh, case.coil, 1.0, {}, ng.y, ng.x)))
        steels: dict[str, Any] = {"core": case.coil.core_permeability, "washer": steel.permeability}
        field = field_solid.solve_scalar(mesh, source, steels, far, 5, 2 * np.pi * ng.x)
        r, z = np.meshgrid(radius, gap + height, indexing="ij")
        h = np.array(field.field(field.mesh(r.ravel() / MM, z.ravel() / MM)))[:, 1].reshape(r.shape)
        energies.append(-magnet.polarisation * ring @ h @ (weight * magnet.height / 2))
    return float((energies[1] - energies[0]) / (2 * shift))
