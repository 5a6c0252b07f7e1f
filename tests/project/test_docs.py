"""Every command and every piece of code in the pages runs, and the documentation builds without a warning."""

import ast
import json
import re
import shlex
from pathlib import Path

import pytest
from PIL import Image

import padgen as pg
from padgen import cli
from padgen.cli import _parsed
from padgen.core.errors import PadgenError
from padgen.planner import explain, plan_to_json

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md", *sorted((ROOT / "docs").glob("*.md"))]
RUN = ("README.md", "docs/tutorial.md", "docs/howto.md")
"""Pages whose fenced blocks are run in order, `text` excepted, which needs a printer or a sound card."""
FENCED = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"^(?:    )?(?:\$ )?(padgen [a-z].*)$", re.MULTILINE)


def commands(text: str) -> list[str]:
    """Return the lines of a page's code that call padgen."""
    inside = [block for _, block in FENCED.findall(text)]
    inside += re.findall(r"^    \S.*$", FENCED.sub("", text), re.MULTILINE)
    return [found for block in inside for found in COMMAND.findall(block)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_in_pages_have_the_options_of_the_code(page):
    for line in commands(page.read_text(encoding="utf-8")):
        words = [word for word in shlex.split(line, comments=True)[1:] if word not in ("...", "…")]
        if ">" in words:
            words = words[: words.index(">")]
        try:
            _parsed(words)
        except PadgenError as error:
            pytest.fail(f"{page.name}: {line}: {error}")


@pytest.mark.parametrize("name", RUN)
def test_code_of_the_page_runs(name, tmp_path, monkeypatch, capsys):
    """In this process: starting Python anew for each line takes longer than most of them; few changes are explained."""
    monkeypatch.chdir(tmp_path)
    planned = explain._changes
    monkeypatch.setattr(explain, "_changes", lambda plan, asked: planned(plan, asked)[:2])
    monkeypatch.setattr(explain, "MOVERS_COMPARED", explain.MOVERS_COMPARED[:1])
    text = (ROOT / name).read_text(encoding="utf-8")
    if name == "README.md":
        given_files()
    for kind, block in FENCED.findall(text):
        if kind == "toml":
            # A block names its file in its first line; the others are the page's own spec.
            named = re.match(r"# (\S+\.toml)\n", block)
            (tmp_path / (named.group(1) if named else "mine.toml")).write_text(block, encoding="utf-8")
        elif kind == "sh":
            for line in block.strip().splitlines():
                command, *words = shlex.split(line, comments=True)
                assert command == "padgen", line
                assert cli.run(words) == 0, f"{line}: {capsys.readouterr().err}"
                told = capsys.readouterr().err
                assert "error" not in told, f"{line}: {told}"
        elif kind == "python":
            exec(compile(block, name, "exec"), {"__name__": "page"})
    if name == "docs/tutorial.md":
        # It ends with more than it asked for, held and on average, as its text says.
        heard = json.loads(Path("out/mine/hear.json").read_text(encoding="utf-8"))
        kept = heard["summary"]["selectivity_db"], heard["summary"]["slot_db"]
        assert min(kept) > heard["asked_db"]
        assert kept == pytest.approx((25.5, 25.5), abs=0.5)


def given_files():
    """Make the picture and the measurements that the README's lines of Python read."""
    plan = pg.plan("paper-32", q_min=20)
    Image.new("L", (4, 8), 255).save("cross.png")
    Path("plan.json").write_text(plan_to_json(plan))
    assert cli.run(["retune", "plan.json", "--simulate", "1", "-o", "."]) == 0


def every_file() -> str:
    """Return a line for each file of padgen that has a docstring of its own: its name and what it begins with."""
    lines = []
    for path in sorted((ROOT / "padgen").rglob("*.py")):
        told = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
        if told and path.stem not in ("__init__", "__main__"):
            lines.append(f"- `{path.relative_to(ROOT / 'padgen').as_posix()}`: {told.splitlines()[0]}")
    return "\n".join(lines)


def test_every_file_is_listed(request):
    """CONTRIBUTING.md says of every file what it holds."""
    page = ROOT / "CONTRIBUTING.md"
    head, title, rest = page.read_text(encoding="utf-8").partition("## Every file\n\n(")
    told, _, rest = rest.partition("\n")
    _, following, rest = rest.partition("\n## ")
    if request.config.getoption("--regenerate"):
        page.write_text(f"{head}{title}{told}\n\n{every_file()}\n{following}{rest}", encoding="utf-8")
    assert f"\n\n{every_file()}\n\n## " in page.read_text(encoding="utf-8"), "make goldens writes the list anew"
