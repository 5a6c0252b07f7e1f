"""Style and writing of plots: with the same versions, the same figure gives the same bytes on every machine."""

import io
from typing import Any

__all__ = ["STYLE", "plot_bytes"]

STYLE = {"svg.hashsalt": "padgen", "svg.fonttype": "path", "font.size": 9, "font.family": "DejaVu Sans"}


def plot_bytes(figure: Any, kind: str) -> bytes:
    """Return a matplotlib figure as the bytes of an ``svg`` or ``png`` file."""
    out = io.BytesIO()
    metadata: dict[str, Any] = {"Date": None} if kind == "svg" else {"Software": None}
    figure.savefig(out, format=kind, dpi=120, metadata=metadata, facecolor="white")
    return out.getvalue()
