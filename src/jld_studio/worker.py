"""Run a search in its own process, with progress as JSON lines on stdout.

SIGTERM stops the search. Exit codes are those of `jld`.
"""

from __future__ import annotations

import json
import math
import signal
import sys
import time
from pathlib import Path
from typing import Any, Final

from jld_core import InputError, load_scene
from jld_explore import ExploreSettings, Interrupted, Progress, explore
from jld_explore.evaluation import raise_deferred

EVERY: Final = 0.2
"""Smallest time between two progress reports, s."""


class _Teller:
    """Progress reporter that writes at most one line every `EVERY` seconds."""

    def __init__(self) -> None:
        self._last = -math.inf

    def __call__(self, progress: Progress) -> None:
        """Write progress unless the last report is too recent."""
        now = time.monotonic()
        if now - self._last < EVERY:
            return
        self._last = now
        self.tell(progress)

    def tell(self, progress: Progress) -> None:
        """Write progress as one line of JSON."""
        best, bound = (None if not math.isfinite(v) else v for v in (progress.best, progress.bound))
        told: dict[str, Any] = {"done": progress.done, "total": progress.total, "best": best, "bound": bound}
        told["labelling"] = progress.labelling
        sys.stdout.write(json.dumps({**told, "seconds": progress.seconds}) + "\n")
        sys.stdout.flush()


def main(scene: str, folder: str, orders: str) -> int:
    """Search a scene into a folder, with progress as JSON lines on stdout."""

    def stop(number: int, frame: object) -> None:
        raise_deferred(Interrupted())

    signal.signal(signal.SIGINT, stop)
    signal.signal(signal.SIGTERM, stop)
    try:
        explore(load_scene(scene), Path(folder), ExploreSettings(**json.loads(orders)), report=_Teller())
    except InputError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    except Interrupted:
        return 3
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
