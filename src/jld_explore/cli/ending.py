"""How a command ends otherwise than well: signals, one line on stderr, and the exit code."""

from __future__ import annotations

import contextlib
import itertools
import re
import signal
import sys
from typing import Final, NoReturn

from jld_explore.evaluation import disturb
from jld_explore.study import Interrupted

INPUT, STOPPED, UNCERTIFIED = 2, 3, 4

_SIGNALS: Final = ("SIGINT", "SIGTERM", "SIGHUP")
"""What stops a search; the last is a terminal that is closed, and not everywhere known."""


def raise_on_signals() -> None:
    """Let signals end a search as what it finished is on disk; one that is ignored (nohup) stays so."""

    def stop(number: int, frame: object) -> None:
        disturb(Interrupted())

    for name in _SIGNALS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, stop)


def warn(line: str) -> None:
    """A line on stderr, where that is still open: the terminal may be gone."""
    with contextlib.suppress(OSError):
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


def usage_of(message: str) -> str:
    """One line for a command line that cannot be parsed: option, what was given, what is expected."""
    text = " ".join(message.split()).rstrip(".")
    found = re.match(r"Invalid value for '([^']+)': (?:Value error, )?(?:Input should be )?(.*)", text)
    if found is None:
        return f"{text}; expected what jld --help lists"
    option, wish = found.groups()
    wish = wish.partition(", unable to parse")[0].replace("a valid number", "a number")
    wish = re.sub("^.* is not one of ", "one of ", wish)
    wish = re.sub("^(greater|less) than", r"a number \1 than", wish).replace("a valid integer", "a whole number")
    given = [b for a, b in itertools.pairwise(sys.argv) if a == option]
    given += [a.partition("=")[2] for a in sys.argv if a.startswith(f"{option}=")]
    return f"{option}: {given[0] if given else 'the value'!r} is wrong; expected {wish}"


def complain(line: str) -> NoReturn:
    """Say what is wrong and leave."""
    warn(f"jld: {line}")
    sys.exit(INPUT)
