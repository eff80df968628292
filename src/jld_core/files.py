"""Write files completely or not at all, with characters that every reader accepts."""

from __future__ import annotations

import errno
import itertools
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from jld_core.errors import InputError

# Control characters and non-characters, except line feed: no font shows them and XML rejects them
_UNPRINTABLE: Final = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\ufffe\uffff]")


def printable(text: str) -> str:
    """Replace each character that no font shows or that XML rejects by a blank."""
    return _UNPRINTABLE.sub(" ", text)


def require_writable(path: Path) -> None:
    """Raise OSError unless `whole_file` can write a file, by writing an empty one."""
    # Permissions alone are not reliable on every file system. The check leaves no file and no folder behind.
    path = Path(os.path.realpath(path))
    missing = list(itertools.takewhile(lambda parent: not parent.exists(), path.parents))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = _fresh(path)
        temporary.open("xb").close()
        temporary.unlink()
    finally:
        for parent in missing:
            if parent.is_dir():
                parent.rmdir()


def require_folder(folder: Path) -> None:
    """Raise InputError unless a folder exists or can be made, and is writable."""
    missing = itertools.takewhile(lambda parent: not parent.exists(), (folder, *folder.absolute().parents))
    for parent in missing:
        if parent.is_symlink():
            raise InputError(str(parent), f"it is a link to {os.readlink(parent)}, which is not there", "a folder")
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    if not existing.is_dir():
        raise InputError(str(existing), "it is a file", "a folder for the results")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(str(existing), "it is not writable", "a folder that results may be written into")


def _fresh(path: Path) -> Path:
    """Return the temporary name of a file to write; raise OSError if the path is no file."""
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is no file that can be written anew", str(path))
    return path.with_name(f"{path.stem}.{os.getpid()}.new{path.suffix}")  # the process id keeps two processes apart


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary name, which replaces the file once writing succeeds; raise OSError that names the file."""
    # If writing fails the temporary file is removed and the old file stays. If the path is a symbolic link, the file
    # that it points to is replaced.
    path = Path(os.path.realpath(path))
    temporary = _fresh(path)
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from None
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


RUN_BY_SPREADSHEETS: Final = ("=", "+", "-", "@", "\t", "\r")
"""First characters by which a spreadsheet takes a text for a formula."""


def harmless(value: object) -> object:
    """Quote a text that a spreadsheet would run as a formula, by an apostrophe before `RUN_BY_SPREADSHEETS`."""
    return f"'{value}" if isinstance(value, str) and value.startswith(RUN_BY_SPREADSHEETS) else value


def json_of(text: str, **options: Any) -> Any:
    """Return what a JSON text holds; raise ValueError that says in words where or why it is none."""
    import json

    try:
        return json.loads(text, **options)
    except json.JSONDecodeError as error:
        raise ValueError(f"it is not JSON (line {error.lineno}, column {error.colno})") from None
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    except ValueError as error:  # Python limits the number of digits of an integer
        raise (
            error if isinstance(error, InputError) else ValueError("it holds a number of thousands of digits")
        ) from None
