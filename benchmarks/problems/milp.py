"""A plain mixed-integer program of planar layouts, as one writes it without this project: for comparison."""

from __future__ import annotations

import math
import time
from collections import deque
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.optimize import Bounds, LinearConstraint
from scipy.optimize import milp as solve_milp

from jld_core import FACTS, Assembly, Route, Scene, build_assembly
from jld_core.mechanics import equilibrium_matrix
from jld_explore import search_space


def milp(scene: Scene, seconds: float) -> tuple[float, float, bool]:
    """Return λ, time and whether it is optimal: a binary per face, yield sets by large numbers, slits cut off lazily.

    Limits on blocks other than "no slits" are left out, so that λ may be above the best known; NaN in space, with load
    cases and where no layout is found.
    """
    assembly, start = build_assembly(scene), time.perf_counter()
    if assembly.dimension == 3 or assembly.cases or scene.cracks != "faces" or scene.search.block_cells is not None:
        return math.nan, 0.0, False
    space = search_space(scene, assembly)
    faces, m = assembly.interfaces, len(assembly.interfaces)
    free = np.flatnonzero(~assembly.elements.support)
    strengths = assembly.strengths(Route("a plain program", frozenset(FACTS)))
    size = max(1.0, float(abs(assembly.dead).sum()))
    matrix = sp.csr_array(equilibrium_matrix(assembly))
    live = assembly.live[free].ravel()
    balance = sp.hstack([matrix, sp.csr_array((matrix.shape[0], m)), sp.csr_array(live[:, None])])
    rows: list[Any] = []
    ends: list[float] = []
    big = 1e3 * size

    def yields(face: int, coefficients: tuple[float, float, float], least: float, dry: bool) -> None:
        """Add coefficients · (N, V, M) ≥ −least where the face has the label."""
        row = np.zeros(4 * m + 1)
        row[3 * face : 3 * face + 3] = coefficients
        row[3 * m + face] = -big if dry else big
        rows.append(row)
        ends.append(-least - (big if dry else 0.0))

    for face in range(m):
        half, area = 0.5 * faces.l1[face], faces.area[face]
        for sign in (1.0, -1.0):
            yields(face, (strengths.friction[face], sign, 0.0), 0.0, True)
            yields(face, (half, 0.0, sign), 0.0, True)
            if not np.isnan(strengths.tension[face]):
                yields(face, (half / 3.0, 0.0, sign), strengths.tension[face] * area * half / 3.0, False)
                yields(face, (0.0, sign, 0.0), strengths.shear[face] * area, False)
    low, high = np.full(4 * m + 1, -big), np.full(4 * m + 1, big)
    low[3 * m :], high[3 * m : -1] = 0.0, 1.0
    kept = np.flatnonzero(~space.candidates)
    low[3 * m + kept] = high[3 * m + kept] = space.fixed[kept]
    whole = np.zeros(4 * m + 1)
    whole[3 * m : -1] = 1
    goal = np.zeros(4 * m + 1)
    goal[-1] = -1.0
    cuts: list[Any] = []
    while True:
        constraint = [
            LinearConstraint(balance, -assembly.dead[free].ravel(), -assembly.dead[free].ravel()),
            LinearConstraint(sp.csr_array(np.array(rows + cuts)), np.array(ends + [0.0] * len(cuts)), np.inf),
        ]
        left = seconds - (time.perf_counter() - start)
        if left <= 0.0:
            return math.nan, time.perf_counter() - start, False
        found = solve_milp(goal, integrality=whole, bounds=Bounds(low, high), constraints=constraint,
                           options={"time_limit": left})  # fmt: skip
        if found.x is None:
            return math.nan, time.perf_counter() - start, False
        slits = _slits(assembly, found.x[3 * m : -1] > 0.5)
        if not slits:
            return -float(found.fun), time.perf_counter() - start, found.status == 0
        for face, path in slits:  # a dry face needs another one on every way around it
            row = np.zeros(4 * m + 1)
            row[3 * m + face], row[[3 * m + one for one in path]] = -1.0, 1.0
            cuts.append(row)


def _slits(assembly: Assembly, dry: Any) -> list[tuple[int, list[int]]]:
    """Return dry faces whose two elements are joined by inner faces, each with these faces."""
    faces, found = assembly.interfaces, []
    near: dict[int, list[tuple[int, int]]] = {}
    for face in np.flatnonzero(~dry).tolist():
        a, b = int(faces.a[face]), int(faces.b[face])
        near.setdefault(a, []).append((b, face))
        near.setdefault(b, []).append((a, face))
    for face in np.flatnonzero(dry).tolist():
        a, b = int(faces.a[face]), int(faces.b[face])
        way: dict[int, tuple[int, int] | None] = {a: None}
        waiting = deque([a])
        while waiting and b not in way:
            here = waiting.popleft()
            for other, by in near.get(here, []):
                if other not in way:
                    way[other] = (here, by)
                    waiting.append(other)
        if b in way:
            path, here = [], b
            while (step := way[here]) is not None:
                here = step[0]
                path.append(step[1])
            found.append((face, path))
    return found
