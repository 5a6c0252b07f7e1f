"""The Pareto front: against its definition, with ties, gaps and errors; its files; memory; the picture."""

import csv
import io

import numpy as np
import pytest

from padgen.batch import index
from padgen.batch.index import (
    BLOCK,
    COLOURED_BY,
    OBJECTIVES,
    RefusedVariants,
    front_mask,
    overview_of,
    pareto_csv,
    write_pareto,
)
from padgen.batch.variant import VariantRecord
from padgen.report.results import _refusal_text

HEADER = ("number", "name", "status", "taxels", "verdict_db", "power_w", "sentence", "seconds")


def row(number, taxels, selectivity, power, status="done", errors=0, sentence="", seconds=0.1, verdict="retune"):
    """Return a record and its row of the index; a figure that is None is missing."""
    figures = {"taxels": taxels, "verdict_db": selectivity, "power_w": power}
    cells = ["" if figure is None else f"{figure:.10g}" for figure in figures.values()]
    record = VariantRecord(
        number, "", status, sentence, {}, {**figures, "verdict": verdict}, errors, 0, (), seconds, 90.0
    )
    return record, (str(number), f"q-{number:05d}", status, *cells, sentence, str(seconds))


def overview(rows):
    return overview_of(HEADER, iter(rows))


def numbers(told):
    return [int(found[0]) for found in told.rows]


def by_definition(scores):
    """Compare every row with every other, as the definition of the front says."""
    return np.array([not any((o >= s).all() and (o > s).any() for o in scores) for s in scores], dtype=bool)


@pytest.mark.sample(2)
@pytest.mark.parametrize(("levels", "columns"), [(3, 1), (3, 2), (3, 5), (20, 2), (20, 3), (10**6, 5)])
def test_front_is_what_the_definition_says(columns, levels):
    # More rows than two blocks, few levels for many ties.
    scores = np.random.default_rng(columns * levels).integers(levels, size=(2 * BLOCK + 77, columns)) / 7
    assert (front_mask(scores) == by_definition(scores)).all()


def test_front_of_nothing_of_one_and_of_equals():
    assert front_mask(np.empty((0, 3))).tolist() == []
    assert front_mask(np.array([[1.0, -np.inf]])).tolist() == [True]
    assert front_mask(np.ones((4, 2))).tolist() == [True] * 4
    assert front_mask(np.array([[1.0, np.inf], [2.0, np.inf], [2.0, 5.0]])).tolist() == [False, True, False]


def test_more_and_less_are_better_where_they_are():
    best = overview((row(0, 4, 20, 1), row(1, 4, 19, 1), row(2, 8, 20, 1.5), row(3, 4, 20, 2)))
    assert numbers(best) == [0, 2]
    assert best.objectives == ("taxels", "verdict_db", "power_w")
    assert best.best() == {"taxels": 1, "verdict_db": 0, "power_w": 0}


def test_equals_stay():
    assert numbers(overview((row(0, 4, 20, 1), row(1, 4, 20, 1), row(2, 4, 19, 1)))) == [0, 1]


def test_selectivity_without_a_limit_is_the_best_and_other_gaps_the_worst():
    assert numbers(overview((row(0, 4, None, 1), row(1, 4, 60, 1)))) == [0]
    assert numbers(overview((row(0, 4, 20, None), row(1, 4, 20, 1)))) == [1]


def test_only_what_was_made_counts_and_errors_stand_apart():
    told = overview(
        (
            row(0, 4, 20, 1),
            row(1, 400, 90, 0.1, errors=2),
            row(2, None, None, None, status="refused", sentence="pad.width_mm: is too small"),
            row(3, None, None, None, status="failed", sentence="took longer than 1 s"),
        )
    )
    assert numbers(told) == [0] and told.front_of == "works"
    assert told.counts == {"done": 2, "refused": 1, "failed": 1} and told.judged["faulty"] == 1
    assert told.faulty.tolist() == [[400, 90, 0.1]]
    assert told.refused == (RefusedVariants(("q-00002",), 1, "pad.width_mm: is too small"),)


def test_variants_refused_for_the_same_reason_are_told_together():
    """Each had a sentence of its own, four lines long, which differed in its last figures only."""
    why = "resolution: 48 taxels cannot be laid out"
    sentences = [f"{why}: {k} of them" for k in range(5)] + ["q_min: too low"] * 2 + ["a: b", "c: d", "e: f"]
    told = overview(
        [row(k, None, None, None, status="refused", sentence=sentence) for k, sentence in enumerate(sentences)]
    )
    assert told.refused == (
        RefusedVariants(("q-00000", "q-00001", "q-00002"), 5, why, False),
        RefusedVariants(("q-00005", "q-00006"), 2, "q_min: too low"),
        RefusedVariants(("q-00007",), 1, "a: b"),
    )
    assert [_refusal_text(refusal) for refusal in told.refused[:2]] == [
        f"refused: q-00000, q-00001, q-00002 and 2 more: {why}; index.csv, column sentence, has each one's details",
        "refused: q-00005, q-00006: q_min: too low",
    ]


def test_where_all_have_errors_they_are_weighed():
    told = overview((row(0, 4, 20, 1, errors=1), row(1, 4, 19, 1, errors=1)))
    assert numbers(told) == [0] and told.front_of == "faulty" and not len(told.faulty)


def test_what_falls_short_is_recommended_only_where_nothing_works():
    short = row(0, 400, 40, 0.1, verdict="short")
    burns = row(1, 900, 90, 0.01, verdict="error")
    told = overview((short, burns, row(2, 4, 20, 1, verdict="good")))
    assert numbers(told) == [2] and told.judged == {"works": 1, "short": 1, "faulty": 1}
    assert told.short.tolist() == [[400, 40, 0.1]] and told.faulty.tolist() == [[900, 90, 0.01]]
    told = overview((short, burns))
    assert numbers(told) == [0] and told.front_of == "short" and not len(told.short)


def test_blocks_and_thinning_change_nothing_on_the_front(monkeypatch):
    rng = np.random.default_rng(3)
    rows = [row(i, *rng.random(3), errors=int(rng.random() < 0.3)) for i in range(700)]
    whole = overview(rows)
    monkeypatch.setattr(index, "CHUNK", 13)
    monkeypatch.setattr(index, "MOST_DRAWN", 50)
    parts = overview(rows)
    assert parts.rows == whole.rows
    assert (parts.values == whole.values).all()
    assert 20 < len(parts.beaten) <= 50 < len(whole.beaten)


def test_ten_thousand_variants_in_bounded_memory():
    rng = np.random.default_rng(4)
    told = overview(row(i, *rng.random(3)) for i in range(10_000))
    assert told.counts == {"done": 10_000}
    everything = np.concatenate([told.values, told.beaten])
    signs = np.array([1 if OBJECTIVES[name].best == "most" else -1 for name in told.objectives])
    assert front_mask(everything * signs).sum() == len(told.rows)
    assert len(told.rows) < 300  # about ln² 10,000 / 2 = 42 of independent figures


def test_csv_has_the_front_and_nothing_that_changes_from_run_to_run():
    text = pareto_csv(overview((row(0, 4, 20, 1), row(1, 8, 20, 2), row(2, 1, 1, 9))))
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [(r["number"], r["best_in"]) for r in rows] == [("0", "verdict_db power_w"), ("1", "taxels")]
    assert not {"seconds", "peak_memory_mb", "status"} & set(rows[0])
    assert text == pareto_csv(overview((row(0, 4, 20, 1, seconds=7), row(1, 8, 20, 2), row(2, 1, 1, 9))))


def test_files_are_the_same_twice(tmp_path):
    rng = np.random.default_rng(5)
    rows = [row(i, 4 * (i % 5 + 1), 10 + 9 * rng.random(), rng.random(), errors=i % 3) for i in range(40)]
    told = overview([*rows, row(40, 1, None, 3)])
    files, note = write_pareto(tmp_path, "q", told)
    assert files == ("pareto.csv", "pareto.svg", "pareto.png") and not note
    first = [(tmp_path / name).read_bytes() for name in files]
    assert first[1].startswith(b"<?xml") and first[2].startswith(b"\x89PNG")
    write_pareto(tmp_path, "q", told)
    assert [(tmp_path / name).read_bytes() for name in files] == first
    assert {p.name for p in tmp_path.iterdir()} == {"manifest.json", *files}


@pytest.mark.parametrize(
    ("rows", "drawn"),
    [
        ([], False),
        ([row(0, None, None, None, status="refused")], False),
        ([row(0, 4, 20, 1)], False),
        ([row(0, 4, 20, 1), row(1, 4, 20, 1)], False),
        ([row(0, 4, None, 1), row(1, 8, None, 1)], False),
        ([row(0, 4, None, 1), row(1, 8, None, 2)], True),
        ([row(0, 4, 20, 0), row(1, 400, 2, -1)], True),
    ],
    ids=["no rows", "none made", "one", "equals", "one objective differs", "no selectivity", "wide, with zero"],
)
def test_odd_sweeps_are_drawn_or_left_out(tmp_path, rows, drawn):
    told = overview(rows)
    files, note = write_pareto(tmp_path, "q", told)
    assert bool(note) == (len(rows) > 1 and not drawn)
    assert ("pareto.png" in files) == drawn
    assert (tmp_path / "pareto.csv").read_text().count("\n") == 1 + len(told.rows)


def test_nobody_is_best_in_what_all_share():
    told = overview((row(0, 4, 20, 1), row(1, 4, 25, 2), row(2, 4, 10, 3)))
    assert told.best() == {"verdict_db": 1, "power_w": 0}


def test_every_objective_has_a_rank_for_colours():
    assert set(OBJECTIVES) == set(COLOURED_BY)
