"""The cache of slow results: it changes run times and nothing else."""

import fcntl
import os
import subprocess
import sys
import time
from hashlib import sha256
from pathlib import Path

import pytest

import padgen as pg
from padgen.core import cache
from padgen.core.errors import SpecError
from padgen.core.files import lock_file
from padgen.core.rules import Rule
from padgen.planner import make_plan
from padgen.planner.judge import PLAN_RULES
from padgen.spec import load_spec

KEYS = [cache.key_of(n) for n in range(200)]


@pytest.fixture
def entries(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_what_was_stored_comes_back(entries):
    key = cache.key_of({"b": 1.5, "a": [1, 2]})
    assert cache.load("kind", key) is None
    cache.store("kind", key, {"x": [1.25]})
    assert cache.load("kind", key) == {"x": [1.25]}
    assert cache.load("another", key) is None
    cache.store_bytes("kind", KEYS[0], b"\n\x00 two\nlines\n")
    assert cache.load_bytes("kind", KEYS[0]) == b"\n\x00 two\nlines\n"
    assert [p.suffix for p in files(entries)] == [".entry", ".entry"]


def test_the_key_depends_on_values_not_on_their_order():
    assert cache.key_of({"a": 1, "b": 2}) == cache.key_of({"b": 2, "a": 1})
    assert cache.key_of({"a": 1, "b": 2}) != cache.key_of({"a": 1, "b": 3})


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", ["paper-32", "wide-11", "fingertip-24"])
def test_a_kept_plan_is_the_plan(entries, monkeypatch, name):
    """To the last digit, while plan.json has ten."""
    first = pg.plan(name)
    assert [path.parts[-3] for path in files(entries) if path.suffix == ".entry"].count("plan") == 1
    monkeypatch.setattr("padgen.planner.make.make_plan", lambda spec: pytest.fail("planned anew"))
    assert pg.plan(name) == first == make_plan(load_spec(name))


def test_a_plan_is_made_anew_where_something_else_may_plan(entries):
    """Another spec, a registered rule, and an entry that is no plan."""
    pg.plan("paper-16")
    (kept,) = (path for path in files(entries) if path.suffix == ".entry" and path.parts[-3] == "plan")
    assert pg.plan("paper-16", q_min=16).spec.q_min == 16
    PLAN_RULES.register("toy", lambda plan: [Rule(False, "pad", "is a toy", code="toy", level="note")])
    try:
        assert "toy" in {finding.code for finding in pg.plan("paper-16").findings}
    finally:
        PLAN_RULES.unregister("toy")
    assert "toy" not in {finding.code for finding in pg.plan("paper-16").findings}
    cache.store("plan", kept.stem, {"spec": {}})
    assert len(pg.plan("paper-16").taxels) == 16


def spoilt(whole: bytes, how: str) -> bytes:
    middle = len(whole) - 3
    return {
        "empty": b"",
        "cut": whole[:-1],
        "longer": whole + b" ",
        "bit": whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :],
        "head": b"0" + whole[1:],
        "no head": whole.partition(b"\n")[2],
        "old": b'{"key": "other", "result": 1}',
        "zeros": bytes(len(whole)),
    }[how]


@pytest.mark.parametrize("how", ["empty", "cut", "longer", "bit", "head", "no head", "old", "zeros"])
def test_a_corrupt_entry_counts_as_absent(entries, how):
    cache.store("kind", KEYS[0], [1, 2, 3])
    (path,) = files(entries)
    path.write_bytes(spoilt(path.read_bytes(), how))
    assert cache.load("kind", KEYS[0]) is None
    cache.store("kind", KEYS[0], 2)
    assert cache.load("kind", KEYS[0]) == 2


def test_an_entry_under_anothers_name_counts_as_absent(entries):
    cache.store("kind", KEYS[0], 1)
    (path,) = files(entries)
    other = entries / "kind" / KEYS[1][:2] / f"{KEYS[1]}.entry"
    other.parent.mkdir(parents=True, exist_ok=True)
    path.rename(other)
    assert cache.load("kind", KEYS[1]) is None


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "file"))
    cache.store("kind", KEYS[0], 1)
    assert cache.load("kind", KEYS[0]) is None
    assert cache.info().entries == cache.clear().entries == 0


def test_a_full_disk_is_no_error_and_leaves_nothing(entries, monkeypatch):
    def full(self: Path, data: bytes) -> int:
        with self.open("wb") as file:
            file.write(data[:5])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    cache.store("kind", KEYS[0], 1)
    assert files(entries) == []


def test_an_entry_is_written_aside_first(entries, monkeypatch):
    """A writer killed before the renaming leaves no entry, but a file that is counted and cleared."""
    monkeypatch.setattr("pathlib.Path.replace", lambda self, target: None)
    cache.store("kind", KEYS[0], 1)
    assert cache.load("kind", KEYS[0]) is None
    (aside,) = files(entries)
    assert f".{os.getpid()}-" in aside.name
    assert cache.info().entries == 1
    cache.clear()
    assert files(entries) == []


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


def test_the_code_is_read_again_only_where_a_file_changed(entries, tmp_path, monkeypatch):
    code = tmp_path / "code/core/cache.py"
    code.parent.mkdir(parents=True)
    monkeypatch.setattr(cache, "__file__", str(code))
    hashed = cache.code_hash.__wrapped__
    (code.parent / "notes.txt").write_text("no code")
    code.write_text("1")
    assert hashed() == sha256(b"1").hexdigest()
    with monkeypatch.context() as unread:
        unread.setattr(Path, "read_bytes", lambda path: pytest.fail(f"{path} was read"))
        assert hashed() == sha256(b"1").hexdigest()
    before = code.stat()
    code.write_text("2")
    os.utime(code, ns=(before.st_atime_ns, before.st_mtime_ns))  # as a tool that copies times does
    assert hashed() == sha256(b"2").hexdigest()
    for entry in files(entries):
        entry.write_bytes(b"damaged")
    assert hashed() == sha256(b"2").hexdigest()
    (code.parent / "data.csv").write_text("3")
    assert hashed("core") == sha256(b"23").hexdigest()
    key = cache._stamp([code, code.parent / "data.csv"])
    cache.store_bytes("code", key, b"no hash")
    assert hashed("core") == sha256(b"23").hexdigest()


def test_a_folder_that_may_not_be_searched_keeps_nothing(entries, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "is_symlink", refuse)
    cache.store("kind", KEYS[0], [1])
    assert cache.load("kind", KEYS[0]) is None
    assert cache.get_or_compute("kind", KEYS[0], lambda: None, lambda: 7) == 7
    assert len(cache.code_hash.__wrapped__("core")) == 64


def aged(entries: Path, count: int, size: int, start_s: float = 1e9) -> None:
    """Store entries of `size` bytes, each last used a second after the one before."""
    for n in range(count):
        cache.store_bytes("kind", KEYS[n], bytes(size))
        os.utime(entries / "kind" / KEYS[n][:2] / f"{KEYS[n]}.entry", (start_s + n, start_s + n))


def held(count: int) -> list[int]:
    return [n for n in range(count) if (cache.folder() / "kind" / KEYS[n][:2] / f"{KEYS[n]}.entry").exists()]


def test_what_was_used_longest_ago_goes_first(entries):
    aged(entries, 10, 1000)
    cache.load_bytes("kind", KEYS[0])
    # Each takes 1130 bytes with its head: six are kept of a limit of 8500 and a share of 0.8.
    assert cache.trim(8500) == 4
    assert held(10) == [0, 5, 6, 7, 8, 9]


def test_nothing_goes_while_there_is_room(entries):
    aged(entries, 10, 1000)
    assert cache.trim(10 * 1130) == 0
    assert held(10) == list(range(10))


def test_storing_keeps_the_limit(entries, monkeypatch):
    monkeypatch.setenv(cache.LIMIT_VARIABLE, "0.05")
    for key in KEYS:
        cache.store_bytes("kind", key, bytes(2000))
        # The limit, and what is stored between two looks.
        assert cache.info().bytes <= 50_000 * (1 + cache.LOOK_SHARE) + 2 * 2130
    assert cache.load_bytes("kind", KEYS[-1]) is not None


def test_a_clock_that_jumps_breaks_nothing(entries):
    aged(entries, 5, 1000, time.time() + 1e8)
    cache.store_bytes("kind", KEYS[5], b"new")
    assert cache.load_bytes("kind", KEYS[0]) == bytes(1000)
    assert cache.load_bytes("kind", KEYS[5]) == b"new"
    assert cache.trim(2000) > 0
    assert cache.info().bytes <= 2000


@pytest.mark.parametrize("text", ["plenty", "-1", "nan", "inf", "1e400", "1 GB"])
def test_a_limit_that_is_none_is_refused(monkeypatch, text):
    monkeypatch.setenv(cache.LIMIT_VARIABLE, text)
    with pytest.raises(SpecError, match=r"must be a number of megabytes, 0 or more, got") as refused:
        cache.limit_bytes()
    assert refused.value.where == cache.LIMIT_VARIABLE


@pytest.mark.parametrize(("text", "expected"), [("", 1_024_000_000), ("0", 0), ("1.5", 1_500_000)])
def test_the_limit_in_megabytes(monkeypatch, text, expected):
    monkeypatch.setenv(cache.LIMIT_VARIABLE, text)
    assert cache.limit_bytes() == expected


def test_info_and_clear(entries):
    for n in range(3):
        cache.store_bytes("meshes", KEYS[n], bytes(100))
    cache.store("modes", KEYS[3], [1])
    info = cache.info()
    assert info.folder == str(entries)
    assert info.entries == 4
    assert {kind: count for kind, (count, _) in info.kinds.items()} == {"meshes": 3, "modes": 1}
    assert info.bytes == sum(path.stat().st_size for path in files(entries))
    assert cache.clear() == info
    assert cache.info().entries == 0
    assert cache.load("modes", KEYS[3]) is None


def test_former_versions_entries_are_ignored_and_cleared_but_not_the_users_files(entries):
    inner = entries / "taxel-modes" / KEYS[0][:2]
    inner.mkdir(parents=True)
    (inner / f"{KEYS[0]}.json").write_text('{"key": "' + KEYS[0] + '", "result": 1}')
    (inner / f"{KEYS[0]}.4711").write_text("{")
    (inner / "notes.json").write_text("mine")
    (entries / "own.txt").write_text("mine")
    assert cache.load("taxel-modes", KEYS[0]) is None
    assert cache.clear().entries == 2
    assert [path.name for path in files(entries)] == ["own.txt", "notes.json"]


HAMMER = """
import sys
from padgen.core import cache
me, trims = int(sys.argv[1]), sys.argv[2] == "trims"
wrong = missing = seen = 0
keys = [cache.key_of(n) for n in range(12)]
for turn in range(40):
    for n, key in enumerate(keys):
        data = cache.load_bytes("shared", key)
        if data is not None:
            seen += 1
            # Whole, whoever wrote it: a number and as many bytes of it.
            wrong += data != bytes([data[0]]) * (300_000 + 10 * n)
        elif turn:
            missing += 1
        cache.store_bytes("shared", key, bytes([1 + (turn + me) % 250]) * (300_000 + 10 * n))
    if trims and turn % 10 == me:
        cache.trim(2_000_000)
print(wrong, missing, seen)
"""


@pytest.mark.parametrize("trims", ["trims", "keeps"])
def test_two_processes_at_once_never_see_half_an_entry(entries, trims):
    command = [sys.executable, "-c", HAMMER]
    workers = [subprocess.Popen([*command, str(n), trims], stdout=subprocess.PIPE, text=True) for n in range(2)]
    for worker in workers:
        wrong, missing, seen = map(int, worker.communicate(timeout=120)[0].split())
        assert worker.returncode == 0
        assert wrong == 0
        assert missing == 0 or trims == "trims"
        assert seen > 100
    assert not [path for path in files(entries) if path.suffix == cache.ASIDE]


MAKER = """
import sys, time
from pathlib import Path
from padgen.core import cache

def make():
    with open(sys.argv[1], "a") as file:
        file.write("made\\n")
    time.sleep(float(sys.argv[3]))
    cache.store("kind", sys.argv[2], 1)
    return 1

print(cache.get_or_compute("kind", sys.argv[2], lambda: cache.load("kind", sys.argv[2]), make))
"""


def maker(place: Path, seconds: float) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", MAKER, str(place), KEYS[0], str(seconds)], stdout=subprocess.PIPE, text=True
    )


def until(reached) -> None:
    end = time.monotonic() + 60
    while not reached():
        assert time.monotonic() < end, "not within a minute"
        time.sleep(0.01)


def test_processes_that_want_the_same_make_it_once(entries, tmp_path):
    makers = [maker(tmp_path / "made", 1.0) for _ in range(4)]
    assert [process.communicate(timeout=60)[0].strip() for process in makers] == ["1"] * 4
    assert (tmp_path / "made").read_text() == "made\n"
    assert [path.suffix for path in files(entries)] == [".entry"]


def test_who_waits_for_a_killed_process_makes_it_itself(entries, tmp_path):
    first = maker(tmp_path / "made", 600.0)
    until((tmp_path / "made").exists)
    second = maker(tmp_path / "made", 0.0)
    time.sleep(0.5)
    assert second.poll() is None, "it waits"
    first.kill()
    first.communicate(timeout=60)
    assert second.communicate(timeout=60)[0].strip() == "1"
    assert (tmp_path / "made").read_text() == "made\nmade\n"


def test_patience_has_an_end(entries, monkeypatch):
    monkeypatch.setattr(cache, "PATIENCE_S", 0.1)
    with cache.claimed("kind", KEYS[:1]), cache.claimed("kind", KEYS[:3]):
        assert cache.get_or_compute("kind", KEYS[1], lambda: None, lambda: 5) == 5
    assert not files(entries)


def test_a_claim_needs_no_folder(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "file"))
    assert cache.get_or_compute("kind", KEYS[0], lambda: None, lambda: 5) == 5


def test_a_lock_on_a_file_that_was_taken_away_is_none(tmp_path, monkeypatch):
    """A holder may release and remove the lock's file between our opening and our locking it."""
    path = tmp_path / "claim"
    lock = fcntl.flock

    def late(file, how):
        path.unlink()
        (tmp_path / "newcomer").touch()
        (tmp_path / "newcomer").rename(path)
        lock(file, how)

    monkeypatch.setattr("fcntl.flock", late)
    assert lock_file(path) == -1
    monkeypatch.setattr("fcntl.flock", lock)
    os.close(lock_file(path))


def test_a_folder_with_an_entrys_name_is_none_of_ours(entries):
    cache.store("kind", KEYS[0], 1)
    odd = entries / "kind" / KEYS[1][:2] / f"{KEYS[1]}.entry"
    odd.mkdir(parents=True)
    assert cache.info().entries == 1
    assert cache.clear().entries == 1 and odd.is_dir()
    assert cache.info().entries == 0
