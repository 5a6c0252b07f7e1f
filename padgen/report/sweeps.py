"""Describe sweeps and the cache as text for people, and as plain data."""

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from padgen.core.display import seconds_text, table
from padgen.core.errors import number, plain

if TYPE_CHECKING:
    from padgen.batch.definition import Sweep
    from padgen.batch.index import Overview
    from padgen.batch.sweep import Event, SweepResult
    from padgen.core.cache import CacheInfo

__all__ = ["cache_text", "counts_text", "sweep_table", "sweep_text"]

MOST_ROWS = 12
"""Most variants of a Pareto front that are all shown; of a longer front only the best in each objective are."""


def sweep_text(sweep: "Sweep", result: "SweepResult", files: Sequence[str]) -> str:
    """Return the counts of a sweep's variants, a table of the best, and where the results are."""
    overview = result.overview
    lines = [
        f"{sweep.settings.name}: {_variants(result.total)}, {counts_text(result)}, in {seconds_text(result.seconds)}"
    ]
    if result.kept:
        lines.append(f"{result.kept} of them were finished before and not made again")
    if overview.with_errors:
        lines.append(f"{overview.with_errors} of those made have error findings, in the column findings of the index")
    lines += [f"refused: {name}: {sentence}" for name, sentence in overview.refused]
    if result.refused > len(overview.refused):
        lines.append(f"… and {result.refused - len(overview.refused)} more refused, in the index")
    if overview.rows:
        lines += ["", _front_line(overview), table(*_front_rows(sweep, overview))]
    lines += ["", f"written to {plain(str(result.folder))}: {', '.join(('index.csv', *files))}"]
    return "\n".join(line.rstrip() for line in "\n".join(lines).splitlines())


def counts_text(event: "Event | SweepResult") -> str:
    """Return the counts of variants done and failed, and of those refused and left if there are any."""
    counts = [f"{event.done} done", f"{event.refused} refused" * bool(event.refused), f"{event.failed} failed"]
    return ", ".join(count for count in [*counts, f"{event.left} left" * bool(event.left)] if count)


def _variants(count: int) -> str:
    return "1 variant" if count == 1 else f"{count} variants"


def _front_line(overview: "Overview") -> str:
    from padgen.batch.index import OBJECTIVES

    weighed = ", ".join(OBJECTIVES[name].word for name in overview.objectives)
    told = f"Pareto front over {weighed}: {_variants(len(overview.rows))} that no other beats"
    told += "; every variant has error findings" * overview.of_faulty
    return told + "; those best in one of these:" if len(overview.rows) > MOST_ROWS else f"{told}:"


def _front_rows(sweep: "Sweep", overview: "Overview") -> tuple[list[str], list[list[str]]]:
    """Return headings and rows of the front: varied fields, objectives reached, and the objectives it is best in."""
    from padgen.batch.index import OBJECTIVES

    axes, objectives = [name for axis in sweep.axes for name in axis.fields], overview.objectives
    best: dict[int, list[str]] = {row: [] for row in range(len(overview.rows)) if len(overview.rows) <= MOST_ROWS}
    for objective, row in overview.best().items():
        best.setdefault(row, []).append(OBJECTIVES[objective].word)
    varied = [overview.header.index(name) for name in ("number", *axes)]
    reached = [overview.header.index(name) for name in objectives]
    cells = [
        [*(_cell(overview.rows[row][i]) for i in varied), *(_cell(overview.rows[row][i] or "-") for i in reached), told]
        for row in sorted(best)
        for told in (", ".join(best[row]),)
    ]
    return ["variant", *_short_names(axes), *(OBJECTIVES[name].heading for name in objectives), "best in"], cells


def _short_names(names: Sequence[str]) -> list[str]:
    """Shorten dotted names to their last parts where these differ."""
    last = [name.rsplit(".", 1)[-1] for name in names]
    count = Counter(last)
    return [short if count[short] == 1 else name for short, name in zip(last, names, strict=True)]


def _cell(text: str) -> str:
    try:
        return number(float(text)) if "." in text or "e" in text else text
    except ValueError:
        return text


def sweep_table(sweep: "Sweep", result: "SweepResult", files: Sequence[str]) -> dict[str, Any]:
    """Return the summary of a sweep as plain data: the last line of ``--json``."""
    overview = result.overview
    at = {name: overview.header.index(name) for name in ("number", "name")} if overview.rows else {}
    counts = {key: getattr(result, key) for key in ("total", "done", "refused", "failed", "kept", "left", "seconds")}
    return {
        "kind": "summary",
        "name": sweep.settings.name,
        "stage": sweep.settings.stage,
        "folder": str(result.folder),
        "files": ["index.csv", *files],
        **counts,
        "stopped": result.stopped,
        "interrupted": result.interrupted,
        "with_errors": overview.with_errors,
        "objectives": list(overview.objectives),
        "front": [int(row[at["number"]]) for row in overview.rows],
        "best": {
            objective: {
                "number": int(overview.rows[row][at["number"]]),
                "name": overview.rows[row][at["name"]],
                "value": float(overview.values[row, overview.objectives.index(objective)]),
            }
            for objective, row in overview.best().items()
        },
    }


def cache_text(held: "CacheInfo", dropped: bool = False) -> str:
    """Describe the content of the cache, or the content that was dropped from it."""
    if dropped:
        return f"{plain(held.folder)}: {_entries(held.entries)} dropped, {_megabytes(held.bytes)}"
    size = f"{_megabytes(held.bytes)} of {_megabytes(held.limit_bytes)}"
    lines = [f"{plain(held.folder)}: {_entries(held.entries)}, {size}"]
    if held.kinds:
        rows = [(kind, str(entries), _megabytes(size)) for kind, (entries, size) in held.kinds.items()]
        lines.append(table(("kind", "entries", "size"), rows))
    return "\n".join(lines)


def _entries(count: int) -> str:
    return "1 entry" if count == 1 else f"{count} entries"


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{size / 1e3:.1f} kB"
