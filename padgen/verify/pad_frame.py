"""The taxels of a pad on its real frame: shift of their resonances and crosstalk, each taxel by the beam model.

The frame alone is solved as a solid: window by window, without plates and beams. A taxel is the rigid body of
the planner's beam model; each of its beams joins it by a 6 x 6 stiffness to the piece of rib behind the beam's
root, whose mean motion as a body is carried to the taxel's centroid. Of the frame's motions those are kept that
answer a static pull of any one taxel in its working mode (Ritz). Damping is structural: every stiffness
times 1 + j/Q. SI units but for the solid's own millimetres.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from padgen.core.units import G_PER_CM3, GPA, MM
from padgen.physics.beams import tip_stiffness
from padgen.physics.modes import to_tip
from padgen.planner.layout import taxel_places
from padgen.planner.plan import TURNS, Plan, Taxel
from padgen.planner.suspensions import BeamShape
from padgen.planner.taxel_model import TaxelModel, plate_shape
from padgen.verify import ng, occ
from padgen.verify.elasticity import Elastic, Fineness, System, assembled_system, factored, meshed, rigid_loads

__all__ = [
    "CLAMPINGS",
    "MountedTaxel",
    "PadModes",
    "central_taxels",
    "coupled_modes",
    "pad_modes",
    "peak_hz",
    "shift",
]

CLAMPINGS = ("edges", "bottom", "corners")
"""Held are: outer side faces of the border; the frame's underside; the walls of the corner holes."""
HELD = "held"
SEAM = "seam"
ROOT_DEPTH = 0.25
"""Depth, as a share of a rib, of the piece behind a root that moves with the beam."""
MESH = Fineness(levels=0, largest_mm=4.0, grading=0.8, per_face=10.0)
"""Coarse: the order of the elements is what is refined."""


class MountedTaxel(NamedTuple):
    """A taxel on a frame: the mass of its body, the stiffness of its beams, and how the frame moves their roots.

    `mass` (6, 6) is that of the body at the centroid. `beams` has for each beam its stiffness (6, 6) there, and what
    takes the frame's motion to the root's (6, n), carried to the centroid. `pull` (6,) takes the body's motion to its
    washer's vertical one.
    """

    mass: np.ndarray
    beams: Sequence[tuple[np.ndarray, np.ndarray]]
    pull: np.ndarray


class PadModes(NamedTuple):
    """All modes of a pad: ``(2πf)²`` in (rad/s)² and the washers' vertical motions in kg^-½.

    `square` is (k,), `motion` (taxels, k); `unknowns` are those of the frame.
    """

    square: np.ndarray
    motion: np.ndarray
    unknowns: int = 0

    def receptance(self, taxel: int, frequency_hz: np.ndarray, q: float) -> np.ndarray:
        """Return motion (frequencies, taxels) of all washers in m for 1 N on the washer of `taxel`, complex."""
        square = (2 * np.pi * np.asarray(frequency_hz)[:, None]) ** 2
        return np.asarray(self.motion[taxel] / (self.square * (1 + 1j / q) - square) @ self.motion.T)


def pad_modes(plan: Plan, clamping: str, order: int) -> tuple[PadModes, PadModes]:
    """Return the taxels' modes on a frame held by `clamping`, then those with all sides of sub-cells held, too.

    Both are of one mesh, so that what it errs by close to the roots leaves their ratio alone.

    Raises
    ------
    SolverError
        The clamping holds nothing, or the frame cannot be meshed.
    """
    ng.SetNumThreads(1)
    mesh = meshed(_frame_solid(plan, clamping), MESH, "frame", set())
    material = plan.spec.material
    plastic = Elastic(material.modulus_gpa * GPA, material.poisson_ratio, material.density_g_per_cm3 * G_PER_CM3)
    on_frame, held = (
        _on_frame(plan, assembled_system(mesh, {".*": plastic}, order, faces)) for faces in (HELD, f"{SEAM}|{HELD}")
    )
    return on_frame, held


def _turn(plan: Plan, taxel: Taxel) -> np.ndarray:
    """Return the rotation matrix (3, 3) from a taxel's axes to the pad's."""
    cosine, sine = TURNS[plan.channels[taxel.channel].site.along]
    sign = -1 if taxel.turned else 1
    return np.array([[sign * cosine, -sign * sine, 0.0], [sign * sine, sign * cosine, 0.0], [0.0, 0.0, 1.0]])


def _frame_solid(plan: Plan, clamping: str) -> Any:
    """Return Netgen's shape of the frame in mm, from the pad's centre.

    Its solids are the pieces of rib behind the roots, named ``root<taxel>-<beam>``, and all else; side faces of
    sub-cells are named ``seam``, what is held ``held``.
    """
    pad = plan.spec.pad
    height = pad.frame_thickness_mm
    half = np.array([pad.width_mm, pad.depth_mm]) / 2
    outer = half + pad.border_mm

    def block(corners: np.ndarray, top: float = height) -> Any:
        return occ.Box(occ.Pnt(*corners.min(0), 0.0), occ.Pnt(*corners.max(0), top))

    border = block(np.array([-outer, outer])) - block(np.array([-half, half]))
    _name(border, SEAM)
    if clamping == "edges":
        _name([face for face in border.faces if np.isclose(np.abs(_centre(face)[:2]), outer).any()], HELD)
    for corner in [(x, y) for x in (-1, 1) for y in (-1, 1)] if pad.hole_diameter_mm else []:
        bore = occ.Cylinder(occ.Pnt(*(half + pad.border_mm / 2) * corner, 0.0), occ.Z, pad.hole_diameter_mm / 2, height)
        _name(bore, HELD if clamping == "corners" else SEAM)
        border = border - bore
    solids = [border]
    cell = np.array([plan.cell.width_mm, plan.cell.depth_mm])
    for (row, column), index in np.ndenumerate(taxel_places(plan)):
        low = (column, row) * cell - half
        tile = block(np.array([low, low + cell]))
        _name([face for face in tile.faces if abs(_centre(face)[2] - height / 2) < height / 4], SEAM)
        if index >= 0:
            taxel = plan.taxels[index]
            arrangement = plan.arrangement(plan.channels[taxel.channel])
            turn = _turn(plan, taxel)[:2, :2]
            place = (taxel.x_mm, taxel.y_mm) - turn @ (float(arrangement.washer_x_mm), 0.0)
            length, width = (float(side) for side in arrangement.window_mm)
            tile = tile - block(np.array([(0.0, -width / 2), (length, width / 2)]) @ turn.T + place)
            for k, beam in enumerate(arrangement.beams):
                aside = np.array([-beam.direction[1], beam.direction[0]]) * float(beam.width_mm) / 2
                ends = [aside, -aside - np.array(beam.direction) * ROOT_DEPTH * pad.rib_mm]
                root = block(
                    (np.array(ends) + [float(v) for v in beam.root_mm]) @ turn.T + place, float(beam.thickness_mm)
                )
                root.solids[0].name = f"root{index}-{k}"
                tile = tile - root
                solids.append(root)
        solids.append(tile)
    shape = occ.Glue(solids)
    if clamping == "bottom":
        _name([face for face in shape.faces if abs(_centre(face)[2]) < height * 1e-6], HELD)
    return shape


def _name(faces: Any, name: str) -> None:
    for face in getattr(faces, "faces", faces):
        face.name = name


def _centre(face: Any) -> np.ndarray:
    return np.array([face.center.x, face.center.y, face.center.z])


def _on_frame(plan: Plan, system: System) -> PadModes:
    """Return modes of all taxels of `plan` on the solid frame of `system`."""
    solve = factored(system)
    plate = plate_shape(plan.spec)
    models = [
        TaxelModel(plan.spec, beam.topology, plate, BeamShape(beam.width_mm, beam.thickness_mm, beam.length_mm))
        for beam in (channel.beam for channel in plan.channels)
    ]
    loads = []
    pulls = np.zeros((system.free.size, len(plan.taxels)))
    for index, taxel in enumerate(plan.taxels):
        model = models[taxel.channel]
        turn = _turn(plan, taxel)
        centre = turn @ (model.body.centroid - model.washer_point_m) / MM + (taxel.x_mm, taxel.y_mm, 0.0)
        working = model.modes.shape[:, model.working]
        for k, placement in enumerate(model.placements):
            tip = to_tip(placement, model.body.centroid)
            stiffness = tip.T @ tip_stiffness(placement.section, *model.elastic[:2]) @ tip
            load = rigid_loads(system, f"root{index}-{k}", 1.0, *centre) @ np.kron(np.eye(2), turn)
            loads.append((index, stiffness, load))
            pulls[:, index] += load @ stiffness @ working
    ritz = np.array([solve(pull * system.free) for pull in pulls.T]).T
    ritz = ritz / np.sqrt(np.einsum("ik,ik->k", ritz, system.mass_times(ritz)))
    hung = []
    for index, taxel in enumerate(plan.taxels):
        model = models[taxel.channel]
        inverse = np.linalg.inv(model.modes.shape)
        joints = [(stiffness, load.T @ ritz) for of, stiffness, load in loads if of == index]
        hung.append(MountedTaxel(inverse.T @ inverse, joints, model.modes.at_point(model.washer_point_m)[2] @ inverse))
    modes = coupled_modes(ritz.T @ system.stiffness_times(ritz), ritz.T @ system.mass_times(ritz), hung)
    return modes._replace(unknowns=int(system.free.sum()))


def coupled_modes(stiffness: np.ndarray, mass: np.ndarray, taxels: Sequence[MountedTaxel]) -> PadModes:
    """Return modes of `taxels` on a frame of `stiffness` and `mass` (n, n)."""
    from scipy.linalg import eigh

    frame = slice(0, len(mass))
    size = len(mass) + 6 * len(taxels)
    whole = np.zeros((size, size))
    heavy = np.zeros((size, size))
    pulls = np.zeros((len(taxels), size))
    whole[frame, frame] = stiffness
    heavy[frame, frame] = mass
    for index, taxel in enumerate(taxels):
        rows = slice(len(mass) + 6 * index, len(mass) + 6 * index + 6)
        heavy[rows, rows] = taxel.mass
        pulls[index, rows] = taxel.pull
        for beam, root in taxel.beams:
            whole[frame, frame] += root.T @ beam @ root
            whole[rows, rows] += beam
            whole[rows, frame] -= beam @ root
            whole[frame, rows] -= (beam @ root).T
    square, vectors = eigh(whole, heavy)
    return PadModes(square, pulls @ vectors)


def peak_hz(plan: Plan, modes: PadModes, taxel: int) -> float:
    """Return the frequency of a taxel's highest response to a force on itself, near its channel's resonance."""
    channel = plan.channels[plan.taxels[taxel].channel]
    low = 0.7 * channel.resonance_hz
    high = 1.3 * channel.resonance_hz
    q = channel.q
    for _ in range(6):
        grid = np.linspace(low, high, 61)
        at = int(np.abs(modes.receptance(taxel, grid, q)[:, taxel]).argmax())
        low, high = grid[max(at - 1, 0)], grid[min(at + 1, 60)]
    return float((low + high) / 2)


def shift(plan: Plan, on_frame: PadModes, held: PadModes, taxel: int) -> float:
    """Return a taxel's relative resonance shift: frequency on the real frame over that on a held one, minus 1."""
    return peak_hz(plan, on_frame, taxel) / peak_hz(plan, held, taxel) - 1


def central_taxels(plan: Plan) -> list[int]:
    """Return for each channel on the pad the index of its taxel nearest to the pad's centre."""
    taxels = plan.taxels
    return [
        min((k for k, t in enumerate(taxels) if t.channel == c), key=lambda k: np.hypot(taxels[k].x_mm, taxels[k].y_mm))
        for c in sorted({taxel.channel for taxel in taxels})
    ]
