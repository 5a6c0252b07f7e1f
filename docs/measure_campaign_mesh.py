"""Modes of a taxel by elements on prisms, a mesh for `measure_campaign.py` some ten times as fast as tetrahedra.

A taxel is flat layers of one outline each. Its plan is meshed by triangles with shrinking quadrilaterals along
roots and tips (Netgen), then extruded from level to level, with thin levels at the beams' top. Circles become polygons
of the same area, bends chords as long as their arcs, and a chamfered boss a shorter one. The frame is kept only near
the roots. A taxel with a plane of symmetry is meshed by half. Lengths are in mm.
"""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from padgen.planner.suspensions import Arrangement
from padgen.verify.elasticity import energy, stiffness_pa, strain

MM = 1e-3
REACH = 2.0
LONGEST = 4.0
"""Length over width of the pieces of a straight beam."""
ENERGY = 0.01
"""Share of the energy that may lie in elements left at order 2."""
GRADED = 0.2
FIELDS = {"along": (0, 2, 4), "across": (1, 3, 5)}
WHOLE = {"all": (0, 1, 2, 3, 4, 5)}
TURN = np.pi / 8
"""Turn of a bend within one chord, in rad."""
PIECE = 2.5
"""Largest length over width of the straight pieces of a bent beam."""
PRINTED = "printed"
WASHER = "washer"
CLAMPED = "clamped"
MIDDLE = "middle"


class Round(NamedTuple):
    """Diameters and levels of the round parts."""

    recess_mm: float
    recess_depth_mm: float
    post_mm: float
    washer_outer_mm: float
    washer_inner_mm: float
    washer_low_mm: float
    boss_mm: float
    boss_top_mm: float
    plate_top_mm: float


class Taxel(NamedTuple):
    arrangement: Arrangement
    round: Round
    fillet_mm: float
    frame_mm: float
    sides: tuple[float, float, float, float]

    @property
    def bends(self) -> bool:
        return not all(path.is_straight for path in self.arrangement.beams)


def _rectangle(x0: float, x1: float, y0: float, y1: float) -> Any:
    from netgen.occ import WorkPlane

    return WorkPlane().MoveTo(x0, y0).Rectangle(x1 - x0, y1 - y0).Face()


def _polygon(points: Any) -> Any:
    from netgen.occ import WorkPlane

    doubled = sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(points, [*points[1:], points[0]], strict=True))
    first, *others = points if doubled > 0 else points[::-1]
    plane = WorkPlane().MoveTo(*first)
    for point in others:
        plane.LineTo(*point)
    return plane.Close().Face()


def _angles(fine: tuple[bool, bool]) -> np.ndarray:
    """Return corners of half a polygon in rad, closer at 0 or π where a beam meets the wall there."""
    near = [0, 4, 8, 13, 20, 30, 45, 60, 75, 90]
    far = [0, 15, 30, 45, 60, 75, 90]
    first, last = (near if one else far for one in fine)
    return np.radians([*first, *(180 - a for a in last[-2::-1])])


def _radii(diameter: float, angle: np.ndarray) -> np.ndarray:
    """Return the radii of the corners, so that each piece has about the area of its sector."""
    step = np.diff(angle)
    grown = step / np.sin(step)
    return diameter / 2 * np.sqrt((np.r_[grown[0], grown] + np.r_[grown, grown[-1]]) / 2)


def _half_disc(diameter: float, x: float, angle: np.ndarray) -> Any:
    radius = _radii(diameter, angle)
    along = x + radius * np.cos(angle)
    up = np.maximum(radius * np.sin(angle), 0.0)
    up[[0, -1]] = 0.0
    return _polygon([(float(a), float(b)) for a, b in zip(along, up, strict=True)])


def _rounds(taxel: "Taxel") -> tuple[np.ndarray, np.ndarray]:
    """Return the corners' angles for recess and washer, and for the other round parts."""
    arrangement = taxel.arrangement
    straight = len(arrangement.blocks) == 1
    return _angles((straight and len(arrangement.beams) > 1, straight)), _angles((False, False))


class Strip(NamedTuple):
    """A beam in plan: its root's x and direction, its sides in y (0 on the plane of symmetry), its length."""

    root: float
    sign: float
    low: float
    high: float
    length: float


def _strips(taxel: Taxel) -> list[Strip]:
    found = []
    for path in taxel.arrangement.beams:
        x = float(path.root_mm[0])
        y = float(path.root_mm[1])
        half = float(path.width_mm) / 2
        if y >= 0:
            found.append(Strip(x, path.direction[0], max(y - half, 0.0) if y else 0.0, y + half, float(path.length_mm)))
    return found


def _flares(strip: Strip, fillet: float) -> list[list[tuple[float, float]]]:
    """Return polygons of the flares beside a beam's root, on sides that are not on the plane of symmetry."""
    if fillet < 1e-6:
        return []
    angle = np.linspace(0, np.pi / 2, 6)
    found = []
    for side, out in ((strip.high, 1.0), (strip.low, -1.0)):
        if out < 0 and strip.low == 0:
            continue
        arc = [(fillet * (1 - np.sin(a)), fillet * (1 - np.cos(a))) for a in angle]  # from the side to the wall
        points = [(0.0, 0.0), *arc]
        found.append([(float(strip.root + strip.sign * u), float(side + out * v)) for u, v in points])
    return found


class Plan(NamedTuple):
    """The mesh of a taxel's plan: places (n, 2), and the corners of the elements."""

    points: np.ndarray
    cells: list[tuple[int, ...]]


def _squeeze(taxel: Taxel) -> tuple[float, float]:
    """Return the place where a straight beam's free middle begins, and the length with which it is meshed."""
    strip = _strips(taxel)[0]
    width = 2 * strip.high
    thickness = float(taxel.arrangement.beams[0].thickness_mm)
    margin = max(taxel.fillet_mm, 0.0) + 1.0 * min(width, 2 * thickness)
    middle = strip.length - 2 * margin
    return margin, min(middle, max(2.5 * width, middle / LONGEST)) if middle > 0 else -1.0


def _meshed(faces: list[Any], lines: list[tuple[float, float, float]], levels: int, size: float) -> Plan:
    """Mesh faces by triangles, with shrinking quadrilaterals along `lines` (x, from y, to y)."""
    import ngsolve
    from netgen.occ import Glue, OCCGeometry

    shape = Glue(faces)
    for edge in shape.edges:
        a = edge.start
        b = edge.end
        edge.hpref = 0.0
        for at, low, high in lines:
            if (
                abs(a.x - at) < 1e-7
                and abs(b.x - at) < 1e-7
                and min(a.y, b.y) > low - 1e-7
                and max(a.y, b.y) < high + 1e-7
            ):
                edge.hpref = 1.0
    for corner in shape.vertices:
        ends = any(
            abs(corner.p.x - at) < 1e-7 and min(abs(corner.p.y - y) for y in (low, high)) < 1e-7
            for at, low, high in lines
        )
        corner.hpref = 1.0 if ends else 0.0
    for face in shape.faces:
        face.maxh = size * abs(face.mass) ** 0.5
    mesh = ngsolve.Mesh(OCCGeometry(shape, dim=2).GenerateMesh(grading=0.9, segmentsperedge=0.1))
    if levels:
        mesh.RefineHP(levels, GRADED)
    points = np.array([v.point for v in mesh.vertices])
    return Plan(points, [tuple(v.nr for v in element.vertices) for element in mesh.Elements(ngsolve.VOL)])


def _bent_strip(path: Any) -> list[Any]:
    """Return quadrilaterals along a beam; the chords of a bend are together as long as its arc."""
    half, (x, y), heading = float(path.width_mm) / 2, (float(v) for v in path.root_mm), 0.0
    rungs = [((x, y), (0.0, 1.0))]
    for segment in path.segments:
        length = float(segment.length_mm)
        turn = float(segment.turn_rad)
        count = round(abs(turn) / TURN) if turn else int(np.ceil(length / (PIECE * 2 * half)))
        for _ in range(count):
            heading += turn / count / 2
            x = x + length / count * np.cos(heading)
            y = y + length / count * np.sin(heading)
            heading += turn / count / 2
            rungs.append(((x, y), (-np.sin(heading), np.cos(heading))))
    sides = [[(float(a + s * half * n), float(b + s * half * m)) for s in (-1, 1)] for (a, b), (n, m) in rungs]
    return [_polygon([low[0], high[0], high[1], low[1]]) for low, high in pairwise(sides)]


def bent_plan_mesh(taxel: Taxel, levels: int, size: float) -> Plan:
    """Mesh the whole plan of a taxel on one bent beam."""
    (path,), (block,), r = taxel.arrangement.beams, taxel.arrangement.blocks, taxel.round
    half = float(path.width_mm) / 2
    thickness = float(path.thickness_mm)
    x0 = taxel.sides[0]
    reach = REACH * max(thickness, -x0)
    low = max(-half - reach, taxel.sides[2])
    high = min(half + reach, taxel.sides[3])
    begin, end, *sides = (float(v) for v in block[:4])
    faces = [_rectangle(x0, 0.0, low, high), *_bent_strip(path), _rectangle(begin, end, *sides)]
    angle = np.linspace(0, 2 * np.pi, 25)
    for diameter in (r.recess_mm, r.washer_outer_mm, r.washer_inner_mm, r.boss_mm, r.post_mm):
        if diameter > 0:
            radius = _radii(diameter, angle)[0]
            centre = float(taxel.arrangement.washer_x_mm)
            at = centre + radius * np.cos(angle[:-1]), radius * np.sin(angle[:-1])
            faces.append(_polygon(list(zip(*(v.tolist() for v in at), strict=True))))
    return _meshed(faces, [(0.0, -half, half), (begin, -half, half)], levels, size)


def plan_mesh(taxel: Taxel, levels: int, size: float) -> Plan:
    arrangement = taxel.arrangement
    strips = _strips(taxel)
    thickness = float(arrangement.beams[0].thickness_mm)
    folded = len(arrangement.blocks) > 1
    length = strips[0].length
    margin, squeezed = _squeeze(taxel)
    squeezing = not folded and squeezed > 0
    short = 2 * margin + squeezed if squeezing else length

    def into(x: float) -> float:
        """Return where x of the taxel lies in the squeezed plan."""
        if not squeezing:
            return x
        if len(strips) == 1:
            return x if x <= margin else x - length + short
        return x if x <= margin else x - (length - short)

    whole = float(arrangement.window_mm[0])
    x0, x1, _, y1 = taxel.sides
    faces = []
    lines = []
    for strip in strips:
        depth = -x0 if strip.sign > 0 else x1 - whole
        reach = REACH * max(thickness, depth) + taxel.fillet_mm
        low = max(strip.low - reach, 0.0)
        high = min(strip.high + reach, y1)
        root = (
            0.0
            if strip.sign > 0
            else 2 * short + float(arrangement.blocks[0].high_x_mm) - float(arrangement.blocks[0].low_x_mm)
        )
        moved = strip._replace(root=root, length=short)
        back = root - strip.sign * depth
        faces.append(_rectangle(min(root, back), max(root, back), low, high))
        end = root + strip.sign * short
        if squeezing:
            cuts = [root, root + strip.sign * margin, root + strip.sign * (margin + squeezed), end]
        else:
            cuts = [root, end]
        faces += [_rectangle(min(a, b), max(a, b), strip.low, strip.high) for a, b in pairwise(cuts)]
        faces += [_polygon(points) for points in _flares(moved, taxel.fillet_mm)]
        lines += [(root, strip.low, strip.high), (end, strip.low, strip.high)]
    shift = length - short if squeezing else 0.0
    for block in arrangement.blocks:
        bounds = [float(v) for v in block[:4]]
        faces.append(_rectangle(bounds[0] - shift, bounds[1] - shift, max(bounds[2], 0.0), bounds[3]))
    r = taxel.round
    centre = float(arrangement.washer_x_mm) - shift
    fine, coarse = _rounds(taxel)
    for diameter, corners in (
        (r.recess_mm, fine),
        (r.washer_outer_mm, fine),
        (r.washer_inner_mm, coarse),
        (r.boss_mm, coarse),
        (r.post_mm, coarse),
    ):
        if diameter > 0:
            faces.append(_half_disc(diameter, centre, corners))
    points, cells = _meshed(faces, lines, levels, size)
    if squeezing:
        x = points[:, 0].copy()
        stretch = (length - 2 * margin) / squeezed
        left = x + (np.clip(x, margin, margin + squeezed) - margin) * (stretch - 1)
        points[:, 0] = left
        if len(strips) > 1:
            total = 2 * short + float(arrangement.blocks[0].high_x_mm) - float(arrangement.blocks[0].low_x_mm)
            begin = total - margin - squeezed
            points[:, 0] += (np.clip(x, begin, begin + squeezed) - begin) * (stretch - 1)
    return Plan(points, cells)


def _columns(taxel: Taxel, place: np.ndarray) -> list[tuple[float, float, str]]:
    """Return the materials over a place of the plan, each from level to level."""
    arrangement = taxel.arrangement
    r = taxel.round
    x, y = place[0], abs(place[1])  # round parts are the same on both sides
    distance = np.hypot(x - float(arrangement.washer_x_mm), y)
    whole = float(arrangement.window_mm[0])

    fine, coarse = (np.linspace(0, np.pi, 13),) * 2 if taxel.bends else _rounds(taxel)

    def within(diameter: float, angle: np.ndarray) -> bool:
        radius = _radii(diameter, angle)
        at = np.arctan2(y, x - float(arrangement.washer_x_mm))
        k = int(np.clip(np.searchsorted(angle, at) - 1, 0, len(angle) - 2))
        (ax, ay), (bx, by) = ((radius[j] * np.cos(angle[j]), radius[j] * np.sin(angle[j])) for j in (k, k + 1))
        px = distance * np.cos(at)
        py = distance * np.sin(at)
        return bool((bx - ax) * (py - ay) - (by - ay) * (px - ax) > 0)

    if x < 0 or x > whole:
        return [(0.0, taxel.frame_mm, PRINTED)]
    for block in arrangement.blocks:
        low_x, high_x, low_y, high_y, top = (float(v) for v in block)
        if low_x < x < high_x and low_y < place[1] < high_y:
            bottom = 0.0
            found = []
            if top == r.plate_top_mm:
                if within(r.recess_mm, fine) and not (r.post_mm and within(r.post_mm, coarse)):
                    bottom = r.recess_depth_mm
                    if within(r.washer_outer_mm, fine) and not within(r.washer_inner_mm, coarse):
                        found.append((r.washer_low_mm, r.recess_depth_mm, WASHER))
                if within(r.boss_mm, coarse):
                    top = r.boss_top_mm
            return [*found, (bottom, top, PRINTED)]
    return [(0.0, float(arrangement.beams[0].thickness_mm), PRINTED)]


def taxel_mesh(taxel: Taxel, levels: int, size: float) -> Any:
    """Return the NGSolve mesh of the half with y ≥ 0, or of the whole where a beam bends."""
    import netgen.meshing as nm
    import ngsolve

    plan = (bent_plan_mesh if taxel.bends else plan_mesh)(taxel, levels, size)
    thickness = float(taxel.arrangement.beams[0].thickness_mm)
    r = taxel.round
    marks = {0.0, thickness, taxel.frame_mm, r.plate_top_mm, r.recess_depth_mm, r.washer_low_mm, r.boss_top_mm}
    marks |= {float(b.height_mm) for b in taxel.arrangement.blocks}
    for level in range(1, levels + 1):
        marks.add(thickness * (1 + GRADED**level))
    heights = [0.0]
    for z in sorted(marks):
        if z > heights[-1] + 1e-9:
            heights.append(z)
    # Tall layers in pieces no taller than twice a beam's thickness, or a millimetre and a half.
    fine = [0.0]
    for a, b in pairwise(heights):
        count = int(np.ceil((b - a) / max(2 * thickness, 2.0)))
        fine += list(np.linspace(a, b, count + 1)[1:])
    heights = fine
    mesh = nm.Mesh(dim=3)
    known: dict[tuple[int, int], Any] = {}
    index = {PRINTED: 1, WASHER: 2}

    def node(corner: int, level: int) -> Any:
        if (corner, level) not in known:
            x, y = plan.points[corner][:2]
            known[corner, level] = mesh.Add(nm.MeshPoint(nm.Pnt(float(x), float(y), float(heights[level]))))
        return known[corner, level]

    x0, x1, y0, y1 = taxel.sides
    for bc in (1, 2):
        mesh.Add(nm.FaceDescriptor(surfnr=bc, domin=1, bc=bc))
    for cell in plan.cells:
        places = plan.points[list(cell)][:, :2]
        columns = _columns(taxel, places.mean(0))
        turned = 0.5 * sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(places, np.roll(places, -1, axis=0), strict=True))
        corners = cell if turned > 0 else cell[::-1]
        for level, (a, b) in enumerate(pairwise(heights)):
            middle = (a + b) / 2
            material = next((name for low, high, name in columns if low < middle < high), None)
            if material is None:
                continue
            below, above = ([node(c, level + k) for c in corners] for k in (0, 1))
            mesh.Add(nm.Element3D(index[material], below + above))
            count = len(corners)
            for k in range(count):
                p = corners[k]
                q = corners[(k + 1) % count]
                ends = plan.points[[p, q]][:, :2]
                held = any(
                    (np.abs(ends[:, axis] - at) < 1e-7).all() for axis, at in ((0, x0), (0, x1), (1, y0), (1, y1))
                )
                mid = not taxel.bends and (np.abs(ends[:, 1]) < 1e-9).all()
                if held or mid:
                    quad = [node(p, level), node(q, level), node(q, level + 1), node(p, level + 1)]
                    mesh.Add(nm.Element2D(1 if held else 2, quad))
    mesh.SetMaterial(1, PRINTED)
    mesh.SetMaterial(2, WASHER)
    mesh.SetBCName(0, CLAMPED)
    mesh.SetBCName(1, MIDDLE)
    return ngsolve.Mesh(mesh)


class _Dofs(NamedTuple):
    """Unknowns of one component: their orders, masks (n,) of those held and on the symmetry plane, each element's."""

    order: np.ndarray
    clamped: np.ndarray
    middle: np.ndarray
    elements: list[np.ndarray]


def _dofs(mesh: Any, scalar: Any, order: int) -> _Dofs:
    import ngsolve as ngs

    of = np.full(scalar.ndof, 1)
    for kind, nodes in ((ngs.EDGE, mesh.edges), (ngs.FACE, mesh.faces), (ngs.CELL, mesh.Elements(ngs.VOL))):
        for node in nodes:
            place = ngs.NodeId(kind, node.nr)
            own = [d for d in scalar.GetDofNrs(place) if d >= 0]
            of[own] = order
            # The first unknown of an edge, a quadrilateral and a hexahedron is of order 2.
            if kind == ngs.EDGE or len(own) in (4, 8):
                of[own[:1]] = 2
    held = {name: np.array(list(scalar.GetDofs(mesh.Boundaries(name))), bool) for name in (CLAMPED, MIDDLE)}
    elements = [np.array([d for d in scalar.GetDofNrs(e) if d >= 0]) for e in mesh.Elements(ngs.VOL)]
    return _Dofs(of, held[CLAMPED], held[MIDDLE], elements)


class Found(NamedTuple):
    """Rising `frequency_hz` (6,), their `change` (6,) from order 2 to 3, and the washer's `motion` (6, 6).

    `sag_m` is the washer's under gravity, `compliance` in m/N that to a force up, both static; `stress` in Pa/m is
    the largest nominal stress of a straight beam per metre of the washer's motion up in the mode that moves it most.
    """

    frequency_hz: np.ndarray
    change: np.ndarray
    motion: np.ndarray
    unknowns: int
    sag_m: float = float("nan")
    compliance: float = float("nan")
    stress: float = float("nan")


GRAVITY = 9.80665


def nominal_stress(taxel: "Taxel", mesh: Any, material: Any, field: Any) -> float:
    """Return the largest nominal stress in Pa of a taxel's first straight beam that moves as `field` (in m).

    Its bending moment is linear. It and its slope follow from two integrals of the axial stress over the beam's volume,
    without the singular stress at its ends.
    """
    import ngsolve as ngs

    path = taxel.arrangement.beams[-1]
    (root, y0), length = (float(v) for v in path.root_mm), float(path.length_mm)
    width = float(path.width_mm)
    thickness = float(path.thickness_mm)
    along = float(path.direction[0]) * (ngs.x - root)
    axial = sum(float(c) * part for c, part in zip(MM**-1 * stiffness_pa(material)[0], strain(field), strict=True))
    inside = (
        ngs.IfPos(along, 1.0, 0.0)
        * ngs.IfPos(length - along, 1.0, 0.0)
        * ngs.IfPos(width / 2 - ngs.sqrt((ngs.y - y0) ** 2), 1.0, 0.0)
        * ngs.IfPos(thickness - ngs.z, 1.0, 0.0)
    )
    half = 0.5 if y0 == 0 and not taxel.bends else 1.0
    moments = []
    for weight in (1.0, along - length / 2):
        where = ngs.dx(definedon=mesh.Materials(PRINTED))
        moments.append(ngs.Integrate(axial * (ngs.z - thickness / 2) * inside * weight * where, mesh) / half)
    middle = MM**3 * moments[0] / length
    slope = MM**3 * 12 * moments[1] / length**3
    flare = taxel.fillet_mm
    stations = ((0.0, width + 2 * flare), (flare, width), (length, width))
    return max(abs(middle + slope * (at - length / 2)) * 6 / (MM**3 * wide * thickness**2) for at, wide in stations)


def modes(
    mesh: Any,
    materials: Any,
    axis_x: float,
    order: int = 3,
    count: int = 3,
    kept: float = ENERGY,
    taxel: Taxel | None = None,
) -> Found:
    """Solve the lowest `count` modes of either symmetry by elements of order 2, and of `order` where they hold energy.

    A whole taxel has no boundary called `MIDDLE`; of it, twice as many modes of all kinds are solved. Stress is taken
    of a `taxel` on straight beams.
    """
    import ngsolve as ngs
    import scipy.sparse as sparse

    space = ngs.VectorH1(mesh, order=order)
    scalar = ngs.H1(mesh, order=order)
    (u, v), (a, b) = space.TnT(), scalar.TnT()
    stiffness = ngs.BilinearForm(space, symmetric=True)
    mass = ngs.BilinearForm(scalar, symmetric=True)
    for name, material in materials.items():
        where = ngs.dx(definedon=mesh.Materials(name))
        stiffness += energy(material, u, v) * where
        mass += MM**3 * material.density_kg_per_m3 * a * b * where
    stiffness.Assemble()
    mass.Assemble()
    values, columns, starts = (np.array(part) for part in mass.mat.CSR())
    lumps = sparse.csr_matrix((values, columns, starts))
    dofs = _dofs(mesh, scalar, order)
    washer = ngs.dx(definedon=mesh.Materials(WASHER))
    x = MM * (ngs.x - axis_x)
    y = MM * ngs.y
    z = MM * ngs.z
    rigid = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, -z, y), (z, 0, -x), (-y, x, 0)]
    test = space.TestFunction()
    field = ngs.GridFunction(space)
    density = mesh.MaterialCF({name: energy(material, field, field) for name, material in materials.items()})
    place = MM * (np.array([v.point for v in mesh.vertices]) - [axis_x, 0, 0])
    into, out = stiffness.mat.CreateColVector(), stiffness.mat.CreateColVector()

    def times(matrix: Any, vectors: np.ndarray) -> np.ndarray:
        columns = []
        for vector in vectors.T:
            into.FV().NumPy()[:] = vector
            out.data = matrix * into
            columns.append(np.array(out.FV().NumPy()))
        return np.array(columns).T

    def inertia(vectors: np.ndarray) -> np.ndarray:
        return np.concatenate([lumps @ part for part in vectors.reshape(3, scalar.ndof, -1)])

    frequency = []
    change = []
    motion = []
    unknowns = 0
    whole = not dofs.middle.any()
    weight = ngs.LinearForm(space)
    for name, material in materials.items():
        weight += MM**3 * material.density_kg_per_m3 * GRAVITY * test[2] * ngs.dx(definedon=mesh.Materials(name))
    weight.Assemble()
    heavy = np.array(weight.vec.FV().NumPy())[:, None]
    sag_m = compliance = stress = float("nan")
    for axes in (WHOLE if whole else FIELDS).values():
        count, halves = (2 * count, 1) if whole else (count, 2)
        loads = []
        moved = np.zeros((3, scalar.ndof, len(axes)))
        for j, k in enumerate(axes):
            form = ngs.LinearForm(space)
            form += MM**3 * ngs.InnerProduct(ngs.CoefficientFunction(rigid[k]), test) * washer
            form.Assemble()
            loads.append(np.array(form.vec.FV().NumPy()))
            # A rigid motion is linear: it has the corners' unknowns only.
            moved[:, : len(place), j] = np.eye(3)[k][:, None] if k < 3 else np.cross(np.eye(3)[k - 3], place).T
        load = np.array(loads).T
        load = load @ np.linalg.inv(moved.reshape(-1, len(axes)).T @ load)
        slides = np.concatenate([dofs.clamped | (dofs.middle if k in _HELD.get(axes, ()) else False) for k in range(3)])
        chosen = dofs.order <= 2
        found = []
        for refined in (False, True):
            free = np.tile(chosen, 3) & ~slides
            inverse = stiffness.mat.Inverse(ngs.BitArray(free.tolist()), inverse="sparsecholesky")
            # Static answers, and the answers to their inertia: two blocks of Lanczos' method.
            first = times(inverse, load)
            if 2 in axes:
                up = axes.index(2)
                compliance = float(load[:, up] @ first[:, up]) / halves
                sag_m = float(load[:, up] @ times(inverse, heavy)[:, 0])
            first /= np.sqrt((first * inertia(first)).sum(0))
            basis = np.hstack((first, times(inverse, inertia(first))))
            square, shape = _lowest(basis, times(stiffness.mat, basis) * free[:, None], inertia(basis))
            found.append(square[:count])
            if refined:
                break
            shares = []
            for one in shape[:, :count].T:
                field.vec.FV().NumPy()[:] = one
                held = np.array(ngs.Integrate(density, mesh, element_wise=True).NumPy())
                shares.append(held / held.sum())
            share = np.max(shares, 0)
            rising = np.argsort(share)
            rich = rising[np.cumsum(share[rising]) > kept]
            chosen = chosen.copy()
            chosen[np.unique(np.concatenate([dofs.elements[k] for k in rich]))] = True
        part = np.zeros((count, 6))
        part[:, axes] = shape[:, :count].T @ load / halves**0.5
        if 2 in axes and taxel and not taxel.bends:
            moved_up = shape[:, :count].T @ load[:, axes.index(2)]
            working = int((moved_up**2 / found[1]).argmax())
            field.vec.FV().NumPy()[:] = shape[:, working]
            stress = nominal_stress(taxel, mesh, materials[PRINTED], field) / abs(float(moved_up[working]))
        frequency.append(np.sqrt(found[1]) / (2 * np.pi))
        change.append(np.sqrt(found[0] / found[1]) - 1)
        motion.append(part)
        unknowns += int(free.sum())
    hz = np.concatenate(frequency)
    rising = np.argsort(hz)
    return Found(
        hz[rising], np.concatenate(change)[rising], np.concatenate(motion)[rising], unknowns, sag_m, compliance, stress
    )


def _lowest(basis: np.ndarray, stiff: np.ndarray, heavy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return squared angular frequencies within a basis, and the mass-normalised shapes (Rayleigh and Ritz)."""
    size, turn = np.linalg.eigh(basis.T @ heavy)
    kept = turn[:, size > 1e-13 * size[-1]] / np.sqrt(size[size > 1e-13 * size[-1]])
    square, part = np.linalg.eigh(kept.T @ (basis.T @ stiff) @ kept)
    return square, basis @ kept @ part


_HELD: dict[tuple[int, ...], tuple[int, ...]] = {(0, 2, 4): (1,), (1, 3, 5): (0, 2)}
"""Displacement components held on the plane of symmetry, for each of the two families of modes (`FIELDS`)."""
