"""Show the progress of a search on stderr if it is a terminal."""

from __future__ import annotations

import math
import sys
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
)

from jld_explore.report.words import speed
from jld_explore.search import state


class ProgressBar:
    """Progress bar of a search on stderr: count, rate, best λ with bound and gap, and time left.

    Use it as a context, and call it with each progress report. Nothing is shown if stderr is no terminal.
    """

    def __init__(self, label: str) -> None:
        console = Console(file=sys.stderr)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            TextColumn("{task.fields[best]}"),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            console=console,
            disable=not console.is_terminal,
            transient=True,
        )
        self._task = self._bar.add_task(label, total=None, rate="", best="", left="")

    def __enter__(self) -> Self:
        """Start the display."""
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop the display."""
        self._bar.stop()

    def __call__(self, now: state.Progress) -> None:
        """Show the latest progress report of a search."""
        best = "no λ yet" if math.isnan(now.best) else f"best λ {now.best:.6g}"
        if math.isfinite(now.bound):
            best += f" ≤ {now.bound:.6g}"
        if math.isfinite(now.gap):
            best += f", gap {now.gap:.2%}"
        rates = speed(now.solved / now.seconds if now.seconds > 0.0 else None).lstrip(", ")
        left = _time_left(now)
        self._bar.update(self._task, completed=now.done, total=now.total, rate=rates, best=best, left=left)


def _time_left(now: state.Progress) -> str:
    """Return in words how long a search goes on at most; "" if nothing is known.

    It ends at its time limit, or when the layouts that are left have been evaluated at the rate so far.
    """
    rest = now.seconds * (now.total - now.done) / now.done if now.total and now.done else math.inf
    left = min(rest, now.left)
    return f"{left:.0f} s left" if math.isfinite(left) else ""
