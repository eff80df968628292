"""Declaration of the C interface of the batch solver, the one place where it is stated, scaled as (8.1) to (8.3).

`build.py` writes the C header from it, `library.py` takes ctypes structures; the header asserts sizes and offsets. It
imports nothing of the package, because `setup.py` loads it alone. Sizes: n elements, m faces, k labellings, q freedoms
of an element, L labels (2, or 3 where faces may be undecided).
"""

from __future__ import annotations

import ctypes
import textwrap
from typing import Any, Final

# Cone programs of one sparsity (docs/method.md, 9.17): n variables, p equations, l linear rows, q cones of three rows,
# m = p + l + 3 q rows, k programs.
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

_CONE_TASK: Final = (
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
    "JldLabel": ("uint8_t", "Label of a face.", {"INNER": 0, "DRY": 1, "UNDECIDED": 2}),
    "JldVerdict": (
        "int32_t",
        "What is proven of a labelling: nothing; both bounds and a narrow bracket; no load factor from 0 on is "
        "admissible, (3.15); the load factor exceeds its threshold; the load factor is unbounded, (3.14).",
        {"OPEN": 0, "PROVEN": 1, "FALLS": 2, "CARRIES": 3, "LOCKED": 4},
    ),
    "JldFate": (
        "uint8_t",
        "Result of a conflict minimisation: open or never begun; refuted by a mechanism; forces carry more than the "
        "threshold.",
        {"LEFT": 0, "REFUTED": 1, "CARRIED": 2},
    ),
    "JldBlockState": (
        "uint8_t",
        "State of a choice of blocks: open; multipliers accurate; below the threshold.",
        {"UNSOLVED": 0, "SOLVED": 1, "BELOW": 2},
    ),
    "JldConeState": (
        "int32_t",
        "How a cone program ended: without result; solved; without a feasible point; unbounded.",
        {"CONES_OPEN": 0, "CONES_SOLVED": 1, "CONES_INFEASIBLE": 2, "CONES_UNBOUNDED": 3},
    ),
    "JldOutcome": (
        "int32_t",
        "Outcome of a call: done; no memory; a problem of another shape; an unexpected C++ exception.",
        {"DONE": 0, "NO_MEMORY": 1, "UNSUPPORTED": 2, "FAILED": 3},
    ),
}
"""Enumerations of C: integer type, meaning, and values by name without the prefix JLD_."""

BLOCK_ROWS: Final = 96
"""Largest number of rows of one block in the relaxation by blocks; workspaces of the compiled solver have this size."""

_PATTERN: Final = (
    ("nodes", "int32_t", "matrix blocks on the diagonal"),
    ("column_start", "const int32_t*", "(nodes + 1) first matrix block below the diagonal of each column"),
    ("row", "const int32_t*", "(matrix blocks) row of each"),
    ("entered", "const uint8_t*", "(matrix blocks) 1 where the matrix has an entry, 0 where elimination fills in"),
    ("pair_start", "const int32_t*", "(matrix blocks + 1) first product that is subtracted from each"),
    ("pair", "const int32_t*", "(products, 2) factors of each product: matrix blocks of its row and of its column"),
    ("left_start", "const int32_t*", "(nodes + 1) first matrix block to the left of each diagonal one"),
    ("left", "const int32_t*", "(matrix blocks) those matrix blocks"),
    ("left_column", "const int32_t*", "(matrix blocks) their columns"),
)

_PROBLEM: Final = (
    ("elements", "int32_t", "n, free elements"),
    ("faces", "int32_t", "m"),
    ("pairs", "int32_t", "planar: pairs of rows of a face; spatial: 2 pairs of bending rows, or edges of a hull"),
    ("labels", "int32_t", "L"),
    ("freedoms", "int32_t", "q"),
    ("drops_shear", "int32_t", "1 if a face drops V (spatial: V and MT) under some label, after (2.8)"),
    ("pattern", "JldFactorPattern", "pattern of the factor of A H^-1 A', (8.5)"),
    ("low", "const int32_t*", "(m) element of each face that is eliminated first, -1 for none"),
    ("high", "const int32_t*", "(m) other element, -1 for a support"),
    ("block", "const int32_t*", "(m) matrix block below the diagonal that the two elements share, -1 for none"),
    (
        "sides",
        "const double*",
        "(m, 2, 7 or 27) columns of A_eq of (1.1) for each side of a face. Planar: of N and V row by row, then the one "
        "of M in the last row. Spatial: of N, V1, V2 in the rows of forces, in those of moments, then of M1, M2, MT in "
        "the rows of moments",
    ),
    (
        "rows",
        "const double*",
        "(L, m, numbers) yield rows of section 2. Planar: a, b, h of -a N +- b X <= h for each pair, X = M, V, M. "
        "Spatial: a, b, h of both bending pairs, or a, p, q, h of -a N + p M1 + q M2 <= h for each edge of a hull and "
        "then the corners (x, y) between edges; last a, b, h of -a N + b t +- b MT <= h, (2.8)",
    ),
    (
        "keep",
        "const double*",
        "(L, m) 1 where the label keeps V (spatial: V, MT) in equilibrium, 0 where it drops them",
    ),
    ("dead", "const double*", "(q n) dead load b of (1.1); (L, q n) with `own_loads`"),
    ("live", "const double*", "(q n) live load b_lambda of (1.1); (L, q n) with `own_loads`"),
    ("narrow", "int32_t", "1: bounds of planar faces in half the lanes of AVX-512"),
    ("own_loads", "int32_t", "1 if each label has its own loads: those of the label of the first face count"),
    ("floor", "double", "lambda >= -floor"),
    ("opening", "const double*", "(q n) velocities that open every face, (3.11); or null"),
    ("noise", "double", "relative rounding error of a sum"),
    ("forces", "const double*", "(q m) resultants of the starting point"),
    ("jumps", "const double*", "(q m) jumps (3.1) of the velocities of the starting point"),
    ("velocity", "const double*", "(q n) velocities of the starting point"),
    ("load", "double", "lambda of the starting point"),
    ("least_slack", "double", "least slack of a row at the starting point"),
    ("least_multiplier", "double", "least multiplier of a row at the starting point"),
    ("zero", "double", "magnitude of lambda relative to which a bracket around zero counts as narrow"),
    ("gap", "double", "relative width (3.13) of a narrow bracket"),
    (
        "parabolas",
        "const double*",
        "(L, m, 2 or 14) of planar first pairs that crush, (2.10): c, N0 of b |M| <= h + a N - c N^2 from N0 on, and "
        "its tangent at N0 below; then the numbers of MomentShearInteraction if `coupled`. Null where no face crushes",
    ),
    ("coupled", "int32_t", "1 if rows of V and M meet under some label"),
)

_TRY: Final = (
    ("proximal", "double", "proximal term added to H"),
    ("margin", "double", "slack that every row keeps"),
    ("target", "double", "relative gap to reach"),
    ("active", "double", "slack below which a row takes part in the polished motion"),
    ("first", "double", "share of the longest step far from the solution"),
    ("last", "double", "share of the longest step at a relative gap of `near` and below"),
    ("near", "double", "relative gap, see `last`"),
    ("relax", "double", "relative gap below which the proximal term decreases"),
    ("jumps", "double", "admissible error of the jumps, relative to the velocities"),
    ("aim", "double", "1: largest lambda; 0: analytic centre of the admissible forces; -1: a ray of unbounded load"),
    ("press", "double", "cost of a unit of N, which bounds forces that nothing else bounds"),
    ("endless", "double", "lambda, relative to the starting point, above which a ray is looked for"),
    ("most", "int32_t", "largest number of iterations"),
    ("resumes", "int32_t", "1: begin where the last pass has ended"),
    ("apart", "int32_t", "1: planar forces gain the correction of equilibrium by a step of its own"),
)

_MINIMIZATION: Final = (
    ("count", "int64_t", "k"),
    ("labels", "const uint8_t*", "(k, m) JldLabel; undecided where a face is undecided from the start"),
    ("free", "const uint8_t*", "(m) 1 where a face may have either label"),
    ("thresholds", "const double*", "(k) lambda"),
    ("neighbours", "int32_t", "further labellings begun from each conflict, with one face of it undecided"),
    ("tries", "int32_t", "single faces tried without success before a conflict is accepted as minimal"),
    ("inner", "int32_t", "1: try inner faces before dry ones"),
    ("balance", "double", "error of equilibrium up to which forces that carry more than the threshold count"),
    ("seed", "uint64_t", "seed of the choice of neighbours"),
    ("fate", "uint8_t*", "(r) JldFate; r = k (1 + neighbours) here and below"),
    ("conflict", "uint8_t*", "(r, m) 1 where a face of the conflict stays decided"),
    ("velocity", "double*", "(r, q n) mechanism that refutes"),
    ("relaxations", "int32_t*", "(r) relaxations solved"),
)

_ANSWERS: Final = (
    ("low", "double*", "(k) proven lower bound, -inf for none"),
    ("high", "double*", "(k) proven upper bound, +inf for none"),
    ("verdict", "int32_t*", "(k) JldVerdict"),
    ("iterations", "int32_t*", "(k) iterations of all passes"),
    ("tries", "int32_t*", "(k) passes"),
    ("forces", "double*", "(k, q m) forces of the lower bound; or null"),
    ("velocity", "double*", "(k, q n) velocities of the upper bound; or null"),
    ("diagnosis", "double*", "(k, 4) slack, error, margin before the opening (3.11), gap; or null"),
    ("rays", "double*", "(k, q m) ray R of (3.14) for lambda = 1 of locked labellings; or null"),
)

_BLOCKS: Final = (
    ("blocks", "int32_t", "possible blocks"),
    ("nodes", "int32_t", "nodes of three shared rows each"),
    ("pattern", "JldFactorPattern", "pattern of the factor of the shared rows"),
    ("own_start", "const int32_t*", "(blocks + 1) first row that belongs to each block alone"),
    ("shared_start", "const int32_t*", "(blocks + 1) first entry of each block in `shared`"),
    ("shared", "const int32_t*", "rows that a block shares with others: 3 node + row, in the order of elimination"),
    ("column_start", "const int32_t*", "(blocks + 1) first column of each block"),
    ("entry_start", "const int32_t*", "(columns + 1) first entry of each column"),
    ("entry_row", "const int32_t*", "(entries) row within the block: its own rows first, then the shared ones"),
    ("entry", "const double*", "(entries) value"),
    ("of_x", "const double*", "(rows of all blocks) entries of the share x_p of each block"),
    ("of_load", "const double*", "(rows of all blocks) entries of the load factor times the share"),
    ("place_start", "const int32_t*", "(blocks + 1) first entry of each block in `place`"),
    ("place", "const int32_t*", "position of each pair of shared rows, lower triangle: diagonal, or -1 - off-diagonal"),
    ("rhs", "const double*", "(3 nodes) right-hand side of the shared rows"),
    ("loads", "int32_t", "number of shared rows that lambda enters"),
    ("load", "const int32_t*", "(loads) shared rows that lambda enters, with coefficient -1"),
)

_BLOCK_TASK: Final = (
    ("count", "int64_t", "k, choices of allowed blocks"),
    ("allowed", "const uint8_t*", "(k, blocks) 1 where a choice allows the block"),
    ("thresholds", "const double*", "(k) lambda to reach"),
    ("least_load", "const double*", "(k) lower bound on the lambda of every block"),
    ("most_load", "const double*", "(k) upper bound on the lambda of every block"),
    ("gap", "double", "relative gap at which iterations end"),
    ("near", "double", "relative distance from the threshold below which `fine_gap` replaces `gap`"),
    ("fine_gap", "double", "relative gap close to the threshold"),
    ("error", "double", "error of the multipliers at which iterations end"),
    ("iterations", "int32_t", "largest number of iterations of one choice"),
    ("dual", "double*", "(k, own rows + shared rows) multipliers"),
    ("share", "double*", "(k, blocks) shares of the blocks"),
    ("load", "double*", "(k) lambda"),
    ("iterations_used", "int32_t*", "(k) iterations"),
    ("state", "uint8_t*", "(k) JldBlockState"),
)

_FRONTS: Final = (
    ("count", "int32_t", "fronts, children before their parents"),
    ("bounds", "const int64_t*", "(count + 1) first pivot unknown of each front"),
    ("passed_start", "const int64_t*", "(count + 1) first entry of each front in `passed` and `place`"),
    ("passed", "const int64_t*", "unknowns of each front's update matrix"),
    ("place", "const int32_t*", "row of each such unknown in the parent front, pivots first"),
    ("parent", "const int32_t*", "(count) parent of each front, -1 for a root"),
    ("factor_start", "const int64_t*", "(count) first number of each front's pivot columns in the factor"),
    ("routines", "const int64_t*", "(5) addresses of the Fortran routines dpotrf, dtrsm, dsyrk, dtrsv and dgemv"),
)

STRUCTURES: Final[dict[str, tuple[str, tuple[tuple[str, str, str], ...]]]] = {
    "JldFactorPattern": ("Pattern of a sparse Cholesky factor, fill included, in the order of elimination.", _PATTERN),
    "JldProblem": ("One assembly, with the yield rows of every label.", _PROBLEM),
    "JldTry": ("Settings of one pass over the labellings.", _TRY),
    "JldMinimization": ("Labellings below their thresholds, and their minimised conflicts.", _MINIMIZATION),
    "JldAnswers": ("Bounds on lambda of k labellings.", _ANSWERS),
    "JldBlocks": ("Linear program of the relaxation by blocks, (6.5) and (6.6), for all possible blocks.", _BLOCKS),
    "JldBlockTask": ("Choices of allowed blocks, and their results.", _BLOCK_TASK),
    "JldCones": ("Cone programs of one sparsity: least q x, A x + s = b, s in a product of cones, (9.17).", _CONES),
    "JldConeTask": ("Cone programs that differ in costs and rows that are off, and their results.", _CONE_TASK),
    "JldFronts": ("Fronts of a sparse Cholesky factorisation, in the order of elimination.", _FRONTS),
}
"""Structures of C: meaning, and name, type and meaning of each field in order."""

FUNCTIONS: Final[dict[str, tuple[str, str, tuple[tuple[str, str], ...]]]] = {
    "jld_sources": ("const char*", "Return the hash of the sources.", ()),
    "jld_variant": ("const char*", "Return the name of the variant.", ()),
    "jld_width": ("int32_t", "Return the number of labellings that are solved together.", ()),
    "jld_solve": (
        "int32_t",
        "Bound lambda of labellings (count, m); thresholds (count) may be null.",
        (
            ("const JldProblem*", "problem"),
            ("const JldTry*", "tries"),
            ("int32_t", "number_of_tries"),
            ("int64_t", "count"),
            ("const uint8_t*", "labels"),
            ("const double*", "thresholds"),
            ("const JldAnswers*", "answers"),
        ),
    ),
    "jld_minimize": (
        "int32_t",
        "Minimise the conflicts of labellings at their thresholds.",
        (("const JldProblem*", "problem"), ("const JldTry*", "settings"), ("const JldMinimization*", "request")),
    ),
    "jld_solve_blocks": (
        "int32_t",
        "Solve the relaxation by blocks for many choices of allowed blocks.",
        (("const JldBlocks*", "problem"), ("const JldBlockTask*", "task")),
    ),
    "jld_factor_fronts": (
        "int32_t",
        "Factor a matrix whose entries stand in the pivot columns; definite is 0 if it is not positive definite.",
        (("const JldFronts*", "fronts"), ("double*", "factor"), ("uint8_t*", "definite")),
    ),
    "jld_solve_fronts": (
        "int32_t",
        "Solve for right-hand sides x (columns, unknowns), which the solutions replace.",
        (("const JldFronts*", "fronts"), ("double*", "factor"), ("int32_t", "columns"), ("double*", "x")),
    ),
    "jld_solve_cones": (
        "int32_t",
        "Solve cone programs of one sparsity.",
        (("const JldCones*", "problem"), ("const JldConeTask*", "task")),
    ),
    "jld_find_blocks": (
        "int32_t",
        "Name the block of each element by its smallest element: names (count, elements). joins (number_of_joins, 2): "
        "elements of one block under all labels (count, faces); first, second (faces): elements of each face.",
        (
            ("int32_t", "elements"),
            ("int32_t", "number_of_joins"),
            ("const int32_t*", "joins"),
            ("int32_t", "faces"),
            ("const int32_t*", "first"),
            ("const int32_t*", "second"),
            ("int64_t", "count"),
            ("const uint8_t*", "labels"),
            ("int64_t*", "names"),
        ),
    ),
    "jld_join_parts": (
        "int32_t",
        "Join atoms into parts of `least` to `most` cells, in an order of their pairs: names (count, atoms); complete "
        "(count) is 1 where no part is too small. order (count, pairs), of which the first wanted (count) are joined.",
        (
            ("int32_t", "atoms"),
            ("int32_t", "pairs"),
            ("const int32_t*", "first"),
            ("const int32_t*", "second"),
            ("const int64_t*", "cells"),
            ("int64_t", "least"),
            ("int64_t", "most"),
            ("int32_t", "rounds"),
            ("int64_t", "count"),
            ("const int64_t*", "order"),
            ("const int64_t*", "wanted"),
            ("int32_t*", "names"),
            ("uint8_t*", "complete"),
        ),
    ),
}
"""Functions of C: type of the result (int32_t: a JldOutcome, but for jld_width), meaning, and parameters."""

# ctypes type of each scalar type of C
_SCALARS: Final[dict[str, Any]] = {
    "int32_t": ctypes.c_int32,
    "int64_t": ctypes.c_int64,
    "uint64_t": ctypes.c_uint64,
    "uint8_t": ctypes.c_uint8,
    "double": ctypes.c_double,
}


class JldFactorPattern(ctypes.Structure):
    """Pattern of a sparse Cholesky factor, see `STRUCTURES`."""


class JldProblem(ctypes.Structure):
    """One assembly, see `STRUCTURES`."""


class JldTry(ctypes.Structure):
    """Interior-point settings of one pass over the labellings; for the fields see `STRUCTURES`."""


class JldMinimization(ctypes.Structure):
    """Conflict minimisation, see `STRUCTURES`."""


class JldAnswers(ctypes.Structure):
    """Output arrays of the bounds, see `STRUCTURES`."""


class JldBlocks(ctypes.Structure):
    """Relaxation by blocks, see `STRUCTURES`."""


class JldBlockTask(ctypes.Structure):
    """Choices of allowed blocks, see `STRUCTURES`."""


class JldFronts(ctypes.Structure):
    """Fronts of a sparse Cholesky factorisation, see `STRUCTURES`."""


class JldCones(ctypes.Structure):
    """Cone programs of one sparsity, see `STRUCTURES`."""


class JldConeTask(ctypes.Structure):
    """Cone programs to solve and their results, see `STRUCTURES`."""


_CLASSES: Final[dict[str, type[ctypes.Structure]]] = {
    one.__name__: one
    for one in (
        *(JldFactorPattern, JldProblem, JldTry, JldMinimization, JldAnswers),
        *(JldBlocks, JldBlockTask, JldFronts, JldCones, JldConeTask),
    )
}


def ctypes_type(declared: str) -> Any:
    """Return the ctypes type of a type of C, such as ``const double*``."""
    if declared == "const char*":
        return ctypes.c_char_p
    name = declared.removeprefix("const ").removesuffix("*")
    own = _SCALARS.get(name) or _CLASSES[name]
    return ctypes.POINTER(own) if declared.endswith("*") else own


for _name, (_, _fields) in STRUCTURES.items():
    _CLASSES[_name]._fields_ = [(_field, ctypes_type(_type)) for _field, _type, _ in _fields]


def codes(enumeration: str) -> dict[str, int]:
    """Return the values of an enumeration by name, without the prefix JLD_."""
    return dict(CODES[enumeration][2])


def header() -> str:
    """Return the text of the C header `interface.h`, which states the interface."""
    lines = ["// Written by src/jld_core/batch/interface.py, which states the interface; do not edit.", "#pragma once"]
    lines += ["#include <cstddef>", "#include <cstdint>", "", 'extern "C" {', ""]
    for name, (kind, meaning, values) in CODES.items():
        entries = ", ".join(f"JLD_{key} = {value}" for key, value in values.items())
        lines += [*_comment(meaning), f"enum {name} : {kind} {{ {entries} }};", ""]
    lines += [f"enum : int32_t {{ JLD_BLOCK_ROWS = {BLOCK_ROWS} }};", ""]
    for name, (meaning, fields) in STRUCTURES.items():
        lines += [*_comment(meaning), f"struct {name} {{"]
        for field, kind, words in fields:
            lines += [*_comment(words, "    "), f"    {kind} {field};"]
        lines += ["};", f'static_assert(sizeof({name}) == {ctypes.sizeof(_CLASSES[name])}, "{name}");']
        for field, _, _ in fields:
            offset = getattr(_CLASSES[name], field).offset
            lines.append(f'static_assert(offsetof({name}, {field}) == {offset}, "{name}.{field}");')
        lines.append("")
    for name, (result, meaning, parameters) in FUNCTIONS.items():
        listed = ", ".join(f"{kind} {parameter}" for kind, parameter in parameters)
        prototype = textwrap.wrap(f"{result} {name}({listed});", 116, subsequent_indent="    ")
        lines += [*_comment(meaning), *prototype, ""]
    return "\n".join([*lines, "}", ""])


def _comment(words: str, indent: str = "") -> list[str]:
    """Return words as lines of a C++ comment, each of at most 120 characters."""
    return textwrap.wrap(words, 120, initial_indent=f"{indent}// ", subsequent_indent=f"{indent}// ")
