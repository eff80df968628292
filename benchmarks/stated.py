"""The static problem in CVXPY as one would write it: vectors over all faces, forces over the total weight."""

from __future__ import annotations

import importlib
from typing import Any, Final

import numpy as np

from jld_core import Assembly
from jld_core.arrays import Bits
from jld_core.mechanics import equilibrium_matrix, load_vectors
from jld_core.strengths import Route

ROUTE = Route("a benchmark")

CLARABEL_DEFAULT: Final = {"tol_gap_abs": 1e-8, "tol_gap_rel": 1e-8, "tol_feas": 1e-8}


def stated(assembly: Assembly, labels: Bits, solver: str = "CLARABEL", **options: Any) -> float:
    """λ of one labelling, NaN where the solver has none. Planar faces, or spatial ones that are rectangles.

    labels: (m,) True dry. solver: a name CVXPY knows. options: of that solver; default its own tolerances.
    Source: Iannuzzo et al. 2024, eq. (2)–(7), as docs/method.md (2.1) to (2.7).
    """
    cp: Any = importlib.import_module("cvxpy")  # half of it is typed, and a strict check trips over the other
    unit = assembly.total_dead
    forces, load = cp.Variable((len(assembly.interfaces), assembly.freedoms)), cp.Variable()
    dead, live = load_vectors(assembly)
    balance = equilibrium_matrix(assembly) @ cp.vec(forces, order="C") + dead / unit + load * live / unit == 0
    admissible = _planar if assembly.dimension == 2 else _spatial
    problem = cp.Problem(cp.Maximize(load), [balance, *admissible(cp, assembly, labels, forces)])
    if solver == "CLARABEL":
        options = {**CLARABEL_DEFAULT, **options}
    problem.solve(solver=solver, **options)
    return float("nan") if load.value is None else float(load.value)


def _planar(cp: Any, assembly: Assembly, labels: Bits, forces: Any) -> list[Any]:
    faces, strengths, unit = assembly.interfaces, assembly.strengths(ROUTE), assembly.total_dead
    n, v, m = forces[:, 0], forces[:, 1], forces[:, 2]
    half, dry, inner = 0.5 * faces.l1, np.flatnonzero(labels), np.flatnonzero(~labels)
    constraints = []
    if dry.size:
        constraints += [
            cp.abs(m[dry]) <= cp.multiply(half[dry], n[dry]),
            cp.abs(v[dry]) <= cp.multiply(strengths.friction[dry], n[dry]),
        ]
    if inner.size:
        tension = strengths.tension[inner] * faces.area[inner] / unit
        shear = strengths.shear[inner] * faces.area[inner] / unit
        constraints += [
            cp.abs(m[inner]) <= cp.multiply(half[inner] / 3.0, n[inner] + tension),
            cp.abs(v[inner]) <= shear,
        ]
    return constraints


def _spatial(cp: Any, assembly: Assembly, labels: Bits, forces: Any) -> list[Any]:
    faces, strengths, unit = assembly.interfaces, assembly.strengths(ROUTE), assembly.total_dead
    constraints = []
    for kind, share in ((np.flatnonzero(labels), 0.5), (np.flatnonzero(~labels), 1.0 / 6.0)):
        if not kind.size:
            continue
        n, twist = forces[kind, 0], cp.multiply(1.0 / faces.c_t[kind], cp.abs(forces[kind, 5]))
        dry = share == 0.5
        held = n if dry else n + strengths.tension[kind] * faces.area[kind] / unit
        capacity = cp.multiply(strengths.friction[kind], n) if dry else strengths.shear[kind] * faces.area[kind] / unit
        constraints += [
            cp.abs(forces[kind, 3]) <= cp.multiply(share * faces.l2[kind], held),
            cp.abs(forces[kind, 4]) <= cp.multiply(share * faces.l1[kind], held),
            cp.norm(forces[kind, 1:3], axis=1) + twist <= capacity,
        ]
    return constraints
