"""Install a wheel as a stranger would and try it: a clean environment outside the checkout, a solve, a search.

`python -m tools.try_wheel dist/*.whl` makes the environment; `--installed` tries what is installed already, as the
workflow that builds wheels does for every machine. Anything that does not come out as it should is an error.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent
SCENE: Final = {
    "name": "three courses",
    "grid": {"cell": [0.4, 0.2], "thickness": 0.2, "rows": ["aabb", "cddc", "eeff", "####"]},
    "materials": {
        "density": 2000,
        "dry": {"friction_coefficient": 0.65},
        "inner": {"tensile_strength": 2e5, "shear_strength": 2e5},
    },
    "loads": {"live": [{"body": [1, 0]}]},
    "search": {"block_cells": [2, 3]},
}
"""A wall that slides at its friction, however it is cut."""

VARIANTS: Final = "from jld_core.batch import build, library; print(*library.built()); print(*build.variants())"
"""Prints the variants of the batch solver that are installed, and those that a wheel for this processor has to hold."""

SEARCH: Final = ["explore", "scene.json", "--out", "search", "--jobs", "1", "--json"]


def clean() -> dict[str, str]:
    """The variables of this process without those that let a checkout be seen; pip would take it for installed."""
    return {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "JLD_"))}


class Trial:
    """Commands run in an empty folder, with nothing of the checkout on any path."""

    def __init__(self, python: Path, folder: Path) -> None:
        self._python, self._folder = python, folder

    def run(self, *arguments: str) -> str:
        """Standard output of the environment's Python. Raises SystemExit with all that was printed if it fails."""
        done = subprocess.run(
            [str(self._python), *arguments],
            cwd=self._folder,
            env=clean() | {"JLD_KERNEL": "built"},  # no compiler may stand in for what the wheel lacks
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
        )
        if done.returncode:
            raise SystemExit(f"{' '.join(arguments)}: exit {done.returncode}\n{done.stdout}{done.stderr}")
        return done.stdout

    def jld(self, *arguments: str) -> str:
        """The command line, as the module behind the command: scripts stand elsewhere on every system."""
        return self.run("-m", "jld_explore", *arguments)


def environment(wheel: Path, folder: Path) -> Path:
    """A fresh environment with the wheel and what it depends on; returns its Python."""
    venv.create(folder, with_pip=True)
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    quiet = ["--quiet", "--disable-pip-version-check"]
    command = [str(python), "-m", "pip", "install", *quiet, "-c", str(ROOT / "constraints.txt"), str(wheel)]
    subprocess.run(command, env=clean(), cwd=folder, check=True)
    script = python.with_name("jld.exe" if os.name == "nt" else "jld")
    expect(script.exists(), f"no command at {script}")
    return python


def expect(right: bool, otherwise: str) -> None:
    """Raises SystemExit unless something is right."""
    if not right:
        raise SystemExit(f"try_wheel: {otherwise}")


def attempt(python: Path, *, compiled: bool) -> list[str]:
    """Version, a solve and a search, each checked; what was found, one line each. compiled: with a batch solver."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scene.json").write_text(json.dumps(SCENE), encoding="utf-8")
        trial = Trial(python, folder)
        place = trial.run("-c", "import jld_core; print(jld_core.__file__)").strip()
        expect(not (Path(place).parents[2] / "pyproject.toml").exists(), f"{place} is a checkout, not an installation")
        version = trial.jld("--version").strip()
        expect(not compiled or "no kernel" not in version, f"{version}: the wheel holds no compiled batch solver")
        held, wanted = trial.run("-c", VARIANTS).splitlines()
        expect(not compiled or held == wanted, f"the wheel holds the variants {held}, expected {wanted}")
        solved = json.loads(trial.jld("solve", "scene.json", "--json"))
        right = solved["status"] == "collapse" and abs(solved["load_factor"] - 0.65) <= 1e-6
        expect(right, f"solve: {solved['status']}, {solved['load_factor']}")
        found = json.loads(trial.jld(*SEARCH))
        expect(found["proven"] and found["best"] >= 0.65 - 1e-6, f"search: {found['best']}")
        files = {path.name for path in (folder / "search").iterdir()}
        expect({"results.csv", "best.png", "summary.json"} <= files, f"search wrote {sorted(files)}")
    return [version, f"solve {solved['load_factor']:.6g}", f"search {found['best']:.6g} of {found['classes']} classes"]


def main() -> None:
    """Try a wheel, or what is installed."""
    parser = argparse.ArgumentParser(description="Install a wheel in a clean environment and try it.")
    parser.add_argument("wheel", nargs="?", type=Path)
    parser.add_argument("--installed", action="store_true", help="try the environment of this Python")
    given = parser.parse_args()
    if given.installed:
        lines = attempt(Path(sys.executable), compiled=True)
    else:
        expect(given.wheel is not None and given.wheel.is_file(), f"no wheel at {given.wheel}")
        with tempfile.TemporaryDirectory() as folder:
            lines = attempt(environment(given.wheel.resolve(), Path(folder) / "clean"), compiled=False)
    print("tried: " + "; ".join(lines))


if __name__ == "__main__":
    main()
