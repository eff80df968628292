"""Declaration of the C interface of cone programs of one sparsity, joined to `interface.py`.

Sizes (docs/method.md, 9.17): n variables, p equations, l linear rows, q cones of three rows, m = p + l + 3 q rows, k
programs.
"""

from __future__ import annotations

import ctypes
from typing import Final

_CONES: Final = (
    ("columns", "int32_t", "n, variables"),
    ("equations", "int32_t", "p, rows that are equations"),
    ("linear", "int32_t", "l, rows with s >= 0"),
    ("cones", "int32_t", "q, second-order cones of three rows; m = p + l + 3 q rows in this order"),
    ("row_start", "const int64_t*", "(m + 1) first entry of each row of A"),
    ("column", "const int32_t*", "(entries) column of each entry"),
    ("value", "const double*", "(entries) value of each entry"),
    ("rhs", "const double*", "(m) b"),
    ("idle", "const double*", "(m) right-hand side of rows that are switched off"),
    ("place", "const int32_t*", "(n + p) place of variables, then equations, in the order of elimination"),
    ("factor_start", "const int64_t*", "(n + p + 1) first entry of each column of the factor L below its diagonal"),
    ("factor_row", "const int32_t*", "(entries of L) row of each"),
    ("left_start", "const int64_t*", "(n + p + 1) first entry of each row of L in `left_column`"),
    ("left_column", "const int32_t*", "(entries of L) columns of the entries of each row"),
    ("left_place", "const int64_t*", "(entries of L) places of these entries among the columns"),
    ("sign", "const double*", "(n + p) sign of each pivot"),
    ("fixed", "const double*", "(n + p + entries of L) constant part of diagonal entries, then of those of L"),
    ("term_start", "const int64_t*", "(n + p + entries of L + 1) first term of each such entry"),
    ("term", "const int32_t*", "(terms) weight: of a linear row, or l + 6 cone + 0 to 5 of a cone's upper triangle"),
    ("coefficient", "const double*", "(terms) coefficient of the weight"),
    ("regular", "double", "added to every pivot with its sign"),
    ("least_pivot", "double", "pivots below it are replaced"),
    ("new_pivot", "double", "by this size"),
    ("bound", "double", "added to the squared scaling of cones, so that weights stay below its inverse"),
    ("refined", "double", "complementarity below which solutions of linear systems are refined"),
)

_TASK: Final = (
    ("count", "int64_t", "k, programs"),
    ("off", "const uint8_t*", "(k, m) 1 where a row is switched off; of a cone all three"),
    ("objective", "const double*", "(k, n) costs"),
    ("gap", "double", "absolute or relative duality gap at which iterations end"),
    ("residual", "double", "relative residual at which iterations end"),
    ("ray", "double", "relative residual of a ray that proves a program infeasible or unbounded"),
    ("share", "double", "share of the longest step"),
    ("least_step", "double", "step below which iterations end without result"),
    ("iterations", "int32_t", "largest number of iterations"),
    ("x", "double*", "(k, n) variables, or a ray"),
    ("z", "double*", "(k, m) multipliers, or a ray"),
    ("value", "double*", "(k) value of the objective"),
    ("state", "int32_t*", "(k) JldConeState"),
    ("used", "int32_t*", "(k) iterations"),
)

CODES: Final[dict[str, tuple[str, str, dict[str, int]]]] = {
    "JldConeState": (
        "int32_t",
        "How a cone program ended: without result; solved; without a feasible point; unbounded.",
        {"CONES_OPEN": 0, "CONES_SOLVED": 1, "CONES_INFEASIBLE": 2, "CONES_UNBOUNDED": 3},
    ),
}
"""Enumerations, as `interface.CODES`."""

STRUCTURES: Final[dict[str, tuple[str, tuple[tuple[str, str, str], ...]]]] = {
    "JldCones": ("Cone programs of one sparsity: least q x, A x + s = b, s in a product of cones, (9.17).", _CONES),
    "JldConeTask": ("Cone programs that differ in costs and rows that are off, and their results.", _TASK),
}
"""Structures, as `interface.STRUCTURES`."""

FUNCTIONS: Final[dict[str, tuple[str, str, tuple[tuple[str, str], ...]]]] = {
    "jld_solve_cones": (
        "int32_t",
        "Solve cone programs of one sparsity.",
        (("const JldCones*", "problem"), ("const JldConeTask*", "task")),
    ),
}
"""Functions, as `interface.FUNCTIONS`."""


class JldCones(ctypes.Structure):
    """Cone programs of one sparsity, see `STRUCTURES`."""


class JldConeTask(ctypes.Structure):
    """Cone programs to solve and their results, see `STRUCTURES`."""


CLASSES: Final = (JldCones, JldConeTask)
"""Structures of ctypes; `interface.py` gives them their fields."""
