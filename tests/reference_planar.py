"""The static problem, docs/method.md (2.1), stated a second time, in CVXPY and in scene units, from geometry alone.

Nothing of equilibrium.py, scaling.py or yield_sets.py is used: a fault there cannot hide here.
"""

from __future__ import annotations

import cvxpy as cp
import numpy as np

from jld_core.arrays import Bits
from jld_core.assembly import Assembly


def reference_problem(assembly: Assembly, labels: Bits) -> tuple[cp.Problem, cp.Variable]:
    """max λ for one labelling. Returns the problem and λ; forces are divided by a common weight for the solver."""
    faces, elements, s = assembly.interfaces, assembly.elements, assembly.strengths
    # a plain scale, so that the solver's absolute tolerances mean something; nothing else is scaled
    unit = assembly.total_dead / max(len(elements.free), 1) or assembly.total_live
    reach = assembly.size
    n, v, m = (cp.Variable(len(faces)) for _ in range(3))  # m is moment / reach
    load = cp.Variable()
    forces = {e: [[], [], []] for e in elements.free}
    for k in range(len(faces)):
        direction, across = faces.normal[k], np.array([-faces.normal[k][1], faces.normal[k][0]])
        for element, sign in ((int(faces.a[k]), -1.0), (int(faces.b[k]), 1.0)):
            if element not in forces:
                continue
            arm = (faces.polygon[k][0] + faces.polygon[k][1]) / 2 - elements.centroid[element]
            for axis in (0, 1):
                forces[element][axis].append(sign * (n[k] * direction[axis] + v[k] * across[axis]))
            lever_n = (arm[0] * direction[1] - arm[1] * direction[0]) / reach
            lever_v = (arm[0] * across[1] - arm[1] * across[0]) / reach
            forces[element][2].append(sign * (n[k] * lever_n + v[k] * lever_v + m[k]))
    constraints = []
    for element, parts in forces.items():
        for axis, size in ((0, 1.0), (1, 1.0), (2, reach)):
            dead = assembly.dead[element, axis] / unit / size
            live = assembly.live[element, axis] / assembly.total_live / size
            constraints.append(sum(parts[axis]) + dead + load * live == 0)
    for k in range(len(faces)):
        length = float(np.hypot(*(faces.polygon[k][1] - faces.polygon[k][0])))
        area = length * float(faces.l2[k])
        half = length / 2 / reach
        if labels[k]:
            mu, crush = s.friction[k], s.crush_dry[k] * area / unit
            stuck = s.cohesion[k] * area / unit
            constraints.append(cp.abs(v[k]) <= stuck + mu * n[k])
            constraints.append(n[k] >= 0)  # which friction alone says of itself
            if np.isfinite(crush):
                constraints.append(cp.abs(m[k]) / half + cp.square(n[k]) / crush <= n[k])
            else:
                constraints.append(cp.abs(m[k]) <= half * n[k])
        else:
            tension, shear = s.tension[k] * area / unit, s.shear[k] * area / unit
            constraints.append(cp.abs(m[k]) <= half / 3 * (n[k] + tension))
            constraints.append(cp.abs(v[k]) <= shear + s.inner_friction[k] * n[k])
            if np.isfinite(s.crush_inner[k]):
                constraints.append(cp.abs(m[k]) <= half / 3 * (s.crush_inner[k] * area / unit - n[k]))
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
