"""Seals: keyed hashes by which a later run knows that a text was written by this user on this machine.

Any file in a folder may be a stranger's, out of an archive or a repository. The secret lies in the user's state folder,
for nobody else to read; it is made when padgen first seals something. Where it cannot be kept, nothing is sealed, and a
later run trusts nothing.
"""

import hmac
import os
import stat
from contextlib import suppress
from errno import EPERM
from itertools import count
from pathlib import Path

__all__ = ["VARIABLE", "is_sealed", "seal_of", "secret_folder"]

VARIABLE = "PADGEN_STATE"
SECRET = "secret"
SECRET_BYTES = 32
_aside_numbers = count(1)


def secret_folder() -> Path:
    """Return the folder of the secret key for seals: the variable ``PADGEN_STATE``, or the user's state folder."""
    named = os.environ.get(VARIABLE)
    if named:
        return Path(named)
    from platformdirs import user_state_path

    return user_state_path("padgen", appauthor=False)


def seal_of(text: bytes) -> str:
    """Return the seal (HMAC-SHA-256) of a text, empty where no secret can be read or made."""
    path = secret_folder() / SECRET
    try:
        try:
            secret = _read(path)
        except FileNotFoundError:
            _make(path)
            secret = _read(path)
    except OSError:
        return ""
    return hmac.digest(secret, text, "sha256").hex()


def is_sealed(text: bytes, seal: str) -> bool:
    """Return whether this is the seal of a text, made by this user on this machine.

    Raises
    ------
    OSError
        The secret cannot be read.
    """
    try:
        secret = _read(secret_folder() / SECRET)
    except (FileNotFoundError, NotADirectoryError):
        return False
    return hmac.compare_digest(hmac.digest(secret, text, "sha256").hex().encode(), seal.encode())


def _read(path: Path) -> bytes:
    """Return the secret key in file `path`; raise OSError for a file that other users own or may access."""
    file = os.open(path, os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0))
    try:
        status = os.fstat(file)
        is_own = not hasattr(os, "geteuid") or (status.st_uid == os.geteuid() and not status.st_mode & 0o077)
        secret = os.read(file, SECRET_BYTES + 1) if stat.S_ISREG(status.st_mode) and is_own else b""
    finally:
        os.close(file)
    if len(secret) != SECRET_BYTES:
        raise OSError(EPERM, "it is not a secret of this user's", str(path))
    return secret


def _make(path: Path) -> None:
    """Write a new random secret key to file `path`, unless another process writes one at the same time."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    aside = path.with_name(f"{SECRET}.{os.getpid()}-{next(_aside_numbers)}")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    file = os.open(aside, flags, 0o600)
    try:
        try:
            os.write(file, os.urandom(SECRET_BYTES))
            os.fsync(file)
        finally:
            os.close(file)
        with suppress(FileExistsError):
            try:
                os.link(aside, path)  # which never replaces another's
            except FileExistsError:
                raise
            except OSError:  # a file system without such links
                aside.rename(path)
    finally:
        with suppress(OSError):
            aside.unlink()
