"""Model a taxel as a frame of beam elements: beams with flared roots, crossbar and neck as flexible beams.

It is one step more exact than `TaxelModel`, whose crossbar and neck have no motion of their own and whose beams have
the mass of their static cubic deflection. Washer and plate stay rigid.
"""

from itertools import pairwise
from math import ceil, pi

import numpy as np

from padgen.core.units import MM
from padgen.physics.beams import BeamSection, bend_stiffening, flexibility, piece_twist
from padgen.physics.modes import RigidBody, box
from padgen.planner.suspensions import BeamPath, Segment
from padgen.planner.taxel_model import TaxelModel
from padgen.verify.frame import AttachedBody, Element, Frame, Section, rectangle

__all__ = ["taxel_frame"]

FLARE_ELEMENTS = 4
INNER_MOTIONS = 2
MOST_TURN_RAD = pi / 12
"""Largest turn of an arc within one element: its chord is 0.3 % shorter than the arc."""


def taxel_frame(model: TaxelModel, elements: int = 4, *, rigid_crossbar: bool = False) -> Frame:
    """Return the frame of one taxel in its own axes, in m, with `elements` along each beam beyond its flare.

    The first body is the plate with boss and washer: in the frame's modes `body_motion[:, 0]` is at its centroid. With
    `rigid_crossbar` crossbar and neck are rigid, and the beams' tips have the crossbar's twist instead, as in
    `TaxelModel`, which bends both, too.
    """
    builder = _Builder(model)
    whole = rigid_crossbar or not model.arrangement.yoke
    tips = [builder.beam(k, elements, with_yoke=whole) for k in range(len(model.placements))]
    bodies = [AttachedBody(model.body, tuple(tips))] if whole else builder.yoke(tips)
    nodes = np.array(builder.nodes)
    bars = tuple(builder.elements)
    roots = tuple(builder.roots)
    return Frame(nodes, bars, tuple(bodies), roots, bubbles=INNER_MOTIONS)


def _stations(path: BeamPath, fillet: float, elements: int) -> list[tuple[int, float]]:
    """Return a beam's element ends, closer in the root's flare, as (segment index, share of the segment)."""
    stations: list[tuple[int, float]] = []
    flare = min(fillet / (float(path.segments[0].length_mm) * MM), 1.0)
    for index, segment in enumerate(path.segments):
        start = 0.0 if index or flare <= 0 else flare
        if start:
            stations += [(0, float(at)) for at in np.linspace(0, flare, FLARE_ELEMENTS + 1)[:-1]]
        share = float(segment.length_mm) / float(path.length_mm)
        count = ceil(max(elements * share, abs(float(segment.turn_rad)) / MOST_TURN_RAD) - 1e-9)
        stations += [(index, float(at)) for at in np.linspace(start, 1, count + 1)[bool(index) :]]
    return stations


class _Builder:
    """Collects the nodes and elements of one taxel's frame."""

    def __init__(self, model: TaxelModel) -> None:
        self.model = model
        self.modulus, self.poisson, self.density = model.elastic
        self.nodes: list[np.ndarray] = []
        self.elements: list[Element] = []
        self.roots: list[int] = []

    def node(self, place: np.ndarray) -> int:
        """Add a node at `place` (3,) in m and return its index."""
        self.nodes.append(np.asarray(place, float))
        return len(self.nodes) - 1

    def bar(self, start: int, end: int, section: Section) -> None:
        """Add an element of the taxel's material between two nodes."""
        shear_modulus = self.modulus / (2 * (1 + self.poisson))
        self.elements.append(Element(start, end, section, self.modulus, shear_modulus, self.density))

    def beam(self, index: int, elements: int, *, with_yoke: bool) -> int:
        """Add one beam with elastic hinges at both ends, its root clamped; return the index of its tip's node.

        `with_yoke` gives the tip the compliance of the crossbar, which has no elements of its own then.
        """
        placement = self.model.placements[index]
        path = self.model.arrangement.beams[index]
        section = placement.section if with_yoke else self.model.beside_yoke(placement.section)
        before = np.cumsum([0.0, *(float(segment.length_mm) for segment in path.segments)]) * MM
        nodes = list[int]()
        at = list[float]()
        for k, share in _stations(path, float(section.fillet), elements):
            point = path.within(k, share)
            nodes.append(self.node(np.array([float(point.x_mm) * MM, float(point.y_mm) * MM, placement.tip[2]])))
            at.append(before[k] + share * (before[k + 1] - before[k]))
        self.roots.append(nodes[0])
        for (start, end), (low, high) in zip(pairwise(nodes), pairwise(at), strict=True):
            piece = path.segments[int(np.searchsorted(before, (low + high) / 2)) - 1]
            self.bar(start, end, self._section_at(section, (low + high) / 2, piece))
        # Hinges at both ends, as compliant as the parts that hold the beam.
        first = 1 - len(nodes)
        parts = flexibility(section, self.modulus, self.poisson)
        root = (float(parts.root), float(parts.lateral_root))
        tip = (float(parts.tip), float(parts.lateral_tip))
        self.elements[first] = self.elements[first]._replace(hinge_start=root)
        self.elements[-1] = self.elements[-1]._replace(hinge_end=tip)
        return nodes[-1]

    def _section_at(self, section: BeamSection, at: float, piece: Segment) -> Section:
        """Return a beam's cross-section `at` m from its root, on segment `piece`, with flare and end compliance.

        The compliance of the beam's ends in shear and twist is spread along the beam.
        """
        radius = float(section.fillet)
        flare = 2 * (radius - np.sqrt(max(radius**2 - max(radius - at, 0.0) ** 2, 0.0)))
        parts = flexibility(section, self.modulus, self.poisson)
        wide = float(section.width) + flare
        high = float(section.thickness)
        across = float(section.across)
        length = float(piece.length_mm) * MM
        turn = abs(float(piece.turn_rad))
        plain = rectangle(wide, high, self.poisson, across)
        bent = bend_stiffening(turn * wide / (2 * length))
        twisting = 1.0 if turn else float(piece_twist(length, section.ends.warping))
        return plain._replace(
            inertia_up=plain.inertia_up / (1 - float(np.asarray(section.ends.curl_pure))) * bent,
            torsion=plain.torsion * float(parts.twist / (parts.twist + parts.end_twist)) * bent / twisting,
            shear_up=plain.shear_up * float(parts.shear / (parts.shear + parts.end_shear)),
            shear_across=plain.shear_across
            * float(parts.lateral_shear / (parts.lateral_shear + parts.lateral_end_shear)),
        )

    def yoke(self, tips: list[int]) -> list[AttachedBody]:
        """Add neck and crossbar between plate and beam tips; return the rigid bodies: plate and joints."""
        plate, neck, crossbar = self.model.arrangement.blocks
        height = float(crossbar.height_mm) * MM
        middle_x = float(crossbar.low_x_mm + crossbar.high_x_mm) / 2 * MM
        half_neck = float(neck.high_y_mm) * MM
        bar = rectangle(float(crossbar.high_x_mm - crossbar.low_x_mm) * MM, height, self.poisson)
        joint = list[int]()
        bodies = list[AttachedBody]()
        for tip in tips:
            y = self.nodes[tip][1]
            inner = self.node(np.array([middle_x, np.sign(y) * half_neck, height / 2]))
            outer = self.node(np.array([middle_x, y, height / 2]))
            self.bar(inner, outer, bar)
            joint.append(inner)
            joined = RigidBody(np.zeros(()), self.nodes[outer], np.zeros((3, 3)))  # without mass
            bodies.append(AttachedBody(joined, (tip, outer)))
        fast = self.node(np.array([float(neck.low_x_mm) * MM, 0.0, height / 2]))
        end = self.node(np.array([float(neck.high_x_mm) * MM, 0.0, height / 2]))
        self.bar(fast, end, rectangle(2 * half_neck, height, self.poisson))
        # The middle of the crossbar is rigid, as wide as the neck that is attached to it.
        low = float(crossbar.low_x_mm) * MM
        high = float(crossbar.high_x_mm) * MM
        middle = box((low, -half_neck, 0.0), (high, half_neck, height), self.density)
        bodies.append(AttachedBody(middle, (end, *joint)))
        return [AttachedBody(self.model.body_of([plate]), (fast,)), *bodies]
