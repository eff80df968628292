"""Optional libraries of some formats, and checks of input files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from jld_core.errors import InputError

EXTRAS: Final = {"ezdxf": "dxf", "ifcopenshell": "ifc", "meshio": "mesh", "rhino3dm": "rhino", "svgelements": "svg"}
"""Extra of this project that installs each library."""

_LARGEST: Final = 64 * 1024 * 1024
"""Largest size of a file, bytes; parsers need about thirty times as much memory."""


def library(name: str, path: Path) -> Any:
    """Import an optional library and return its module.

    name: a key of `EXTRAS`. path: file that needs it, for the message. Raises InputError that names the extra to
    install where the library is missing.
    """
    try:
        return import_module(name)
    except ImportError:
        raise InputError(
            str(path), f"files of this kind need {name}, which is not installed", f"pip install 'jld[{EXTRAS[name]}]'"
        ) from None


def readable(path: Path) -> Path:
    """Return the path of a file that exists, is not empty and has at most 64 MB.

    Raises InputError for any other file.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as stream:
            stream.read(1)
    except OSError as error:
        raise InputError(str(path), error.strerror or "it cannot be read", "a readable file") from None
    if size > _LARGEST:
        raise InputError(str(path), f"it is {size / 2**20:.0f} MB large", f"at most {_LARGEST >> 20} MB")
    if size == 0:
        raise InputError(str(path), "it is empty", "a file with a structure in it")
    return path


def text_of(path: Path) -> str:
    """Return the content of a UTF-8 text file, without a byte order mark.

    Raises InputError for a file in another encoding, or one that `readable` refuses.
    """
    try:
        return readable(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(str(path), "it is not UTF-8 text", "a text in UTF-8") from None


@contextmanager
def parsing(kind: str, expected: str) -> Iterator[None]:
    """Make the calls inside this context raise InputError for a file that cannot be parsed.

    Any exception is converted; an InputError stays as it is. kind: name of the format, for the message. expected: what
    the message asks for.
    """
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        what = " ".join(str(error).split()) or type(error).__name__
        raise InputError("", f"it is no {kind} that can be read ({what[:120]})", expected) from error
