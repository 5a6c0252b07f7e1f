"""`SweepTable`: what came of the variants of a sweep that a program made, as rows."""

from collections import Counter
from dataclasses import dataclass
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from padgen.batch.definition import Sweep
from padgen.batch.index import Journal
from padgen.batch.points import count_points, variant_name
from padgen.batch.sweep import run_sweep

__all__ = ["SweepTable", "run_to_table"]


@dataclass(frozen=True)
class SweepTable:
    """The variants of a sweep, in the order of their numbers; made by `padgen.sweep`."""

    name: str
    rows: tuple[dict[str, Any], ...]

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of variants by status: done, refused, failed."""
        return dict(Counter(row["status"] for row in self.rows))

    def table(self) -> list[dict[str, Any]]:
        """A dict for each variant: name, status, sentence, the varied fields and the figures, with their units."""
        return [dict(row) for row in self.rows]

    def __repr__(self) -> str:
        counts = ", ".join(f"{count} {status}" for status, count in self.counts.items())
        return f"<Sweep {self.name}: {counts}>"

    def _repr_html_(self) -> str:
        columns = list(dict.fromkeys(name for row in self.rows for name in row))
        head = "".join(f"<th>{escape(name)}</th>" for name in columns)
        lines = ("".join(f"<td>{escape(str(row.get(name, '')))}</td>" for name in columns) for row in self.rows)
        body = "".join(f"<tr>{line}</tr>" for line in lines)
        return f"<p>{escape(repr(self))}</p><table><tr>{head}</tr>{body}</table>"


def run_to_table(sweep: Sweep, folder: Path | None, workers: int | None) -> SweepTable:
    """Run a sweep in `folder`, or in a place that goes afterwards; raises as `run_sweep` does."""
    if folder is None:
        with TemporaryDirectory(prefix="padgen-sweep-") as aside:
            return run_to_table(sweep, Path(aside) / sweep.settings.name, workers)
    run_sweep(sweep, folder, workers=workers)
    with Journal(folder, count_points(sweep)) as journal:
        rows = tuple(
            {
                "name": variant_name(sweep, record.number),
                "status": record.status,
                "sentence": record.sentence,
                **record.values,
                **record.figures,
            }
            for record in journal.records()
        )
    return SweepTable(sweep.settings.name, rows)
