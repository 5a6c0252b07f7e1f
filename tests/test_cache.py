"""The cache of dear results: it only ever saves time."""

import json
import os

import pytest

from padgen import cache


@pytest.fixture
def entries(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_what_was_stored_comes_back(entries):
    key = cache.key_of({"b": 1.5, "a": [1, 2]})
    assert cache.load("kind", key) is None
    cache.store("kind", key, {"x": [1.25]})
    assert cache.load("kind", key) == {"x": [1.25]}
    assert cache.load("another", key) is None
    assert [p.suffix for p in entries.rglob("*") if p.is_file()] == [".json"]


def test_the_key_depends_on_values_not_on_their_order():
    assert cache.key_of({"a": 1, "b": 2}) == cache.key_of({"b": 2, "a": 1})
    assert cache.key_of({"a": 1, "b": 2}) != cache.key_of({"a": 1, "b": 3})


@pytest.mark.parametrize("text", ["", "{", "[]", '{"result": 1}', '{"key": "other", "result": 1}', "\x00"])
def test_a_corrupt_entry_counts_as_absent(entries, text):
    key = cache.key_of(1)
    cache.store("kind", key, 1)
    (path,) = [p for p in entries.rglob("*") if p.is_file()]
    path.write_text(text)
    assert cache.load("kind", key) is None
    cache.store("kind", key, 2)
    assert cache.load("kind", key) == 2


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "file"))
    cache.store("kind", cache.key_of(1), 1)
    assert cache.load("kind", cache.key_of(1)) is None


def test_an_entry_is_written_aside_first(entries, monkeypatch):
    """Killed before the renaming, a writer leaves no entry."""
    monkeypatch.setattr("pathlib.Path.replace", lambda self, target: None)
    cache.store("kind", cache.key_of(1), 1)
    assert cache.load("kind", cache.key_of(1)) is None
    (aside,) = [p for p in entries.rglob("*") if p.is_file()]
    assert aside.name.endswith(f".{os.getpid()}")
    assert json.loads(aside.read_text())["result"] == 1


def test_the_users_own_folder_is_the_default(monkeypatch, tmp_path):
    monkeypatch.delenv(cache.VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr("sys.platform", "linux")
    assert cache.folder() == tmp_path / "padgen"


def test_the_code_hash_tells_parts_apart():
    assert cache.code_hash("solid") != cache.code_hash("physics")
    assert cache.code_hash("solid") == cache.code_hash("solid")
    assert cache.version("numpy") != "missing"
    assert cache.version("no-such-package-at-all") == "missing"
