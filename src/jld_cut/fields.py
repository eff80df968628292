"""λ of parts by fields: as few convex pieces as fill them, bounded in a process that the clock ends."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Final

import numpy as np
from shapely.errors import GEOSException

from jld_core import Floats, InputError, Ints, build_assembly, files, parse_scene
from jld_core.fields import bounds, bounds_by_fields
from jld_cut.cells import SPLIT, Cutting, convex_parts, joints_of
from jld_cut.meshes import manifold3d, solid_of, surface_of
from jld_cut.scene import Setting, scene_of

Ends = list[float | None]  # bounds of λ, None where there is none

_PIECES: Final = 120  # most convex pieces of all parts
_TURN: Final = np.radians(0.1)  # turn of a concave edge that is split
_HIDDEN: Final = 1e-3  # share of the surface of a solid that joints of its pieces may lack
_FIRST: Final = 10.0  # gap that the first mesh always reaches
_LAST: Final = 0.05  # gap at which refinement ends


def scene_of_parts(name: str, cutting: Cutting, bodies: list[Any], setting: Setting) -> dict[str, Any]:
    """Return the scene of parts as convex pieces, within which they may crack anywhere."""
    outside = cutting.solid.surface_area()
    for few, joined in ((True, True), (True, False), (False, False)):
        pieces, of, planes = _pieces(bodies, few, joined)
        # corners that unions left on edges are none of a convex piece, and pieces without thickness none of a part
        hulls = [piece.hull().simplify(1e-6 * cutting.size).hull() for piece in pieces]
        thick = [k for k, hull in enumerate(hulls) if not hull.is_empty()]
        pieces, of, hulls = [pieces[k] for k in thick], of[thick], [hulls[k] for k in thick]
        fine = Cutting(cutting.solid, pieces, [*cutting.planes, *planes])
        # a joint without some of its corners would bound another solid
        joints = joints_of(pieces, fine.planes, fine.size, SPLIT, corners=None)
        # a joint that rounding hides would let parts fall that stand
        hidden = sum(hull.surface_area() for hull in hulls) - 2 * sum(joint.area for joint in joints) - outside
        if abs(hidden) <= _HIDDEN * outside:
            break
    else:
        raise InputError("fields", "pieces of the parts do not meet in whole faces", "fewer concave facets")
    document = scene_of(name, fine, joints, setting, SPLIT, fine.planes)
    for element, hull, part in zip(document["elements"], hulls, of.tolist(), strict=False):
        points, faces = surface_of(hull)
        element |= {"block": f"part {part + 1}", "vertices": points.tolist(), "faces": faces.tolist()}
    return document


def _pieces(bodies: list[Any], few: bool, joined: bool) -> tuple[list[Any], Ints, list[Floats]]:
    """Split parts into convex pieces: pieces, part of each, and planes of the cuts."""
    pieces, of, planes = list[Any](), list[int](), list[Floats]()
    for part, body in enumerate(bodies):
        # few pieces where that ends in convex ones
        for fewer in (True, False) if few else (False,):
            convex_bodies, _, new_planes, convex = convex_parts([body], max(1, _PIECES - len(pieces)), _TURN, fewer)
            if convex:
                break
        else:
            problem = f"the parts are no union of {_PIECES} convex pieces"
            raise InputError("fields", problem, "fewer concave facets")
        convex_bodies = _join_convex(convex_bodies) if joined else convex_bodies
        pieces, of, planes = pieces + convex_bodies, of + [part] * len(convex_bodies), planes + new_planes
    return pieces, np.array(of), planes


def _join_convex(pieces: list[Any]) -> list[Any]:
    """Join pieces whose union is convex."""
    hulls, volume = [piece.hull() for piece in pieces], [piece.volume() for piece in pieces]
    k = 1
    while k < len(hulls):
        for j in range(k):
            both = manifold3d().Manifold.batch_hull([hulls[j], hulls[k]])
            if both.volume() <= (volume[j] + volume[k]) * (1 + 1e-6):
                hulls[j], volume[j] = both, volume[j] + volume[k]
                del hulls[k], volume[k]
                k = max(1, j)  # what grew may now be joined to others
                break
        else:
            k += 1
    return hulls


@contextmanager
def bounds_beside(
    name: str, cutting: Cutting, bodies: list[Any], setting: Setting, out: Path, seconds: float
) -> Iterator[Callable[[float], tuple[Ends | None, str]]]:
    """Bound λ of parts by fields in a process; yield a function of a wait, s: the last bracket, or None and why."""
    # The process also finds the convex pieces, which may take seconds, and writes their scene into a folder.
    task = name, cutting.planes, surface_of(cutting.solid), [surface_of(body) for body in bodies], setting, out, seconds
    with TemporaryFile() as stream:
        pickle.dump(task, stream)
        stream.seek(0)
        order = [sys.executable, "-m", "jld_cut.fields"]
        process = subprocess.Popen(order, stdin=stream, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def bracket(wait: float) -> tuple[Ends | None, str]:
        try:
            output, faults = process.communicate(timeout=max(0.1, wait))
        except subprocess.TimeoutExpired:
            process.kill()
            output, faults = process.communicate()
        lines = output.decode().splitlines()
        ends = json.loads(lines[-1]) if lines else None
        if ends and any(end is not None for end in ends):
            return ends, ""
        if process.returncode > 0:
            return None, faults.decode().strip().rpartition("\n")[2]
        return None, "fields on these pieces bound nothing" if lines else "time ended before the first mesh"

    try:
        yield bracket
    finally:
        process.kill()
        process.wait()


def _print_brackets(task: tuple[Any, ...]) -> None:
    """Print an upper bound, which takes a tenth of the time, then the bracket of the first mesh, then of the last."""
    name, planes, solid, bodies, setting, out, seconds = task
    end, best = time.time() + seconds, (-np.inf, np.inf)
    cutting = Cutting(solid_of(*solid), planes=planes)
    scene = scene_of_parts(name, cutting, [solid_of(*body) for body in bodies], setting)
    files.write_text(out / "scene_fields.json", json.dumps(scene) + "\n")
    assembly = build_assembly(parse_scene(scene))

    def print_bracket(low: float, high: float) -> tuple[float, float]:
        ends = max(best[0], low), min(best[1], high)
        print(json.dumps([float(value) if np.isfinite(value) else None for value in ends]), flush=True)
        return ends

    setting = bounds.FieldSetting.of(assembly, labels=assembly.labels)
    best = print_bracket(*bounds.Fields.on(setting, setting.coarse, assembly.labels, np.inf).bounds)
    for gap in (_FIRST, _LAST):
        result = bounds_by_fields(assembly, gap=gap, seconds=max(0.0, end - time.time()))
        best = print_bracket(result.lower, result.upper)


if __name__ == "__main__":
    try:
        _print_brackets(pickle.load(sys.stdin.buffer))
    except InputError as error:
        sys.exit(str(error))
    except (ValueError, GEOSException):
        sys.exit("the parts have pieces of no thickness")
