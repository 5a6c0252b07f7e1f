"""Every kind of input file is read with a limit on its size."""

import os
import threading
import tracemalloc
from pathlib import Path

import pytest

from padgen.core import files
from padgen.core.errors import FileError
from padgen.core.files import read_bounded

posix = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="pipes, devices and /proc")


@pytest.mark.parametrize("size", [0, 9, 10])
def test_what_fits_is_read(tmp_path: Path, size: int) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"x" * size)
    assert read_bounded(path, 10, "a tuning") == b"x" * size


def test_what_is_too_large_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with path.open("wb") as file:
        file.truncate(10**10)
    tracemalloc.start()
    with pytest.raises(FileError, match=r"a: is too large for a tuning: at most 1000 bytes, has 10000000000 or more$"):
        read_bounded(path, 1000, "a tuning")
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    for path, why in (
        (tmp_path, "Is a directory"),
        (tmp_path / "b", "No such file or directory"),
        (tmp_path / "a\0b", "embedded null"),
        (tmp_path / ("a" * 5000), "name too long"),
        (tmp_path / "a\ud800\udfff", "."),
    ):
        with pytest.raises(FileError, match=rf"cannot be read \(.*{why}"):
            read_bounded(path, 10, "a tuning")


@posix
@pytest.mark.parametrize("name", ["zero", "null", "urandom"])
def test_devices_are_refused(name: str) -> None:
    with pytest.raises(FileError, match=rf"/dev/{name}: cannot be read \(it is a device\)"):
        read_bounded(Path("/dev", name), 10, "a tuning")


@posix
def test_the_bound_takes_no_memory() -> None:
    tracemalloc.start()
    assert read_bounded(Path("/proc/self/stat"), 10**9, "a tuning")  # which says that it has 0 bytes
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


@posix
def test_pipes_are_read_to_their_end(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    for size in (3, 11):
        writer = threading.Thread(target=path.write_bytes, args=(b"x" * size,))
        writer.start()
        if size <= 10:
            assert read_bounded(path, 10, "a tuning") == b"xxx"
        else:
            with pytest.raises(FileError, match="at most 10 bytes, has 11 or more"):
                read_bounded(path, 10, "a tuning")
        writer.join()


@posix
@pytest.mark.parametrize("opened", [False, True])
def test_pipes_that_do_not_end_are_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, opened: bool) -> None:
    monkeypatch.setattr(files, "LONGEST_PIPE_S", 0.1)
    path = tmp_path / "pipe"
    os.mkfifo(path)
    writer = os.open(path, os.O_RDWR) if opened else None
    with pytest.raises(FileError, match=r"pipe: cannot be read \(it did not end within 0.1 s; write it to a file"):
        read_bounded(path, 10, "a tuning")
    os.close(writer if writer is not None else os.open(path, os.O_RDWR))
