"""The compiled library in use, and the settings of the batch solver."""

from __future__ import annotations

import ctypes
import os
import subprocess
import warnings
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jld_core.batch import build
from jld_core.batch.interface import (
    FUNCTIONS,
    JldAnswers,
    JldBlocks,
    JldBlockTask,
    JldCones,
    JldConeTask,
    JldFactorPattern,
    JldFronts,
    JldMinimization,
    JldProblem,
    JldTry,
    codes,
    ctypes_type,
)
from jld_core.errors import InputError

VARIANTS: Final = ("avx512", "avx2", "neon", "base")
"""Variants, fastest first; a build has those of its processor family."""

SWITCH: Final = "JLD_KERNEL"
"""Environment variable that names a variant, the path of a library of these sources, "built", or "off"."""

_BUILT: Final = "built"  # value of `SWITCH` for the fastest variant that is built; no compiler is run on first use
_OUTCOMES: Final = codes("JldOutcome")  # outcomes of a call by name
_LIBRARIES: Final = (".so", ".pyd", ".dll", ".dylib")  # file extensions of shared libraries
FactorPattern = JldFactorPattern
Problem = JldProblem
Try = JldTry
MinimizationOptions = JldMinimization
Answers = JldAnswers
Blocks = JldBlocks
BlockTask = JldBlockTask
Fronts = JldFronts
Cones = JldCones
ConeTask = JldConeTask

# Pointer type of each element type of numpy, by `dtype.str`: `dtype.name` took a third of the time of `pointers`
_POINTERS: Final[dict[str, Any]] = {
    np.dtype(element).str: ctypes.POINTER(element)
    for element in (ctypes.c_double, ctypes.c_int32, ctypes.c_int64, ctypes.c_uint8)
}


def pointers(**arrays: NDArray[Any] | None) -> dict[str, Any]:
    """Return ctypes pointers to arrays by name; leave out arrays that are None."""
    stated = {name: array for name, array in arrays.items() if array is not None}
    return {name: array.ctypes.data_as(_POINTERS[array.dtype.str]) for name, array in stated.items()}


def built() -> dict[str, Path]:
    """Return the compiled libraries by variant, fastest first: the package's if current, else the cache's."""
    in_package = _libraries_in(Path(__file__).parent)
    return {name: path for name, path in in_package.items() if build.is_current(path)} or _libraries_in(build.cache())


def _libraries_in(folder: Path) -> dict[str, Path]:
    """Return the first shared library of each variant in a folder, by variant."""
    candidates = {name: sorted(folder.glob(f"_{name}.*")) for name in VARIANTS}
    usable = {name: [path for path in paths if path.suffix in _LIBRARIES] for name, paths in candidates.items()}
    return {name: paths[0] for name, paths in usable.items() if paths}


def _compile_fastest() -> dict[str, Path]:
    """Compile the fastest variant of this processor on first use, if nothing is built."""
    # Try the compilers of `build.compilers` in order. If there is none or all of them fail, warn once for the process
    # and return an empty dictionary.
    best, reason = build.best(), "no C++ compiler was found"
    for compiler in build.compilers():
        try:
            return {best: build.compile_variant(best, build.cache(), compiler, patience=build.PATIENCE)}
        except (OSError, subprocess.SubprocessError) as problem:
            reason = f"{' '.join(compiler)} failed ({build.reason_of(problem)})"
    warnings.warn(
        f"no compiled batch solver is installed, and {reason}: searches take some 30 times as long; "
        "pip install 'jld[compiler]' brings a compiler",
        stacklevel=2,
    )
    return {}


@cache
def _find_library(name: str) -> tuple[str, Path] | None:
    """Return name and path of the library that `name` names; InputError if it does not run or match here."""
    if name == "off":
        return None
    if os.sep in name:
        path = Path(name)
        if not (path.is_file() and build.is_current(path)):
            # Loading a library runs its code, so it must carry the hash of these sources.
            raise InputError(SWITCH, f"{name} was not built from these sources", "python -m jld_core.batch.build")
        return name, path
    libraries = built() or ({} if name == _BUILT else _compile_fastest())
    usable = {variant: path for variant, path in libraries.items() if build.runs_here(variant)}
    if name not in ("", _BUILT, *usable):
        raise InputError(SWITCH, f"no kernel {name!r} is built that runs here", " or ".join([*usable, _BUILT, "off"]))
    return next(((variant, path) for variant, path in usable.items() if name in ("", _BUILT, variant)), None)


def chosen() -> str | None:
    """Return the name of the batch solver's variant in use, or None if there is none.

    By default it is the fastest that is built and runs here; if nothing is built yet, that one is compiled first.

    Returns
    -------
    str or None
        Name, or the path that `JLD_KERNEL` gives.

    Raises
    ------
    InputError
        The environment variable `JLD_KERNEL` ("off" for none) names a variant that is not built or does not run here.
    """
    choice = _find_library(os.environ.get(SWITCH, ""))
    return None if choice is None else choice[0]


@cache
def library(variant: str) -> ctypes.CDLL:
    """Load a batch solver by the name of its variant or the path of a library."""
    choice = _find_library(variant)
    if choice is None:
        raise InputError(SWITCH, f"no kernel {variant!r} is built", "a variant that is built, or a library")
    loaded = ctypes.CDLL(str(choice[1]))
    for name, (result, _, parameters) in FUNCTIONS.items():
        function = getattr(loaded, name)
        function.restype = ctypes_type(result)
        function.argtypes = tuple(ctypes_type(kind) for kind, _ in parameters)
    return loaded


def require_success(outcome: int) -> None:
    """Raise MemoryError, ValueError (not supported) or RuntimeError (a defect) for a failed return code."""
    if outcome == _OUTCOMES["NO_MEMORY"]:
        raise MemoryError("the batch solver has no memory for its workspace")
    if outcome == _OUTCOMES["UNSUPPORTED"]:
        raise ValueError("the batch solver does not take a problem of this shape")
    if outcome != _OUTCOMES["DONE"]:
        raise RuntimeError(f"the batch solver failed (outcome {outcome}); set {SWITCH}=off to solve without it")


def described() -> str:
    """Describe the batch solver in use, labellings solved together and variants, for `jld --version`."""
    name = chosen()
    if name is None:
        return "no kernel"
    compiled = library(name)
    variants = f"; built: {', '.join(built())}" if built() else ""
    return f"kernel {compiled.jld_variant().decode()}, {compiled.jld_width()} labellings at a time{variants}"


# Of 512 layouts of 278 faces, 128 of 946, 64 of 2 016, `LARGE_TRIES` proves 493, 124 and 53 in its first pass and all
# but 0, 1 and 0 at last, with 15.6, 21.7 and 31 iterations for one; `TRIES` took 17.1 at 278 faces.
LARGE: Final = 200  # faces of a planar assembly from which on `LARGE_TRIES` apply. Source: benchmarks/batch_solver.py.
# Faces of a planar assembly from which on bounds use half the lanes of AVX-512. Workspaces of eight labellings no
# longer fit into the cache: half take 1.2, 1.0 and 0.7 to 0.9 times as long at 278, 946 and 1 225 faces and more.
NARROW: Final = 1000
# Range of the share of dry faces of the random labellings whose mean solution gives the starting point.
DRY_SHARES: Final = (0.0, 1.0)
# Iterations of the first pass: 20.2 instead of 23.6 at 946 faces, 27.1 instead of 30.3 at 2 016 (layouts in blocks of
# four); 26.0 instead of 26.8 and 28.7 instead of 30.0 (random labels of any share); 30.9 instead of 29.7 and 34.2
# instead of 33.5 (less than a third dry). That range for planar assemblies of `LARGE` faces and more. Below a half,
# random labels join elements to few blocks, and λ is far above that of layouts. Source: benchmarks/batch_solver.py.
LARGE_DRY_SHARES: Final = (0.5, 1.0)
SAMPLES: Final = 32  # random labellings whose mean solution gives the starting point
# With 32, 16, 8 and none a layout takes 31.2, 30.5, 29.3 and 31.8 iterations at 2 016 faces, 21.8, 22.4, 22.5 and 22.3
# at 946, and 15.8, 16.2, 16.2 and 17.7 at 278.
# The same for planar assemblies of `NARROW` faces and more, and spatial ones of `LARGE` faces and more.
# There each takes as long as a layout, and saves few iterations of one. Source: benchmarks/batch_solver.py.
FEW_SAMPLES: Final = 8

# Defaults of `library.Try`; `JldTry` in interface.py defines each field
_DEFAULTS: Final[dict[str, Any]] = {
    "proximal": 1e-5,
    "margin": 1e-10,
    "target": 1e-8,
    "active": 1e-4,
    "first": 0.95,
    "last": 0.99,
    "near": 0.1,
    "relax": 1e-3,
    "jumps": 1e-8,
    "aim": 1.0,
    "press": 0.0,
    "endless": 1e300,
}
# Settings of the passes over open labellings, planar.
# 2 and 3 look for a ray of unbounded load and for a state on the boundary. Source: benchmarks/batch_solver.py.
TRIES: Final = (
    Try(**_DEFAULTS | {"endless": 1e4}, most=28),
    Try(**_DEFAULTS | {"aim": -1.0, "press": 1e-2}, most=28),
    Try(**_DEFAULTS | {"aim": 0.0, "target": 1e-6, "margin": 0.0}, most=28),
    Try(**_DEFAULTS | {"proximal": 1e-6, "margin": 1e-11, "active": 1e-5, "first": 0.9, "jumps": 1e-9}, most=40),
    Try(**_DEFAULTS | {"proximal": 1e-4, "margin": 1e-9, "active": 1e-3, "first": 0.9, "near": 1e-4}, most=60),
)
# Settings of a pass that begins where the last one has ended, with equilibrium restored to the last digit
_RESUMED: Final = _DEFAULTS | {"resumes": 1, "apart": 1, "most": 16}
# Settings of the passes over large planar assemblies.
# Each begins where the last one ended. A small proximal term follows forces that drift long, and rounding of many
# elements needs a larger margin; upper bounds need exact jumps, hence small terms in later passes. Pass 5 begins anew
# with shorter steps and a larger margin. Source: benchmarks/batch_solver.py.
LARGE_TRIES: Final = (
    Try(**_DEFAULTS | {"endless": 1e4, "proximal": 1e-8, "margin": 1e-9, "most": 40}),
    TRIES[1],
    Try(**_RESUMED | {"proximal": 1e-11}),
    Try(**_RESUMED | {"proximal": 1e-10}),
    Try(**_RESUMED | {"proximal": 1e-11, "margin": 3e-11}),
    Try(**_DEFAULTS | {"proximal": 1e-7, "margin": 1e-8, "first": 0.9, "last": 0.95, "apart": 1, "most": 60}),
    Try(**_RESUMED | {"proximal": 1e-10}),
    Try(**_RESUMED | {"proximal": 1e-11}),
    TRIES[2],
)

# Settings of the passes over open labellings, spatial.
# None looks for states on the boundary of a cone. Source: benchmarks/batch_solver.py.
SPATIAL_TRIES: Final = tuple(
    Try(**_DEFAULTS | {"target": 3e-8, "jumps": 1e-7, "near": 1e-2} | more)
    for more in (
        {"endless": 1e4, "most": 28},
        {"aim": -1.0, "press": 1e-2, "most": 28},
        {"proximal": 1e-6, "margin": 1e-13, "target": 3e-9, "jumps": 1e-9, "most": 60},
        {"proximal": 1e-8, "margin": 1e-13, "target": 3e-9, "jumps": 1e-9, "most": 60},
        {"proximal": 1e-10, "target": 3e-9, "jumps": 1e-9, "most": 60},
        {"proximal": 1e-6, "margin": 1e-11, "first": 0.9, "most": 40},
        {"proximal": 1e-4, "most": 60},
    )
)
# Where inner faces are strong beside the weights and few joints are dry, larger margins end a digit short, and proximal
# terms hold λ back where it is 10⁴ times the weights: of 216 layouts in few blocks of 144 faces all but 1 are proven
# with the third to fifth pass, all but 6 without the fifth, all but some 100 without all three.


def narrow(dimension: int, faces: int) -> bool:
    """Return True if bounds use half the lanes of AVX-512."""
    return dimension == 2 and faces >= NARROW


def samples(dimension: int, faces: int) -> int:
    """Return the number of random labellings that give the starting point.

    dimension: 2 or 3. faces: number of interfaces.
    """
    return FEW_SAMPLES if faces >= (NARROW if dimension == 2 else LARGE) else SAMPLES


def dry_shares(dimension: int, faces: int) -> tuple[float, float]:
    """Return the range of the share of dry faces of the labellings that give the starting point."""
    return LARGE_DRY_SHARES if dimension == 2 and faces >= LARGE else DRY_SHARES


def tries_of(dimension: int, faces: int, parabolas: bool) -> tuple[Try, ...]:
    """Return the settings of passes over open labellings; parabolas exclude those for rays and boundary states."""
    if dimension == 3:
        settings = SPATIAL_TRIES
    else:
        settings = LARGE_TRIES if faces >= LARGE else TRIES
    return tuple(pass_settings for pass_settings in settings if pass_settings.aim > 0.0) if parabolas else settings
