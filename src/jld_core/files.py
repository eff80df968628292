"""Files that are written whole or not at all, of letters that every reader takes."""

from __future__ import annotations

import errno
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


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A name to write under, which becomes the file's once all is written; where that fails nothing stays.

    A link stays, and what it points to is written. Raises OSError with the name of the file.
    """
    path = Path(os.path.realpath(path))
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is no file that can be written anew", str(path))
    fresh = path.with_name(f"{path.name}.{os.getpid()}.new")  # two processes may write the same file
    try:
        yield fresh
        os.replace(fresh, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from None
    finally:
        fresh.unlink(missing_ok=True)
