"""Define why a study ends, how far it is, and the exception of an interrupt."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np


class StopReason(StrEnum):
    """Reason why a study ended, `stop_reason` in its summary.

    EXHAUSTED: all labellings were evaluated, or the driver has no more. PROVEN: the proof passed its check.
    UNPROVEN: the proof failed its check. BUDGET and TIME: a limit was reached. INTERRUPTED: a signal ended it.
    """

    EXHAUSTED = "exhausted"
    PROVEN = "proven"
    UNPROVEN = "unproven"
    BUDGET = "budget"
    TIME = "time"
    INTERRUPTED = "interrupted"


class Interrupted(BaseException):
    """Exception of the command line's signal handlers; finished results are on disk.

    Attributes
    ----------
    done : Exploration or None
        Results of the interrupted search, once written.
    words : str
        Message for the terminal.
    """

    done: Any = None
    words: str = "stopped; everything finished is on disk, go on with --resume"


@dataclass(frozen=True)
class Progress:
    """State of a running study.

    Attributes
    ----------
    done : int
        Number of evaluated labellings, including recorded ones.
    total : int or None
        Number of classes, or the budget if smaller; None if unknown.
    solved : int
        Number of labellings that the workers evaluated.
    best : float
        Largest λ so far, NaN if there is none.
    seconds : float
        Time since the start, s.
    bound : float
        Proven upper bound on λ of all layouts, NaN if there is none.
    gap : float
        Relative difference between best and bound, NaN if there is none.
    labelling : str
        Layout of `best`, a letter d or i per face; "" if there is none, or the search names it only when it ends.
    """

    done: int
    total: int | None
    solved: int
    best: float
    seconds: float
    bound: float = np.nan
    gap: float = np.nan
    labelling: str = ""
