"""Pads changed in one place, in thirty ways, and unchanged pads of random specs as other programs export them."""

from dataclasses import replace
from functools import partial

import manifold3d
import numpy as np

from padgen.core.errors import PadgenError
from padgen.planner import make_plan
from padgen.planner.layout import coil_axis_mm, to_cell
from padgen.solid.mesh import Mesh, as_manifold, welded
from padgen.solid.pad_solid import assembled_pad_mesh, build_pad
from padgen.spec import catalogue, make_spec

__all__ = ["KINDS", "WAYS", "as_single_precision", "honest", "tampered"]


def from_manifold(solid):
    """Return the triangles of a manifold3d solid."""
    mesh = solid.to_mesh64()
    return Mesh(np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts).astype(np.int64))


def stl_mesh(data):
    """Return the triangles of a binary STL, not welded."""
    triangle = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    corners = np.frombuffer(data, triangle, offset=84)["corners"].reshape(-1, 3)
    return Mesh(corners, np.arange(len(corners)).reshape(-1, 3))


def box(size, centre):
    return manifold3d.Manifold.cube(tuple(map(float, size)), True).translate(tuple(map(float, centre)))


def tube(diameter, low, high, x, y, sides=64):
    return manifold3d.Manifold.cylinder(high - low, diameter / 2, diameter / 2, sides).translate((x, y, low))


def as_single_precision(mesh):
    """Return the mesh as binary STL holds it."""
    return welded(mesh.vertices_mm.astype(np.float32).astype(float), mesh.triangles, 1e-5)


class Place:
    """A random taxel of a pad: its washer's place, its arrangement, and its beams."""

    def __init__(self, rng, plan, pad):
        self.rng = rng
        self.plan = plan
        self.pad = pad
        self.solid = as_manifold(pad.mesh, "pad")
        self.taxel = plan.taxels[rng.integers(len(plan.taxels))]
        self.x, self.y = self.taxel.x_mm, self.taxel.y_mm
        self.channel = plan.channels[self.taxel.channel]
        self.arrangement = plan.arrangement(self.channel)
        self.plate = plan.plate
        self.top = plan.spec.pad.frame_thickness_mm
        self.wide = plan.plate.recess_diameter_mm
        self.deep = plan.plate.recess_depth_mm
        self.thick = float(self.arrangement.beams[0].thickness_mm)

    def at(self, x, y, z):
        """Return a place given in the taxel's own axes in the pad's coordinates."""
        moved = to_cell(np.array([float(x), float(y), float(z)]), self.channel)
        if self.taxel.turned:
            moved[:2] *= -1
        return moved + np.array([*coil_axis_mm(self.plan.coils, *self.taxel.coil), 0.0])

    def along_beam(self, low, high, across, z0, z1):
        """Return a box along a beam's first piece, from `low` to `high` of its length, `across` in its widths."""
        beam = self.arrangement.beams[self.rng.integers(len(self.arrangement.beams))]
        a, b = (beam.within(0, share) for share in (low, high))
        ends = []
        for point, side in ((a, across[0]), (b, across[1])):
            shift = side * float(beam.width_mm)
            ends.append(self.at(point.x_mm - shift * point.along_y, point.y_mm + shift * point.along_x, 0.0))
        corners = np.array(ends)
        size = np.abs(corners[1] - corners[0])
        return box(
            (size[0], size[1], z1 - z0),
            ((corners[0, 0] + corners[1, 0]) / 2, (corners[0, 1] + corners[1, 1]) / 2, (z0 + z1) / 2),
        )

    def part(self, mm):
        """Return a length in mm as a share of the length of a beam's first piece."""
        return mm / float(self.arrangement.beams[0].segments[0].length_mm)

    def share(self, mm):
        """Return a width in mm as a share of a beam's width."""
        return mm / float(self.arrangement.beams[0].width_mm)

    def on_gap(self, z):
        """Return a place in the middle of the gap beside the plate at height `z`, and the direction across the gap."""
        contours = [np.asarray(c) for c in self.solid.slice(z).to_polygons()]
        width = self.plan.cell.width_mm / 2
        depth = self.plan.cell.depth_mm / 2
        found = []
        for c in contours:
            following = np.roll(c, -1, axis=0)
            middle = (c + following) / 2
            along = following - c
            length = np.hypot(*along.T)
            near = (np.abs(middle - (self.x, self.y)) < (width, depth)).all(1) & (length > 1.5)
            for m, d, n in zip(middle[near], along[near], length[near], strict=True):
                share = self.rng.uniform(-0.3, 0.3)
                # Material is to the left, so the gap is to the right.
                out = np.array([d[1], -d[0]]) / n
                start = m + share * d
                hits = self.solid.ray_cast((*(start + 1e-3 * out), z), (*(start + 2.0 * out), z))
                if hits:
                    wide = float(hits[0].distance) * 2.0
                    found.append((start + out * wide / 2, out, wide))
        assert found
        return found[self.rng.integers(len(found))]

    def hole(self):
        pad = self.plan.spec.pad
        x = (pad.width_mm + pad.border_mm) / 2
        y = (pad.depth_mm + pad.border_mm) / 2
        return x * self.rng.choice([-1, 1]), y * self.rng.choice([-1, 1])


def lump(p, size, tall):
    z = p.plate.recess_depth_mm + 0.3
    (x, y), across, wide = p.on_gap(z)
    along = np.abs([across[1], across[0]])
    return p.solid + box((*(along * size + np.abs(across) * (wide + 0.1)), tall), (x, y, z))


def drilled(p, change):
    x, y = p.hole()
    whole = p.plan.spec.pad.hole_diameter_mm
    if change is None:
        return p.solid + tube(whole + 0.2, 0.0, p.top, x, y)
    return p.solid - tube(whole + change, -1.0, p.top + 1, x, y)


def slotted(p):
    pad = p.plan.spec.pad
    x = p.rng.uniform(-0.4, 0.4) * pad.width_mm
    y = (pad.depth_mm + pad.border_mm) / 2 * p.rng.choice([-1, 1])
    return p.solid - box((pad.width_mm * 0.1, 0.8, 3 * p.top), (x, y, 0))


def boss(p, x=0.0, y=0.0, z=0.0):
    room = box((p.plate.boss_diameter_mm + 0.4, p.plate.boss_diameter_mm + 0.4, 4.0), (p.x, p.y, p.top + 2.0))
    cap = p.solid ^ room
    angle = p.rng.uniform(0, 2 * np.pi)
    shift = np.hypot(x, y)
    cap = cap.translate((shift * np.cos(angle), shift * np.sin(angle), 0))
    return (p.solid - room) + (cap.trim_by_plane((0, 0, -1), -(p.plate.boss_top_mm + z)) if z else cap)


def beams(p, *spans, add=False):
    piece = p.along_beam(*spans)
    return p.solid + piece if add else p.solid - piece


def notched(p):
    low = p.rng.choice([0.48, 0.55, 0.72, 0.8])
    side = p.rng.choice([-1, 1])
    return beams(p, low, low + 0.05, (side * 0.5, side * 0.2), -1.0, 3.0)


def recess(p, diameter, low, high, add, ring=0.0):
    piece = tube(diameter, low, high, p.x, p.y)
    if ring:
        piece -= tube(diameter - ring, low - 1, high + 1, p.x, p.y)
    return p.solid + piece if add else p.solid - piece


def window(p, margin=0.0):
    """Return the room over the taxel's sub-cell within its ribs, and its centre."""
    at = to_cell_centre(p)
    rib = p.plan.spec.pad.rib_mm / 2
    size = p.plan.cell.width_mm - 2 * rib + 2 * margin, p.plan.cell.depth_mm - 2 * rib + 2 * margin
    return box((*size, 40.0), (*at, 0.0)), at


def to_cell_centre(p):
    site = np.array(p.channel.site.centre_mm) * (-1 if p.taxel.turned else 1)
    return site + coil_axis_mm(p.plan.coils, *p.taxel.coil)


def missing(p):
    return p.solid - window(p)[0]


def doubled(p):
    room, _ = window(p, -0.05)
    shift = p.rng.choice([-1, 1], 2) * p.rng.uniform(0.3, 0.6, 2)
    return p.solid + (p.solid ^ room).translate((*shift, 0.0))


def turned(p):
    room, (x, y) = window(p, 0.0)
    inner = (p.solid ^ room).translate((-x, -y, 0)).rotate((0, 0, 180)).translate((x, y, 0))
    return (p.solid - room) + inner


def mirrored(p):
    room, (x, y) = window(p, 0.0)
    inner = (p.solid ^ room).translate((-x, -y, 0)).mirror((0, 1, 0) if p.channel.site.along[1] == "x" else (1, 0, 0))
    # Tiles are alike both ways: moved, too.
    return (p.solid - room) + inner.translate((x + 0.15, y + 0.15, 0))


def beside(p):
    pad = p.plan.spec.pad
    return p.solid + box((2, 2, 2), (pad.width_mm / 2 + pad.border_mm + p.rng.uniform(3, 20), p.y, 1.0))


def pit(p):
    angle = p.rng.uniform(0, 2 * np.pi)
    # On the boss, which every plate has.
    r = p.rng.uniform(0, 0.2) * p.plate.boss_diameter_mm
    return p.solid - box((0.3, 0.3, 0.3), (p.x + r * np.cos(angle), p.y + r * np.sin(angle), p.plate.boss_top_mm))


def void(p):
    z = p.rng.uniform(p.plate.recess_depth_mm + 0.4, p.plate.boss_top_mm - 0.5)
    return p.solid - manifold3d.Manifold.sphere(0.15, 24).translate((p.x, p.y, z))


def swapped(p):
    """Swap all taxels of two channels."""
    grid = p.pad.grid.copy()
    a, b = p.rng.choice(len(p.plan.channels), 2, replace=False)
    grid[(p.pad.grid == a)] = b
    grid[(p.pad.grid == b)] = a
    return assembled_pad_mesh(p.plan, p.pad.tiles, p.pad.border, grid)


def patch(p, change):
    """Turn over, or take out, the triangles around a random one."""
    mesh = p.pad.mesh
    middle = mesh.corners_mm.mean(1)
    near = np.hypot(*(middle - middle[p.rng.integers(len(middle))]).T[:2]) < p.rng.uniform(0.0, 1.0) + 1e-9
    triangles = mesh.triangles.copy()
    triangles[near] = triangles[near, ::-1]
    return Mesh(mesh.vertices_mm, triangles if change == "turned" else mesh.triangles[~near])


def crack(p):
    at = p.rng.uniform(0.3, 0.8)
    return beams(p, at, at + p.part(0.08), (-0.7, 0.7), -1.0, 3.0)


KINDS = {
    "lump across a gap": partial(lump, size=0.5, tall=0.4),
    "lump bridging taxel and frame": partial(lump, size=1.2, tall=0.8),
    "hair bridge of 0.1 mm": partial(lump, size=0.1, tall=0.1),
    "filled screw hole": partial(drilled, change=None),
    "widened screw hole": partial(drilled, change=0.3),
    "slot through the border": slotted,
    "boss moved by 0.3 mm": partial(boss, x=0.3),
    "boss 0.1 mm lower": partial(boss, z=-0.1),
    "pit in a boss": pit,
    "notch in a beam": notched,
    "crack through a beam": crack,
    "beam narrower": lambda p: beams(p, 0.0, 1.0, (0.5, 0.5 - p.share(0.1)), -1.0, 3.0),
    "beam wider": lambda p: beams(p, 0.0, 1.0, (0.5, 0.5 + p.share(0.1)), 0.0, p.thick, add=True),
    "beam a layer thinner": lambda p: beams(p, 0.1, 0.9, (-0.6, 0.6), p.thick - 0.1, 3.0),
    "beam a layer thicker": lambda p: beams(p, 0.0, 1.0, (-0.5, 0.5), 0.0, p.thick + 0.1, add=True),
    "beam shorter": lambda p: beams(p, 0.0, p.part(0.2), (-1.5, 1.5), 0.0, 2.0, add=True),
    "recess shallower": lambda p: recess(p, p.wide + 0.1, p.deep - 0.1, p.deep + 0.05, True),
    "recess deeper": lambda p: recess(p, p.wide, -1.0, p.deep + 0.1, False),
    "recess narrower": lambda p: recess(p, p.wide + 0.02, 0.0, p.deep, True, 0.2),
    "recess filled": lambda p: recess(p, p.wide + 0.1, 0.0, p.deep + 0.01, True),
    "taxel missing": missing,
    "taxel doubled": doubled,
    "taxel turned round": turned,
    "taxel mirrored and moved": mirrored,
    "channels swapped": swapped,
    "part beside": beside,
    "void within": void,
    "triangles turned over": partial(patch, change="turned"),
    "hole in the surface": partial(patch, change="out"),
    "1 % larger": lambda p: p.solid.scale((1.01, 1.01, 1.01)),
}  # fmt: skip
"""Changes by name: each turns a `Place` into a manifold or a mesh."""


def tampered(name, seed, plan, pad):
    """Return a pad with one thing wrong, as binary STL would hold it, and the changed taxel."""
    place = Place(np.random.default_rng([seed, *name.encode()]), plan, pad)
    made = KINDS[name](place)
    mesh = made if isinstance(made, Mesh) else from_manifold(made)
    return as_single_precision(mesh), place.taxel


def simplified(plan, pad):
    """Return the pad with its triangles merged where they are flat, and cut anew."""
    solid = as_manifold(pad.mesh, "pad").rotate((0, 0, 30)).simplify(1e-6)
    return as_single_precision(from_manifold(solid.rotate((0, 0, -30))))


def round_faces(plan, pad, chord_mm, angle_rad):
    return as_single_precision(build_pad(plan, chord_mm, angle_rad).mesh)


WAYS = {
    "binary STL": lambda plan, pad: as_single_precision(pad.mesh),
    "triangles merged and cut anew": simplified,
    "every triangle cut in four": lambda plan, pad: from_manifold(as_manifold(pad.mesh, "pad").refine(2)),
    "round faces coarser (0.05 mm, 0.5 rad)": partial(round_faces, chord_mm=0.05, angle_rad=0.5),
    "round faces finer (0.004 mm, 0.15 rad)": partial(round_faces, chord_mm=0.004, angle_rad=0.15),
}


def honest(seed):
    """Return a random plan, its unchanged pad as another program exports it, and that way's name, or None."""
    rng = np.random.default_rng(seed)
    low, (width, depth) = rng.uniform(50, 150), rng.uniform(20, 60, 2)
    washers = sorted(name for name, w in catalogue("washer").items() if w["relative_permeability"] > 2)
    table = {
        "name": "random",
        "resolution": int(rng.integers(1, max(2, int(width * depth / 150)))),
        "band_hz": [low, low * rng.uniform(1.5, 8)],
        "q_min": rng.uniform(8, 60),
        "printer": str(rng.choice(sorted(catalogue("printer")))),
        "washer": str(rng.choice(washers[-4:] + ["iso7092-m1.6"] * 4)),
        "pad": {"width_mm": width, "depth_mm": depth},
        "suspension": {"topology": str(rng.choice(["auto", "auto", "cantilever", "folded", "bridge"]))},
        "taxel": {"centre_post": bool(rng.integers(2))},
        "coil": {"reuse": str(rng.choice(["same", "alternate"]))},
    }
    try:
        plan = make_plan(make_spec(table))
    except PadgenError:
        return None
    plan = replace(plan, spec=replace(plan.spec, printer=replace(plan.spec.printer, bed_x_mm=500.0, bed_y_mm=500.0)))
    way = list(WAYS)[seed % len(WAYS)]
    return plan, WAYS[way](plan, build_pad(plan)), way
