"""C interface of the compiled batch solver: its variants, and the one that this processor runs."""

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

from jld_core.batch import build, interface
from jld_core.errors import InputError

VARIANTS: Final = ("avx512", "avx2", "neon", "base")
"""Variants, fastest first; a build has those of its processor family."""

SWITCH: Final = "JLD_KERNEL"
"""Environment variable that names a variant, the path of a library of these sources, "built", or "off"."""

_BUILT: Final = "built"  # value of `SWITCH` for the fastest variant that is built; no compiler is run on first use

_OUTCOMES: Final = interface.codes("JldOutcome")  # outcomes of a call by name

_LIBRARIES: Final = (".so", ".pyd", ".dll", ".dylib")  # file extensions of shared libraries

FactorPattern = interface.JldFactorPattern
Problem = interface.JldProblem
Try = interface.JldTry
MinimizationOptions = interface.JldMinimization
Answers = interface.JldAnswers
Blocks = interface.JldBlocks
BlockTask = interface.JldBlockTask
Fronts = interface.JldFronts
Cones, ConeTask = interface.CONES["CLASSES"]

# Pointer type of each element type of numpy, by `dtype.str`: `dtype.name` took a third of the time of `pointers`
_POINTERS: Final[dict[str, Any]] = {
    np.dtype(element).str: ctypes.POINTER(element)
    for element in (ctypes.c_double, ctypes.c_int32, ctypes.c_int64, ctypes.c_uint8)
}


def pointers(**arrays: NDArray[Any] | None) -> dict[str, Any]:
    """Return ctypes pointers to arrays by name; leave out arrays that are None.

    arrays: contiguous arrays of float64, int32, int64 or uint8. The pointers are valid while the arrays exist.
    """
    known = {name: array for name, array in arrays.items() if array is not None}
    return {name: array.ctypes.data_as(_POINTERS[array.dtype.str]) for name, array in known.items()}


def built() -> dict[str, Path]:
    """Return the paths of the compiled libraries by variant, fastest first.

    Libraries of the package come first if they match the sources; otherwise those of the cache are returned. The
    dictionary is empty if nothing is compiled.
    """
    own = _within(Path(__file__).parent)
    return {name: path for name, path in own.items() if build.is_current(path)} or _within(build.cache())


def _within(folder: Path) -> dict[str, Path]:
    """Return the first shared library of each variant in a folder, by variant."""
    found = {name: sorted(folder.glob(f"_{name}.*")) for name in VARIANTS}
    usable = {name: [path for path in paths if path.suffix in _LIBRARIES] for name, paths in found.items()}
    return {name: paths[0] for name, paths in usable.items() if paths}


def _compiled() -> dict[str, Path]:
    """Compile the fastest variant of this processor on first use, if nothing is built.

    Try the compilers of `build.compilers` in order. If there is none or all of them fail, warn once for the process
    and return an empty dictionary.
    """
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
def _found(wish: str) -> tuple[str, Path] | None:
    """Return name and path of the library that `wish` names; None where there is none.

    wish: name of a variant, path of a library, "off", "" or `_BUILT`. "" asks for the fastest variant, and compiles it
    if none is built. `_BUILT` asks for the fastest variant that is built. The result is None for "off", and where no
    library runs here. Raises InputError for a variant that is not built or does not run here, and for a library that
    was not built from these sources.
    """
    if wish == "off":
        return None
    if os.sep in wish:
        path = Path(wish)
        if not (path.is_file() and build.is_current(path)):
            # Loading a library runs its code, so it must carry the hash of these sources.
            raise InputError(SWITCH, f"{wish} was not built from these sources", "python -m jld_core.batch.build")
        return wish, path
    found = built() or ({} if wish == _BUILT else _compiled())
    usable = {name: path for name, path in found.items() if build.runs_here(name)}
    if wish not in ("", _BUILT, *usable):
        raise InputError(SWITCH, f"no kernel {wish!r} is built that runs here", " or ".join([*usable, _BUILT, "off"]))
    return next(((name, path) for name, path in usable.items() if wish in ("", _BUILT, name)), None)


def chosen() -> str | None:
    """Return the name of the batch solver's variant in use, or None if there is none.

    The environment variable `JLD_KERNEL` selects it, "off" for none. By default it is the fastest variant that is built
    and runs here. If nothing is built yet, that variant is compiled first.

    Returns
    -------
    str or None
        Name of the variant, or the path that `JLD_KERNEL` gives.

    Raises
    ------
    InputError
        `JLD_KERNEL` names a variant that is not built or does not run here.
    """
    found = _found(os.environ.get(SWITCH, ""))
    return None if found is None else found[0]


@cache
def library(variant: str) -> ctypes.CDLL:
    """Load a batch solver by the name of its variant or the path of a library.

    Raises InputError if there is no such library.
    """
    found = _found(variant)
    if found is None:
        raise InputError(SWITCH, f"no kernel {variant!r} is built", "a variant that is built, or a library")
    loaded = ctypes.CDLL(str(found[1]))
    for name, (result, _, parameters) in interface.FUNCTIONS.items():
        function = getattr(loaded, name)
        function.restype = interface.ctypes_type(result)
        function.argtypes = tuple(interface.ctypes_type(kind) for kind, _ in parameters)
    return loaded


def require_success(outcome: int) -> None:
    """Raise an error if the return code `outcome` of a compiled function reports a failure.

    The errors are MemoryError, ValueError (a problem that the compiled solver does not take), and RuntimeError (a
    defect of it).
    """
    if outcome == _OUTCOMES["NO_MEMORY"]:
        raise MemoryError("the batch solver has no memory for its workspace")
    if outcome == _OUTCOMES["UNSUPPORTED"]:
        raise ValueError("the batch solver does not take a problem of this shape")
    if outcome != _OUTCOMES["DONE"]:
        raise RuntimeError(f"the batch solver failed (outcome {outcome}); set {SWITCH}=off to solve without it")


def described() -> str:
    """Describe the batch solver in use in words, for `jld --version`.

    Result: variant, number of labellings solved together and the variants that are built, or "no kernel".
    """
    name = chosen()
    if name is None:
        return "no kernel"
    found = library(name)
    held = f"; built: {', '.join(built())}" if built() else ""
    return f"kernel {found.jld_variant().decode()}, {found.jld_width()} labellings at a time{held}"
