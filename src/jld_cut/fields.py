"""λ of parts by fields: as few convex pieces as fill them, bounded in a process that the clock ends."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core import InputError, build_assembly, parse_scene
from jld_core.fields import bounds_by_fields
from jld_cut.cells import Cutting, convex_parts, joints_of
from jld_cut.meshes import surface_of
from jld_cut.scene import Setting, scene_of

_PIECES: Final = 60  # most convex pieces of all parts
_TURN: Final = np.radians(0.1)  # turn of a concave edge that is split
_CONVEX: Final = 1e-3  # share of a convex hull that a joint between pieces may lack
_FIRST: Final = 10.0  # gap that the first mesh always reaches
_LAST: Final = 0.05  # gap at which refinement ends


def scene_of_parts(name: str, cutting: Cutting, bodies: list[Any], setting: Setting) -> dict[str, Any]:
    """Return the scene of parts as convex pieces, within which they may crack anywhere; InputError for others."""
    pieces, of, planes, convex = convex_parts(bodies, _PIECES, _TURN)
    if not convex:
        raise InputError("fields", f"the parts are no union of {_PIECES} convex pieces", "fewer concave facets")
    fine = Cutting(cutting.solid, pieces, [*cutting.planes, *planes])
    document = scene_of(name, fine, joints_of(pieces, fine.planes, fine.size, _CONVEX), setting, _CONVEX, fine.planes)
    for element, piece, part in zip(document["elements"], pieces, of.tolist(), strict=False):
        # corners that unions left on edges are none of a convex piece
        points, faces = surface_of(piece.hull().simplify(1e-6 * fine.size).hull())
        element |= {"block": f"part {part + 1}", "vertices": points.tolist(), "faces": faces.tolist()}
    return document


@contextmanager
def bounds_beside(scene: Path, seconds: float) -> Iterator[Callable[[float], list[float | None] | None]]:
    """Begin bounds of λ by fields in a process; yield what waits so long for the best bracket until then."""
    order = [sys.executable, "-m", "jld_cut.fields", str(scene), str(seconds)]
    process = subprocess.Popen(order, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)

    def bracket(seconds: float) -> list[float | None] | None:
        try:
            told, _ = process.communicate(timeout=max(0.1, seconds))
        except subprocess.TimeoutExpired:
            process.kill()
            told, _ = process.communicate()
        lines = told.decode().splitlines()
        return None if not lines else json.loads(lines[-1])

    try:
        yield bracket
    finally:
        process.kill()
        process.wait()


def _told(scene: Path, seconds: float) -> None:
    """Print the bracket of the first mesh, then of the last one that time leaves."""
    end = time.time() + seconds
    assembly = build_assembly(parse_scene(json.loads(scene.read_text(encoding="utf-8"))))
    for gap in (_FIRST, _LAST):
        found = bounds_by_fields(assembly, gap=gap, seconds=max(0.0, end - time.time()))
        ends = [float(value) if np.isfinite(value) else None for value in (found.lower, found.upper)]
        print(json.dumps(ends), flush=True)


if __name__ == "__main__":
    _told(Path(sys.argv[1]), float(sys.argv[2]))
