"""The STEP format: of a pad, one taxel with its washer per channel; of other parts, the CAD solid; no coupon."""

import itertools
import re
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from padgen.core import cache
from padgen.core.errors import GeometryError
from padgen.core.files import OutputFolder
from padgen.planner.plan import Channel, Plan
from padgen.solid.formats import ExportJob
from padgen.solid.kernel import build123d, kernel_errors
from padgen.solid.taxel import ballast_solid, taxel_key, taxel_solid, washer_solid

__all__ = ["write", "write_taxel_step"]

STEP_KIND = "taxel-step"
_UNNAMED = "unnamed taxel of padgen"
"""Placeholder in cached files for the pad's name and the channel's number."""


def write(out: OutputFolder, job: ExportJob) -> None:
    """Write a STEP file of each channel's taxel if the part is the pad, else of the part's CAD solid if it has one."""
    if job.pad is not None:
        for channel in job.plan.channels:
            out.write_by(f"taxel-{channel.index}.step", partial(write_taxel_step, job.plan, channel))
    elif job.part.solid is not None:
        out.write_by(f"{job.part.name}.step", lambda path: _write_step(path, job.part.title, job.part.solid))


def write_taxel_step(plan: Plan, channel: Channel, path: Path) -> None:
    """Write the STEP file of a channel's taxel.

    It has named solids in the taxel's own axes: ``printed``, the taxel in the frame of its sub-cell, ``washer``, where
    the glue holds it, and ``ballast`` where there is any. Read back, they must have the same volumes. The file is
    cached as the taxel's triangles are (`padgen.solid.taxel`).
    """
    writer = cache.code_hash("solid/formats/step.py")
    ballast = {"ballast": asdict(plan.spec.ballast)} if plan.spec.ballast else {}
    key = taxel_key(plan, channel, washer=asdict(plan.spec.washer_or_magnet), step=_UNNAMED, writer=writer, **ballast)

    def made() -> bytes:
        printed = taxel_solid(plan, channel)
        washer = washer_solid(plan, channel)
        ballast = ballast_solid(plan, channel)
        solids = {"printed": printed, "washer": washer, "ballast": ballast}
        for label, solid in solids.items():
            if solid is not None:
                solid.label = label
        _write_step(path, _UNNAMED, *(solid for solid in solids.values() if solid is not None))
        cache.store_bytes(STEP_KIND, key, path.read_bytes())
        return path.read_bytes()

    known = cache.get_or_compute(STEP_KIND, key, lambda: cache.load_bytes(STEP_KIND, key), made)
    path.write_bytes(known.replace(_UNNAMED.encode(), f"{plan.name} taxel {channel.index}".encode()))


def _write_step(path: Path, label: str, *solids: Any) -> None:
    """Write solids as one STEP shape named `label`; raise GeometryError if their volumes, read back, differ."""
    b = build123d()
    planned = sorted(float(solid.volume) for solid in solids)
    with kernel_errors(path.name):
        whole = b.Compound(children=solids) if len(solids) > 1 else solids[0]
        whole.label = label
        b.export_step(whole, path, timestamp="1970-01-01T00:00:00")
        # Parts of an assembly are numbered from 1, since OCCT goes on counting through all files of a process.
        part = r"(NEXT_ASSEMBLY_USAGE_OCCURRENCE\(')\d+'"
        number = itertools.count(1)
        path.write_text(re.sub(part, lambda match: f"{match[1]}{next(number)}'", path.read_text()))
        back = sorted(float(solid.volume) for solid in b.import_step(path).solids())
    if len(back) != len(planned) or not np.allclose(back, planned, rtol=1e-6):
        raise GeometryError(f"read back, its solids have {back} mm³, must have {planned} mm³", path.name)
