"""Resistance of a board's nets from pictures of its Gerber files, as gerbv or gerbonara reads them: square pixels.

Nothing of padgen's formulas or layouts is used but sizes of copper and holes. Each pixel of copper is joined to its
four neighbours by the sheet's conductance; the pixels of a plated hole are one node on each layer, joined from layer to
layer by the barrel. Nodes are eliminated in the order of their distance from one pin, the farthest first, so that a
matrix never has more of them than a few tracks are wide.
"""

import subprocess
from itertools import pairwise
from math import ceil, floor

import numpy as np
from PIL import Image
from scipy.linalg.lapack import dposv
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order

INCH_MM = 25.4


def picture(path, corner_mm, size_mm, pixel_mm):
    """Return where gerbv draws a Gerber file: an array (rows from below, columns) of bool."""
    png = path.with_suffix(".png")
    dots_per_inch = f"{INCH_MM / pixel_mm:.6f}"
    # gerbv takes at most some twenty characters for a place or a size.
    window = "x".join(f"{side / INCH_MM:.5f}" for side in size_mm)
    origin = "x".join(f"{at / INCH_MM:.5f}" for at in corner_mm)
    colours = ["-f", "#ffffff", "-b", "#000000"]
    frame = ["-B", "0", "-D", dots_per_inch, "-O", origin, "-W", window]
    subprocess.run(["gerbv", "-x", "png", "-o", png, *colours, *frame, path], check=True, capture_output=True)
    Image.MAX_IMAGE_PIXELS = None
    return np.array(Image.open(png).convert("L"))[::-1] > 127


def gerbonara_picture(path, corner_mm, size_mm, pixel_mm):
    """Return where gerbonara finds copper in a Gerber file: an array (rows from below, columns) of bool.

    It reads lines, arcs, circles and rectangles out of the file; a pixel is copper if its middle lies in one of them.
    """
    from gerbonara import GerberFile
    from gerbonara.utils import MM

    columns, rows = (round(side / pixel_mm) for side in size_mm)
    picture = np.zeros((rows, columns), bool)
    for thing in GerberFile.open(path).objects:
        for shape in thing.to_primitives(MM):
            (left, near), (right, far) = shape.bounding_box()
            first_x = max(floor((left - corner_mm[0]) / pixel_mm), 0)
            first_y = max(floor((near - corner_mm[1]) / pixel_mm), 0)
            last_x = ceil((right - corner_mm[0]) / pixel_mm) + 1
            last_y = ceil((far - corner_mm[1]) / pixel_mm) + 1
            part = picture[first_y:last_y, first_x:last_x]
            y, x = np.indices(part.shape)
            x = (x + first_x + 0.5) * pixel_mm + corner_mm[0]
            y = (y + first_y + 0.5) * pixel_mm + corner_mm[1]
            part |= _is_inside(shape, x, y)
    return picture


def _is_inside(shape, x, y):
    """Return which points lie in a shape of gerbonara's."""
    kind = type(shape).__name__
    if kind == "Circle":
        return np.hypot(x - shape.x, y - shape.y) <= shape.r
    if kind == "Rectangle":
        assert not shape.rotation
        return (np.abs(x - shape.x) <= shape.w / 2) & (np.abs(y - shape.y) <= shape.h / 2)
    start, end = complex(shape.x1, shape.y1), complex(shape.x2, shape.y2)
    point = x + 1j * y
    if kind == "Line":
        along = ((point - start) * np.conj(end - start)).real / abs(end - start) ** 2
        return np.abs(point - start - np.clip(along, 0, 1) * (end - start)) <= shape.width / 2
    assert kind == "Arc"
    centre = complex(shape.cx, shape.cy)
    turn = -1 if shape.clockwise else 1
    swept = np.angle((point - centre) / (start - centre)) * turn % (2 * np.pi)
    on_arc = swept <= np.angle((end - centre) / (start - centre)) * turn % (2 * np.pi)
    from_end = np.minimum(np.abs(point - start), np.abs(point - end))
    away = np.where(on_arc, np.abs(np.abs(point - centre) - abs(start - centre)), from_end)
    return away <= shape.width / 2


def pixel_ohm(layers, sheet_ohm, holes, corner_mm, pixel_mm, pins):
    """Return the resistance in Ω between two of the holes.

    `layers` are pictures, `sheet_ohm` the resistance of a square on each; `holes` are (x, y, diameter in mm, Ω of the
    barrel from each layer to the next), and `pins` the indices of two of them.
    """
    copper = np.array(layers)
    node = np.full(copper.shape, -1)
    count = len(holes) * len(layers)
    rows, columns = np.indices(copper.shape[1:])
    for k, (x, y, diameter, _) in enumerate(holes):
        at_x = (columns + 0.5) * pixel_mm + corner_mm[0] - x
        at_y = (rows + 0.5) * pixel_mm + corner_mm[1] - y
        inside = at_x**2 + at_y**2 < (diameter / 2) ** 2
        for layer in range(len(layers)):
            node[layer][inside] = k * len(layers) + layer
    free = copper & (node < 0)
    node[free] = count + np.arange(free.sum())
    count += int(free.sum())
    node[~copper & (node >= 0)] = -1
    ends = []
    for layer, square_ohm in enumerate(sheet_ohm):
        for one, other in (
            (node[layer, :, :-1], node[layer, :, 1:]),
            (node[layer, :-1], node[layer, 1:]),
        ):
            joined = (one >= 0) & (other >= 0) & (one != other)
            ends.append((one[joined], other[joined], np.full(joined.sum(), 1 / square_ohm)))
    for k, (*_, barrel_ohm) in enumerate(holes):
        at = k * len(layers) + np.arange(len(layers))
        ends.append((at[:-1], at[1:], 1 / np.array(barrel_ohm)))
    first, second, conductance = (np.concatenate(part) for part in zip(*ends, strict=True))
    # All layers of a pin are one node: it is soldered through.
    start = pins[0] * len(layers)
    ground = pins[1] * len(layers)
    for pin in (start, ground):
        for part in (first, second):
            part[(part >= pin) & (part < pin + len(layers))] = pin
    apart = first != second
    return 1 / _conductance(count, first[apart], second[apart], conductance[apart], start, ground)


def _conductance(count, first, second, conductance, start, ground):
    """Return the conductance between the nodes `start` and `ground` of a network."""
    total = np.bincount(first, conductance, count) + np.bincount(second, conductance, count)
    beyond = (first != ground) & (second != ground)
    first, second, conductance = first[beyond], second[beyond], conductance[beyond]
    ones = np.ones(2 * len(first), np.int8)
    graph = coo_matrix((ones, (np.r_[first, second], np.r_[second, first])), (count, count)).tocsr()
    reached, before = breadth_first_order(graph, start, directed=False)
    level = np.full(count, -1)
    level[reached] = 1
    level[start] = 0
    toward = np.where(before < 0, start, before)
    while True:  # doubling the way that each node looks back
        farther = level[toward]
        if not farther[reached].any():
            break
        level[reached] += farther[reached]
        toward = toward[toward]
    used = (level[first] >= 0) & (level[second] >= 0)
    first, second, conductance = first[used], second[used], conductance[used]
    swap = level[first] < level[second]
    high, low = np.where(swap, second, first), np.where(swap, first, second)
    once = coo_matrix((conductance, (high, low)), (count, count)).tocsr().tocoo()  # a hole may touch a pixel twice
    high, low, conductance = once.row, once.col, once.data
    nodes = reached[np.argsort(level[reached], kind="stable")]
    farthest = int(level.max())
    bounds = np.searchsorted(level[nodes], np.arange(farthest + 2))
    place = np.empty(count, int)
    place[nodes] = np.arange(len(nodes)) - bounds[level[nodes]]
    by_level = np.lexsort((level[low] != level[high], level[high]))
    high, low, conductance = high[by_level], low[by_level], conductance[by_level]
    edges = np.searchsorted(level[high], np.arange(farthest + 2))
    carried = np.zeros((1, 1))
    for k in range(farthest, -1, -1):
        own = nodes[bounds[k] : bounds[k + 1]]
        some = slice(edges[k], edges[k + 1])
        is_down = level[low[some]] < k
        matrix = np.diag(total[own])
        if k < farthest:
            matrix -= carried
        a, b, g = place[high[some]], place[low[some]], conductance[some]
        matrix[a[~is_down], b[~is_down]] -= g[~is_down]
        matrix[b[~is_down], a[~is_down]] -= g[~is_down]
        if k == 0:
            return float(matrix[0, 0])
        down = np.zeros((len(own), bounds[k] - bounds[k - 1]))
        down[a[is_down], b[is_down]] = g[is_down]
        carried = down.T @ dposv(matrix, down)[1]
    raise AssertionError("no way from pin to pin")


def barrel_ohms(depth_m, drill_m, plating_m, ohm_m):
    """Return the resistances in Ω of a plated hole from each layer to the next."""
    section = np.pi * (drill_m - plating_m) * plating_m
    return [ohm_m * (b - a) / section for a, b in pairwise(depth_m)]
