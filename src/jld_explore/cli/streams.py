"""Write safely to closed, full or unread streams and limited encodings, by the standard library alone."""

from __future__ import annotations

import codecs
import contextlib
import errno
import os
import sys
from io import TextIOWrapper
from typing import Final

STOPPED: Final = 3  # exit code after a signal

# message of a command that a signal ended, where the command has nothing to say itself
STOPPED_WORDS: Final = "stopped; nothing more is written"

# ASCII replacements of symbols, for encodings that lack them
_SPELLED: Final = {
    "λ": "lambda",
    "∂": "d",
    "≤": "<=",
    "≥": ">=",
    "×": "x",
    "−": "-",
    "–": "-",
    "…": "...",
    "²": "^2",
    "³": "^3",
    "°": " degrees",
}

_HANDLER: Final = "jld"  # name of the registered error handler for encodings


def _spelled(error: UnicodeError) -> tuple[str | bytes, int]:
    """Replace a character that an encoding lacks: symbols are spelt out, raw bytes of names kept."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letter = error.object[error.start]
    if "\udc80" <= letter <= "\udcff":  # a raw byte of a file name
        return bytes([ord(letter) - 0xDC00]), error.start + 1
    return _SPELLED.get(letter, letter.encode("ascii", "backslashreplace").decode()), error.start + 1


def open_streams() -> None:
    """Prepare stdin, stdout and stderr so that writing to them never ends in a traceback."""
    # Characters that an encoding lacks are spelt out. Closed streams become the null device, so that no opened file
    # gets their number.
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # opens with the lowest free number, which is this one
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "w" if number else "r", encoding="utf-8"))
    codecs.register_error(_HANDLER, _spelled)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)


def say(text: object) -> None:
    """Write a line to stdout and flush it; OSError names "standard output" if it is full."""
    # A closed pipe is ignored, and later output with it.
    try:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()
    except BrokenPipeError:
        _mute()
    except OSError as error:
        _mute()
        raise OSError(error.errno or errno.EIO, error.strerror or str(error), "standard output") from None


def warn(line: str) -> None:
    """Write a line to stderr; ignore any failure, since the terminal may be closed."""
    with contextlib.suppress(OSError):
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


_remarks: Final[list[str]] = []  # lines for stderr at the end of the command


def remark(line: str) -> None:
    """Write a line to stderr at the end, unless bad input ends the command."""
    _remarks.append(line)


def end_remarks(*, write: bool) -> None:
    for line in _remarks if write else ():
        warn(line)
    _remarks.clear()


def failed(error: OSError) -> str:
    """Return the line for reading or writing that failed: no permission, no space, or not a folder."""
    path = error.filename or "standard output or a file"
    return f"jld: {path}: {error.strerror or error}; expected a place that can be read and written"


def _mute() -> None:
    """Redirect stdout to the null device, so that later writes cannot fail."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())
    os.close(null)
