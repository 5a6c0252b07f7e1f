"""Draw what the fits of a measurement have seen: data, fit and residual of each taxel, and why one was refused."""

from collections.abc import Sequence
from textwrap import fill

import numpy as np

from padgen.core.display import COLOURS, PALE, plot_bytes, plot_style
from padgen.measured.fits import Curve

__all__ = ["tuning_picture"]

MOST_PANELS, COLUMNS = 12, 3
MOST_POINTS = 400
FLOOR_DB = -60.0


def tuning_picture(curves: Sequence[Curve]) -> bytes:
    """Return a PNG with a panel for each taxel: refused ones first, then those with the largest residual."""
    from matplotlib.figure import Figure

    shown = sorted(curves, key=lambda curve: (not curve.cause, -_misfit(curve)))[:MOST_PANELS]
    rows = -(-len(shown) // COLUMNS)
    with plot_style():
        figure = Figure(figsize=(11, 0.6 + 2.5 * rows), layout="constrained")
        axes = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
        for axis in axes[len(shown) :]:
            axis.set_axis_off()
        for axis, curve in zip(axes, shown, strict=False):
            frequency, data, model = curve.seen
            keep = slice(None, None, -(-len(frequency) // MOST_POINTS))
            top = float(np.abs(data if model is None else model).max()) or 1.0
            lines = [(data, ".", PALE, "measured")]
            if model is not None:
                lines += [(model, "-", COLOURS[0], "fit"), (np.abs(data) - np.abs(model), "-", COLOURS[1], "residual")]
            for values, mark, colour, name in lines:
                level = 20 * np.log10(np.maximum(np.abs(values) / top, 10 ** (FLOOR_DB / 20)))
                axis.plot(frequency[keep], level[keep], mark, color=colour, markersize=3, linewidth=1, label=name)
            axis.set_ylim(FLOOR_DB, 10)
            axis.set_title(curve.id + ": refused" * bool(curve.cause), fontsize=9)
            if curve.cause:
                axis.text(0.02, 0.03, fill(curve.cause, 48), transform=axis.transAxes, fontsize=8, color=COLOURS[1])
        axes[0].legend(fontsize=8, loc="upper right")
        left = f", {len(shown)} of {len(curves)} taxels" if len(shown) < len(curves) else ""
        figure.supxlabel("frequency of the motion, Hz", fontsize=9)
        figure.supylabel("dB of the peak", fontsize=9)
        figure.suptitle(f"measured responses and their fits{left}", fontsize=10)
        return plot_bytes(figure, "png")


def _misfit(curve: Curve) -> float:
    """Return the largest residual over the largest response, 0 where there is no fit."""
    if curve.seen.model is None:
        return 0.0
    return float(np.abs(curve.seen.data - curve.seen.model).max() / np.abs(curve.seen.model).max())
