"""Divide a time limit between a search and what is written after it: tables, page and pictures."""

from __future__ import annotations

import time
from typing import Final

from jld_core.assembly import Assembly
from jld_core.deadline import Deadline
from jld_explore.report.reading import FIELD_PICTURE
from jld_explore.search.settings import ExploreSettings

LATENESS: Final = (2.0, 0.05)
"""Time by which a command may pass its time limit: seconds, or a share of the limit if that is larger."""

TABLES: Final = 0.2
"""Share of `lateness` until which shapes of blocks are counted for tables."""

PAGE: Final = 0.5
"""Share of `lateness` until which layouts are solved for the page."""

PICTURES: Final = 0.85
"""Share of `lateness` at which the last picture is finished; the process ends in the remainder."""

# Share of `lateness` at which the tables of a search without pictures are written: others go on with them
_TABLES_ALONE: Final = 0.3

_WRITING: Final = 1.0  # processor time of tables and page of a small search, s

# Further processor time for each face, s: tables of blocks and the drawing on the page grow with the structure
_WRITING_FACE: Final = 2e-4

_PICTURES: Final = 1.0  # processor time of all pictures of a small search, s, imports included

_FIELDS: Final = 0.05  # share of a time limit in which bounds by fields are refined for a picture

_MOST_KEPT: Final = 0.5  # largest share of a time limit that is kept back

BUSY: Final = 6.0
"""Largest factor by which a busy machine may prolong the writing."""


def lateness(seconds: float | None) -> float:
    """Return the time by which a command may pass its time limit `seconds`, s."""
    return max(LATENESS[0], LATENESS[1] * (seconds or 0.0))


def later(deadline: Deadline, settings: ExploreSettings, share: float) -> Deadline:
    """Return a deadline that is later than a time limit, by a share of `lateness`."""
    return deadline.earlier(-share * lateness(settings.seconds))


def busy_factor(clock: float, processor: float) -> float:
    """Return the factor by which a busy machine prolongs work.

    Parameters
    ----------
    clock, processor : float
        Time by the clock and processor time of the same work, s.

    Returns
    -------
    float
        1 to `BUSY`.
    """
    return min(max(1.0, clock / max(processor, 1e-9)), BUSY)


def field_seconds(limit: float | None) -> float:
    """Return the time in which bounds by fields are refined for a picture, s."""
    return FIELD_PICTURE if limit is None else min(FIELD_PICTURE, _FIELDS * limit)


def search_deadline(deadline: Deadline, settings: ExploreSettings, assembly: Assembly, *, fields: bool) -> Deadline:
    """Return the deadline of the search itself, which leaves time to write tables, page and pictures."""
    if settings.seconds is None:
        return deadline
    # What has been done so far tells how much longer writing takes on a busy machine.
    busy = busy_factor(deadline.elapsed(), time.process_time())
    expected, share = busy * (_WRITING + _WRITING_FACE * assembly.faces), _TABLES_ALONE
    if settings.pictures:
        expected, share = expected + busy * _PICTURES, PICTURES
        expected += field_seconds(settings.seconds) if fields else 0.0
    kept = max(0.0, expected - share * lateness(settings.seconds))
    return deadline.earlier(min(kept, _MOST_KEPT * settings.seconds))
