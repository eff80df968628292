"""What is said and where it goes: streams that are closed, full, of few letters, or that nobody reads any more.

It loads nothing but what every start has, since it comes before everything else.
"""

from __future__ import annotations

import codecs
import contextlib
import errno
import os
import sys
from io import TextIOWrapper
from typing import Final

STOPPED: Final = 3
"""Exit code of what a signal ends."""

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
"""Letters of our own, for streams that have none such."""

_HANDLER: Final = "jld"


def _spelled(error: UnicodeError) -> tuple[str | bytes, int]:
    """Letters that an encoding lacks: ours spelt out, bytes of names of files as they were, others by their number."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letter = error.object[error.start]
    if "\udc80" <= letter <= "\udcff":  # a byte of the name of a file that is no text
        return bytes([ord(letter) - 0xDC00]), error.start + 1
    return _SPELLED.get(letter, letter.encode("ascii", "backslashreplace").decode()), error.start + 1


def open_streams() -> None:
    """Make stdin, stdout and stderr such that nothing written to them ends in a traceback.

    Closed ones become the null device, so that no file of ours gets their number.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free, which is this one
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "w" if number else "r", encoding="utf-8"))
    codecs.register_error(_HANDLER, _spelled)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors=_HANDLER)


def say(text: object) -> None:
    """A line on stdout, at once; where nobody reads any more, nothing.

    Raises OSError that names stdout where it cannot be written.
    """
    try:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()
    except BrokenPipeError:
        _mute()
    except OSError as error:
        _mute()
        raise OSError(error.errno or errno.EIO, error.strerror or str(error), "standard output") from None


def warn(line: str) -> None:
    """A line on stderr, where that is still open: the terminal may be gone."""
    with contextlib.suppress(OSError):
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


def _mute() -> None:
    """Let whatever is still to be written to stdout, at the end by Python itself, go nowhere."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, sys.stdout.fileno())
    os.close(null)
