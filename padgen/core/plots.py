"""How plots are styled and written: the same figures give the same bytes, on every machine with the same versions."""

import io
from typing import Any

__all__ = ["STYLE", "plot_bytes"]

STYLE = {"svg.hashsalt": "padgen", "svg.fonttype": "path", "font.size": 9, "font.family": "DejaVu Sans"}


def plot_bytes(figure: Any, kind: str) -> bytes:
    """A matplotlib figure as ``svg`` or ``png``."""
    out = io.BytesIO()
    metadata: dict[str, Any] = {"Date": None} if kind == "svg" else {"Software": None}
    figure.savefig(out, format=kind, dpi=120, metadata=metadata, facecolor="white")
    return out.getvalue()
