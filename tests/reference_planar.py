"""The static problem, docs/method.md (2.1), stated a second time, in CVXPY and in scene units, from geometry alone.

Nothing of equilibrium.py, scaling.py or yield_sets.py is used: a fault there cannot hide here.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import scipy.sparse as sp

from cases import ROUTE
from jld_core import Assembly
from jld_core.arrays import Bits, Ints


def reference_problem(assembly: Assembly, labels: Bits) -> tuple[cp.Problem, cp.Variable]:
    """max λ for one labelling. Returns the problem and λ; forces are divided by a common weight for the solver.

    Conditions of all faces are stated together: CVXPY takes far longer over many small ones than the solver does.
    """
    faces, elements, s = assembly.interfaces, assembly.elements, assembly.strengths(ROUTE)
    # a plain scale, so that the solver's absolute tolerances mean something; nothing else is scaled
    unit = assembly.total_dead / max(len(elements.free), 1) or assembly.total_live
    reach = assembly.size
    count = len(faces)
    n, v, m = (cp.Variable(count) for _ in range(3))  # m is moment / reach
    load = cp.Variable()
    place = {int(element): 3 * position for position, element in enumerate(elements.free)}
    acts = sp.lil_array((3 * len(place), 3 * count))  # forces of faces (all n, all v, all m) → on elements
    length = np.empty(count)
    for k in range(count):
        start, end = faces.polygon[k]
        length[k] = np.hypot(*(end - start))
        direction, across = faces.normal[k], np.array([-faces.normal[k][1], faces.normal[k][0]])
        for element, sign in ((int(faces.a[k]), -1.0), (int(faces.b[k]), 1.0)):
            if element not in place:
                continue
            arm, row = (start + end) / 2 - elements.centroid[element], place[element]
            for column, way in ((k, direction), (count + k, across)):
                acts[row, column], acts[row + 1, column] = sign * way
                acts[row + 2, column] = sign * (arm[0] * way[1] - arm[1] * way[0]) / reach
            acts[row + 2, 2 * count + k] = sign
    size = np.array([1.0, 1.0, reach])
    dead = (assembly.dead[elements.free] / unit / size).ravel()
    live = (assembly.live[elements.free] / assembly.total_live / size).ravel()
    constraints = [acts.tocsr() @ cp.hstack([n, v, m]) + dead + load * live == 0]
    area, half = length * np.asarray(faces.l2) / unit, length / 2 / reach  # area: of a stress, what its force is
    dry, crushed = np.asarray(labels, dtype=bool), np.isfinite(np.where(labels, s.crush_dry, s.crush_inner))

    def where(chosen: Bits) -> Ints:
        return np.flatnonzero(chosen)

    if len(k := where(dry)):
        constraints.append(cp.abs(v[k]) <= s.cohesion[k] * area[k] + cp.multiply(s.friction[k], n[k]))
        constraints.append(n[k] >= 0)  # which friction alone says of itself
    if len(k := where(dry & crushed)):
        bent, pressed = cp.multiply(1 / half[k], cp.abs(m[k])), cp.square(n[k])
        constraints.append(bent + cp.multiply(1 / (s.crush_dry[k] * area[k]), pressed) <= n[k])
    if len(k := where(dry & ~crushed)):
        constraints.append(cp.abs(m[k]) <= cp.multiply(half[k], n[k]))
    if len(k := where(~dry)):
        constraints.append(cp.abs(m[k]) <= cp.multiply(half[k] / 3, n[k] + s.tension[k] * area[k]))
        constraints.append(cp.abs(v[k]) <= s.shear[k] * area[k] + cp.multiply(s.inner_friction[k], n[k]))
    if len(k := where(~dry & crushed)):
        constraints.append(cp.abs(m[k]) <= cp.multiply(half[k] / 3, s.crush_inner[k] * area[k] - n[k]))
    return cp.Problem(cp.Maximize(load), constraints), load


def reference_load_factor(assembly: Assembly, labels: Bits, simplex: bool = False) -> float:
    """λ by CVXPY: +inf where it is unbounded, −inf where no λ ≥ 0 is admissible.

    simplex: HiGHS instead of Clarabel, for data that an interior point on an unscaled program gets wrong.
    """
    problem, load = reference_problem(assembly, labels)
    if simplex:
        problem.solve(solver=cp.HIGHS)
    else:
        problem.solve(solver=cp.CLARABEL, tol_gap_abs=1e-11, tol_gap_rel=1e-11, tol_feas=1e-11)
    unit = assembly.total_dead / max(len(assembly.elements.free), 1) or assembly.total_live
    if problem.status in ("infeasible", "infeasible_inaccurate"):
        return -np.inf
    if problem.status in ("unbounded", "unbounded_inaccurate"):
        # a ray of improvement says nothing of whether there is a state to improve
        standing = cp.Problem(cp.Maximize(0), [*problem.constraints, load >= 0])
        standing.solve(solver=cp.CLARABEL)
        return np.inf if standing.status in ("optimal", "optimal_inaccurate") else -np.inf
    value = float(load.value) * unit / assembly.total_live
    return value if value > -1e-9 * unit / assembly.total_live else -np.inf
