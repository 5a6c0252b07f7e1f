"""Every command and every piece of code in the pages runs, and the documentation builds without a warning."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from padgen.cli import _parsed
from padgen.core.errors import PadgenError

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
RUN = ("tutorial.md", "howto.md")
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
def test_code_of_the_page_runs(name, tmp_path):
    text = (ROOT / "docs" / name).read_text(encoding="utf-8")
    env = {**os.environ, "PYTHONPATH": str(ROOT), "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    command = tmp_path / "padgen"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m padgen "$@"\n')
    command.chmod(0o755)
    for kind, block in FENCED.findall(text):
        if kind == "toml":
            # A block names its file in its first line; the others are the page's own spec.
            named = re.match(r"# (\S+\.toml)\n", block)
            (tmp_path / (named.group(1) if named else "mine.toml")).write_text(block, encoding="utf-8")
        elif kind == "sh":
            for line in block.strip().splitlines():
                ran = subprocess.run(["sh", "-c", line], cwd=tmp_path, env=env, capture_output=True, text=True)
                assert ran.returncode == 0, f"{line}: {ran.stderr}"
                assert "error" not in ran.stderr, f"{line}: {ran.stderr}"
        elif kind == "python":
            ran = subprocess.run([sys.executable, "-c", block], cwd=tmp_path, env=env, capture_output=True, text=True)
            assert ran.returncode == 0, ran.stderr
