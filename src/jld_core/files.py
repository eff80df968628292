"""Files that are written whole or not at all, of letters that every reader takes."""

from __future__ import annotations

import errno
import itertools
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

_UNPRINTABLE: Final = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\ufffe\uffff]")


def printable(text: str) -> str:
    """A text with a blank for each character that no font shows and that XML does not take."""
    return _UNPRINTABLE.sub(" ", text)


def require_writable(path: Path) -> None:
    """Check that `whole_file` can write a file, by writing: permissions do not tell of every file system.

    Parameters
    ----------
    path : Path
        File to be written later; neither it nor its folder need exist. Nothing that was not there stays.

    Raises
    ------
    OSError
        The file or its folder cannot be written.
    """
    path = Path(os.path.realpath(path))
    missing = list(itertools.takewhile(lambda parent: not parent.exists(), path.parents))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh = _fresh(path)
        fresh.open("xb").close()
        fresh.unlink()
    finally:
        for parent in missing:
            if parent.is_dir():
                parent.rmdir()


def _fresh(path: Path) -> Path:
    """Return the name under which a file is written first. Raises OSError where the path is no file."""
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is no file that can be written anew", str(path))
    return path.with_name(f"{path.name}.{os.getpid()}.new")  # two processes may write the same file


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A name to write under, which becomes the file's once all is written; where that fails nothing stays.

    A link stays, and what it points to is written. Raises OSError with the name of the file.
    """
    path = Path(os.path.realpath(path))
    fresh = _fresh(path)
    try:
        yield fresh
        os.replace(fresh, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from None
    finally:
        fresh.unlink(missing_ok=True)
