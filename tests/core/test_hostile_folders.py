"""Folders from strangers: whatever is in them, reading writes nothing, and writing stays in the folder of results."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from padgen.core import files, seal
from padgen.core.errors import FileError
from padgen.core.files import OutputFolder, recover, wait_for_commit

ROOT = Path(__file__).parents[2]
SAMPLE = 20
ALL = 1000
TRACED = 50
CHUNK = 100
"""Folders that one process tries, since to start one takes seconds."""


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    from tests.hostile_folders import make_model

    folder = tmp_path_factory.mktemp("stranger") / "model"
    make_model(folder)
    return folder


def tried(*arguments, before=()):
    """Run `tests.hostile_folders` in a process of its own, since an audit hook stays for good."""
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1", "OPENBLAS_NUM_THREADS": "1"}
    command = [*before, sys.executable, "-m", "tests.hostile_folders", *map(str, arguments)]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


def test_reading_a_strangers_folder_writes_nothing(tmp_path, model):
    """A sample: two attacks that succeeded once with every command, the others with some."""
    found = tried(tmp_path, model, 0, SAMPLE, "--few")
    assert found["faults"] == []
    assert found["folders"] == SAMPLE and found["codes"]["0"] > SAMPLE / 2 and found["half_written"] > 2, found


@pytest.mark.hostile
@pytest.mark.parametrize("first", range(0, ALL, CHUNK))
def test_reading_a_thousand_strangers_folders_writes_nothing(tmp_path, model, first):
    found = tried(tmp_path, model, first, first + CHUNK)
    assert found["faults"] == [] and found["folders"] == CHUNK
    print(found)


WRITING = re.compile(r"O_(WRONLY|RDWR|CREAT|TRUNC|APPEND)")
CALLS = "open,openat,openat2,creat,rename,renameat,renameat2,link,linkat,symlink,symlinkat,unlink,unlinkat,rmdir"
MORE_CALLS = "mkdir,mkdirat,truncate,ftruncate,chmod,fchmodat,chown,fchownat,lchown,mknod,mknodat,utimensat,setxattr"


@pytest.mark.hostile
def test_the_system_is_asked_for_no_change(tmp_path, model):
    """`strace` hears what Python's audit hook may not: libraries in C, and the sweeps' processes."""
    tried(tmp_path, model, 0, TRACED, "--make")
    log = tmp_path / "strace.log"
    trace = ["strace", "-f", "-qq", "-y", "-s", "4096", "-e", f"trace={CALLS},{MORE_CALLS}", "-e", "signal=none"]
    found = tried(tmp_path, model, 0, TRACED, "--made", "--read", before=[*trace, "-o", str(log)])
    assert found["faults"] == []
    calls = log.read_text(errors="replace").splitlines()
    changing = [line for line in calls if "open" not in line.split("(")[0] or WRITING.search(line)]
    foreign = [line for line in changing if re.search(rf"{re.escape(str(tmp_path))}/h\d+/(pad|victim)", line)]
    # A cache that a stranger sent is written into where it is named as the cache, every second of them.
    foreign = [line for line in foreign if not re.search(r"/h\d*[02468]/pad/cache/", line)]
    assert len(changing) > TRACED and foreign == []


# Journals that are nearly this user's


def torn_by_hand(folder):
    """Leave what a kill amid a commit leaves: the new file in place, the old one aside."""
    with OutputFolder(folder) as out:
        out.write("plan.json", "old")
        out.commit()
    pid = os.fork()
    if pid == 0:
        with OutputFolder(folder) as out:
            out.write("plan.json", "new")
            unlink = os.unlink
            os.unlink = lambda path, **named: os._exit(0) if path == files.JOURNAL else unlink(path, **named)
            out.commit()
        os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    assert (folder / "plan.json").read_text() == "new" and (folder / files.JOURNAL).exists()


def test_ones_own_unfinished_change_is_undone(tmp_path):
    torn_by_hand(tmp_path)
    assert recover(tmp_path) and (tmp_path / "plan.json").read_text() == "old"
    assert not recover(tmp_path)


def test_a_journal_in_a_copy_of_its_folder_is_a_strangers(tmp_path):
    torn_by_hand(tmp_path / "own")
    (tmp_path / "own").rename(tmp_path / "moved")
    with pytest.raises(FileError, match="was not written here by this user's padgen; nothing is changed"):
        recover(tmp_path / "moved")
    (tmp_path / "moved").rename(tmp_path / "own")
    assert recover(tmp_path / "own")


@pytest.mark.parametrize("name", ["plan.json", "id_rsa"])
def test_a_journal_that_was_changed_is_a_strangers(tmp_path, name):
    torn_by_hand(tmp_path)
    journal = tmp_path / files.JOURNAL
    table = json.loads(journal.read_text())
    table["kept"] = {"notes.txt": name}
    journal.write_text(json.dumps(table))
    with pytest.raises(FileError, match="nothing is changed"), OutputFolder(tmp_path):
        pass
    with pytest.raises(FileError, match=r"which this user's padgen did not write there; remove \.padgen\.journal"):
        wait_for_commit(tmp_path, "plan.json")
    assert (tmp_path / "plan.json").read_text() == "new"


def test_without_ones_secret_no_journal_is_ones_own(tmp_path, monkeypatch):
    torn_by_hand(tmp_path / "out")
    kept = os.environ[seal.VARIABLE]
    monkeypatch.setenv(seal.VARIABLE, str(tmp_path / "state"))
    with pytest.raises(FileError, match="nothing is changed"):
        recover(tmp_path / "out")
    assert not (tmp_path / "state").exists(), "looking makes no secret"
    seal.seal_of(b"")
    with pytest.raises(FileError, match="nothing is changed"):
        recover(tmp_path / "out")
    monkeypatch.setenv(seal.VARIABLE, kept)
    assert recover(tmp_path / "out")


def test_the_secret_is_the_users_alone_and_stays(tmp_path, monkeypatch):
    monkeypatch.setenv(seal.VARIABLE, str(tmp_path / "state"))
    first = seal.seal_of(b"a text")
    secret = tmp_path / "state" / seal.SECRET
    assert secret.stat().st_mode & 0o777 == 0o600 and [path.name for path in secret.parent.iterdir()] == [seal.SECRET]
    assert first == seal.seal_of(b"a text") != seal.seal_of(b"another")
    assert seal.is_sealed(b"a text", first) and not seal.is_sealed(b"another", first)
    secret.chmod(0o644)
    assert seal.seal_of(b"a text") == "", "others may have read it"
    secret.rename(tmp_path / "elsewhere")
    (tmp_path / "elsewhere").chmod(0o600)
    secret.symlink_to(tmp_path / "elsewhere")
    assert seal.seal_of(b"a text") == ""


def test_without_a_place_for_the_secret_padgen_writes(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(seal.VARIABLE, str(tmp_path / "file" / "state"))
    torn_by_hand(tmp_path / "out")
    with pytest.raises(FileError, match=r"take what you need from .*\.replaced.* and remove \.padgen\.journal"):
        recover(tmp_path / "out")


def test_a_reader_amid_commits_reads_old_or_new(tmp_path):
    """Two files that always agree, read as one while another process replaces them, until many states were seen."""
    code = (
        "import sys\nfrom itertools import count\nfrom pathlib import Path\n"
        "from padgen.core.files import OutputFolder\n"
        "for k in count():\n"
        "    if Path(sys.argv[2]).exists():\n        break\n"
        "    with OutputFolder(Path(sys.argv[1])) as out:\n"
        "        for name in 'ab':\n            out.write(f'{name}.csv', str(k))\n"
        "        out.commit()\n"
    )
    folder = tmp_path / "read"
    enough = tmp_path / "enough"
    with OutputFolder(folder) as out:
        for name in "ab":
            out.write(f"{name}.csv", "first")
        out.commit()
    writer = subprocess.Popen([sys.executable, "-c", code, str(folder), str(enough)])
    seen = set()

    def read():
        return tuple(files.read_bounded(folder / f"{name}.csv", 100, "a table") for name in "ab")

    while len(seen) < 20:
        assert writer.poll() is None
        one, other = files.read_as_one(folder, read)
        assert one == other
        seen.add(one)
    enough.touch()
    assert writer.wait(60) == 0
