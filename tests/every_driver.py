"""Run as a process: every registered driver into one kind of end, and nothing but our own lines may be printed.

Arguments: the kind (time, budget, interrupt), a scene file, a folder. Pictures are left out: they are drawn alike
whatever the driver. Prints a line of JSON for each driver: name and exit code.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

from command import main
from jld_explore.drivers import DRIVERS
from without_pictures import leave_out_pictures

LIMIT = 0.25


def options(kind: str, driver: str, folder: Path) -> Sequence[str]:
    """What is asked of a driver, beside the scene."""
    jobs = "2" if driver == "genetic" and kind != "budget" else "1"  # processes begin and end alike for all drivers
    own = {"time": ("--seconds", str(LIMIT)), "budget": ("--budget", "7"), "interrupt": ()}[kind]
    return ("--driver", driver, "--out", str(folder / f"{kind}-{driver}"), "--jobs", jobs, "--check-fields", "0", *own)


def interrupt_when(folder: Path) -> None:
    """SIGINT to this process as soon as a search is at work."""
    while not (folder / "scene.json").exists():
        time.sleep(0.01)
    time.sleep(0.05)
    os.kill(os.getpid(), signal.SIGINT)


def run(kind: str, scene: str, folder: Path) -> None:
    """Every driver, one after the other."""
    for driver in DRIVERS:
        sys.argv = ["jld", "explore", scene, *options(kind, driver, folder), "--json"]
        if kind == "interrupt":
            threading.Thread(target=interrupt_when, args=(folder / f"{kind}-{driver}",), daemon=True).start()
        out, sys.stdout = sys.stdout, open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 – closed below
        try:
            main()
        except SystemExit as end:
            code = end.code
        finally:
            sys.stdout.close()
            sys.stdout = out
        print(json.dumps([driver, code]), flush=True)


if __name__ == "__main__":
    leave_out_pictures()
    run(sys.argv[1], sys.argv[2], Path(sys.argv[3]))
