"""Why a study ends, how far it is, its interrupt, and facts that its record names."""

from __future__ import annotations

import platform
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from jld_core._version import __version__
from jld_core.batch import chosen


class StopReason(StrEnum):
    """Reason why a study ended, `stop_reason` in its summary."""

    EXHAUSTED = "exhausted"  # all labellings were evaluated, or settled by the driver
    DRIVER = "driver"  # it asks for no more, and others may be left
    PROVEN = "proven"  # the proof passed its check
    UNPROVEN = "unproven"  # the proof failed its check
    BUDGET = "budget"
    TIME = "time"
    INTERRUPTED = "interrupted"  # by a signal


class Interrupted(BaseException):
    """Exception of the command line's signal handlers; finished results are on disk."""

    done: Any = None  # results of the interrupted search, once written
    words: str = "stopped; everything finished is on disk, go on with --resume"  # message for the terminal


@dataclass(frozen=True)
class Progress:
    """State of a running study.

    Attributes
    ----------
    done, total : int, int or None
        Labellings evaluated, recorded ones too, of all classes or the smaller budget; None if unknown.
    solved : int
        Labellings that workers evaluated.
    best : float
        Largest λ so far, NaN if there is none.
    seconds : float
        Time since the start, s.
    bound, gap : float
        Proven upper bound on λ of all layouts, and its relative distance from `best`; NaN if there is none.
    labelling : str
        Layout of `best` as text; "" if there is none, or the search names it only when it ends.
    left : float
        Time left until the search ends at the latest, s; inf without a limit.
    """

    done: int
    total: int | None
    solved: int
    best: float
    seconds: float
    bound: float = np.nan
    gap: float = np.nan
    labelling: str = ""
    left: float = np.inf


def name_of(function: Callable[..., Any]) -> str:
    """Return the name by which a function of the user is recorded: module and qualified name."""
    name = getattr(function, "__qualname__", type(function).__qualname__)
    return f"{getattr(function, '__module__', '')}.{name}".lstrip(".")


def versions() -> dict[str, str]:
    """Return the versions, by name, of programs on which numerical results may depend."""
    from importlib.metadata import version  # imports e-mail, which most commands do without

    return {
        "jld": __version__,
        "python": platform.python_version(),
        "kernel": chosen() or "none",
        **{name: version(name) for name in ("numpy", "scipy", "clarabel", "highspy")},
    }
