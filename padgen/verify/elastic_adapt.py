"""Where a taxel's strain energy sits: which edges are worth layers, which elements a high order.

A frame, a plate and a washer hardly bend. The error of a frequency is at most the energy of the parts that
are solved crudely, so these parts are chosen by their share of it in every mode asked for.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from padgen.verify.elastic_material import Elastic
from padgen.verify.elastic_modes import Eigen, System, energy
from padgen.verify.engines import engine

__all__ = ["edge_energy_shares", "energy_shares"]


def energy_shares(system: System, materials: Mapping[str, Elastic], eigen: Eigen) -> np.ndarray:
    """Share (elements, k) of each element in the strain energy of each mode; columns sum to 1."""
    ngs = engine("ngsolve")
    mesh = system.space.mesh
    field = ngs.GridFunction(system.space)
    density = mesh.MaterialCF({name: energy(material, field, field) for name, material in materials.items()})
    shares = []
    for shape in eigen.shape.T:
        field.vec.FV().NumPy()[:] = shape
        held = np.array(ngs.Integrate(density, mesh, element_wise=True).NumPy())
        shares.append(held / held.sum())
    return np.array(shares).T


def edge_energy_shares(netgen_mesh: Any, shares: np.ndarray) -> dict[str, float]:
    """Largest share over the modes of the tetrahedra along each named edge of the solid."""
    nodes = netgen_mesh.Elements3D().NumPy()["nodes"][:, :4].astype(np.int64)
    segments = netgen_mesh.Elements1D().NumPy()
    ends = np.sort(segments["nodes"][:, :2].astype(np.int64), axis=1)
    stride = int(nodes.max()) + 1
    one, other = np.triu_indices(4, 1)
    pairs = np.minimum(nodes[:, one], nodes[:, other]) * stride + np.maximum(nodes[:, one], nodes[:, other])
    found: dict[str, float] = {}
    for index in np.unique(segments["index"]):
        own = ends[segments["index"] == index]
        along = np.isin(pairs, own[:, 0] * stride + own[:, 1]).any(1)
        name = netgen_mesh.GetCD2Name(int(index) - 1)
        found[name] = max(found.get(name, 0.0), float(shares[along].sum(0).max()))
    return found
