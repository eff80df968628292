"""End commands on errors and signals with one line on stderr and an exit code."""

from __future__ import annotations

import itertools
import math
import re
import signal
import sys
import threading
import time
from difflib import get_close_matches
from typing import Any, Final, NoReturn

import typer

from jld_core.errors import InputError, SolverError
from jld_core.threads import memory_limit
from jld_explore.cli.overview import COMMANDS
from jld_explore.cli.streams import STOPPED, STOPPED_WORDS, end_remarks, failed, warn
from jld_explore.search.state import Interrupted

INPUT, UNCERTIFIED = 2, 4

# Some versions of typer include their own click; typer's exceptions show which one is used.
_UsageError: Any = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")

# Signals that stop a search; SIGHUP (closed terminal) does not exist on every system
_SIGNALS: Final = ("SIGINT", "SIGTERM", "SIGHUP")

# Time after a signal in which others are ignored, s: the second Ctrl-C of an impatient user left no page
_WRITING: Final = 10.0
_INTERRUPTED: Final = 130  # exit code that typer returns for KeyboardInterrupt

# A parameter, with or without a value, in the message of an error: `friction="zero-dilation"`
_PARAMETER: Final = re.compile(r"`(?P<name>[a-z_]+)(?:=(?P<value>[^`]*))?`")


# What the parser says of an unknown command or option, with the one that it finds most like it
_UNKNOWN: Final = re.compile(
    r"No such (?P<kind>command|option):? '?(?P<name>[^' ]+)'?(?:.*?(?:'|options?: )(?P<meant>[\w-]+))?"
)


def raise_on_signals() -> None:
    """Make signals such as SIGINT and SIGTERM raise Interrupted, so that searches end cleanly."""
    # Finished results stay on disk. Further signals within `_WRITING` seconds change nothing, as results are being
    # written. Signals that the process ignores stay ignored.
    from jld_explore.evaluation import raise_deferred  # only searches need it, and it takes long to import

    first = -math.inf

    def stop(number: int, frame: object) -> None:
        nonlocal first
        if time.monotonic() - first > _WRITING:
            first = time.monotonic()
            raise_deferred(Interrupted())

    for name in _SIGNALS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, stop)


def interrupt_on_signals() -> None:
    """Make SIGTERM and SIGHUP raise KeyboardInterrupt, as SIGINT does."""
    if threading.current_thread() is not threading.main_thread():
        return
    for name in _SIGNALS:
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)


def usage_of(message: str) -> str:
    """Convert a usage error of the command-line parser to one line."""
    # The line names the option, the given value and the expected value; a message of another form is kept.
    text = " ".join(message.split()).rstrip(".")
    invalid = re.match(r"Invalid value for '([^']+)': (?:Value error, )?(?:Input should be )?(.*)", text)
    if invalid is None:
        command = f"jld {sys.argv[1]}" if len(sys.argv) > 1 and sys.argv[1] in COMMANDS else "jld"
        unknown = _UNKNOWN.match(text)
        if unknown is None:
            return f"{text}; expected what {command} --help lists"
        nearest = unknown["meant"] or next(iter(get_close_matches(unknown["name"], COMMANDS, 1)), None)
        remedy = f"{nearest}, or another that" if nearest else "what"
        return f"no {unknown['kind']} is named {unknown['name']}; expected {remedy} {command} --help lists"
    option, expected = invalid.groups()
    expected = expected.partition(", unable to parse")[0].replace("a valid number", "a number")
    expected = re.sub("^.* is not one of ", "one of ", expected)
    expected = re.sub("^(greater|less) than", r"a number \1 than", expected).replace(
        "a valid integer", "a whole number"
    )
    values = [b for a, b in itertools.pairwise(sys.argv) if a == option]
    values += [a.partition("=")[2] for a in sys.argv if a.startswith(f"{option}=")]
    return f"{option}: {values[0] if values else 'the value'!r} is wrong; expected {expected}"


def flag_of(parameter: str) -> str:
    """Return the flag of a parameter: "--inner-bending" for "inner_bending"."""
    return "--" + parameter.replace("_", "-")


def with_flags(words: str) -> str:
    """Return words with command-line flags for the parameters in them: "--friction zero-dilation"."""

    def flag(parameter: re.Match[str]) -> str:
        name, value = parameter["name"], (parameter["value"] or "").strip("\"'")
        if value in ("", "True"):
            return flag_of(name)
        return f"no {flag_of(name)}" if value == "False" else f"{flag_of(name)} {value}"

    return _PARAMETER.sub(flag, words)


def in_flags(error: InputError) -> str:
    """Return the message of an error with command-line flags for the parameters that it names."""
    where = flag_of(error.parameter) if error.parameter else error.where
    return str(InputError(where, with_flags(error.problem), with_flags(error.expected)))


def complain(line: str) -> NoReturn:
    """Write an error to stderr and end the process with the exit code for bad input, 2."""
    warn(f"jld: {line}")
    sys.exit(INPUT)


def ignore_signals() -> None:
    """Ignore signals while the process ends: everything is written, and one would replace its exit code."""
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)


def run(app: typer.Typer, started: float) -> NoReturn:
    """Run the command line and exit; started: of the process, s by `time.perf_counter`."""
    try:
        sys.exit(_code_of(app, started))
    except SystemExit as end:
        end_remarks(write=end.code != INPUT)
        raise


def _code_of(app: typer.Typer, started: float) -> int:
    """Run the command line; return its exit code, with one line on stderr for an error."""
    interrupt_on_signals()
    try:
        code = app(standalone_mode=False, obj=started)
    except InputError as error:
        complain(in_flags(error))
    except _UsageError as error:
        complain(usage_of(error.format_message()))
    except SolverError as error:
        complain(f"--solver: {error}; expected a solver that takes this scene")
    except OSError as error:
        warn(failed(error))
        sys.exit(INPUT)
    except MemoryError as error:
        most, lacking = memory_limit() / 1e9, " ".join(str(error).split()) or "no more can be had"
        complain(f"memory ran out: {lacking}; expected a scene that {most:.1f} GB suffice for, or fewer --jobs")
    except (Interrupted, KeyboardInterrupt, typer.Abort) as error:
        if isinstance(error.__cause__, EOFError):  # typer takes the end of any file for that of the terminal
            complain(f"a file ends too early: {error.__cause__ or 'nothing more'}; expected whole files")
        warn(error.words if isinstance(error, Interrupted) else STOPPED_WORDS)
        sys.exit(STOPPED)
    if code == _INTERRUPTED:
        warn(STOPPED_WORDS)
        sys.exit(STOPPED)
    return code if isinstance(code, int) else 0
