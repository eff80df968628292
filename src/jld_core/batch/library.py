"""C interface of the compiled batch solver: its variants, and the one that this processor runs."""

from __future__ import annotations

import ctypes
import os
import subprocess
import warnings
from functools import cache
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from jld_core.batch import build
from jld_core.errors import InputError

VARIANTS: Final = ("avx512", "avx2", "neon", "base")
"""Variants, fastest first; a build has those of its processor family."""

SWITCH: Final = "JLD_KERNEL"
"""Environment variable that names a variant or the path of a library, or "off"."""

_NEEDED: Final[dict[str, tuple[str, ...]]] = {
    "avx512": ("avx512f", "avx512dq", "avx512vl"),
    "avx2": ("avx2", "fma"),
    "neon": (),
    "base": (),
}
"""Processor flags that each variant needs, as /proc/cpuinfo names them."""

_LIBRARIES: Final = (".so", ".pyd", ".dll", ".dylib")
"""File extensions of shared libraries."""

_int32 = ctypes.c_int32
_double = ctypes.c_double
_int32s = ctypes.POINTER(ctypes.c_int32)
_doubles = ctypes.POINTER(ctypes.c_double)
_bytes = ctypes.POINTER(ctypes.c_uint8)


class FactorPattern(ctypes.Structure):
    """ctypes mirror of `FactorPattern` in source/cholesky.h."""

    _fields_ = (
        ("nodes", _int32),
        ("column_start", _int32s),
        ("row", _int32s),
        ("pair_start", _int32s),
        ("pair", _int32s),
        ("left_start", _int32s),
        ("left", _int32s),
        ("left_column", _int32s),
    )


class Problem(ctypes.Structure):
    """ctypes mirror of `JldProblem` in source/problem.h."""

    _fields_ = (
        ("elements", _int32),
        ("faces", _int32),
        ("pairs", _int32),
        ("labels", _int32),
        ("freedoms", _int32),
        ("dropping", _int32),
        ("pattern", FactorPattern),
        ("low", _int32s),
        ("high", _int32s),
        ("block", _int32s),
        ("sides", _doubles),
        ("rows", _doubles),
        ("keep", _doubles),
        ("dead", _doubles),
        ("live", _doubles),
        ("floor", _double),
        ("opening", _doubles),
        ("noise", _double),
        ("forces", _doubles),
        ("jumps", _doubles),
        ("speed", _doubles),
        ("load", _double),
        ("room", _double),
        ("push", _double),
        ("zero", _double),
        ("gap", _double),
        ("bows", _doubles),
        ("meets", _int32),
    )


class Try(ctypes.Structure):
    """ctypes mirror of `JldTry` in source/problem.h: settings of one pass."""

    _fields_ = (
        ("proximal", _double),
        ("margin", _double),
        ("target", _double),
        ("active", _double),
        ("first", _double),
        ("last", _double),
        ("near", _double),
        ("relax", _double),
        ("jumps", _double),
        ("aim", _double),
        ("press", _double),
        ("endless", _double),
        ("most", _int32),
    )


class MinimizationOptions(ctypes.Structure):
    """ctypes mirror of `JldShrinking` in source/problem.h: a conflict minimisation."""

    _fields_ = (
        ("count", ctypes.c_int64),
        ("labels", _bytes),
        ("free", _bytes),
        ("thresholds", _doubles),
        ("neighbours", _int32),
        ("tries", _int32),
        ("inner", _int32),
        ("balance", _double),
        ("seed", ctypes.c_uint64),
        ("fate", _bytes),
        ("conflict", _bytes),
        ("velocity", _doubles),
        ("relaxations", _int32s),
    )


class Answers(ctypes.Structure):
    """ctypes mirror of `JldAnswers` in source/problem.h: output arrays of the bounds."""

    _fields_ = (
        ("low", _doubles),
        ("high", _doubles),
        ("verdict", _int32s),
        ("iterations", _int32s),
        ("tries", _int32s),
        ("forces", _doubles),
        ("velocity", _doubles),
        ("diagnosis", _doubles),
        ("rays", _doubles),
    )


class Blocks(ctypes.Structure):
    """ctypes mirror of `JldBlocks` in source/blocks.h."""

    _fields_ = (
        ("blocks", _int32),
        ("nodes", _int32),
        ("pattern", FactorPattern),
        ("own_start", _int32s),
        ("shared_start", _int32s),
        ("shared", _int32s),
        ("column_start", _int32s),
        ("entry_start", _int32s),
        ("entry_row", _int32s),
        ("entry", _doubles),
        ("of_x", _doubles),
        ("of_load", _doubles),
        ("place_start", _int32s),
        ("place", _int32s),
        ("rhs", _doubles),
        ("loads", _int32),
        ("load", _int32s),
    )


class BlockTask(ctypes.Structure):
    """ctypes mirror of `JldBlockTask` in source/blocks.h: choices of allowed blocks."""

    _fields_ = (
        ("count", ctypes.c_int64),
        ("allowed", _bytes),
        ("thresholds", _doubles),
        ("least", _doubles),
        ("most", _doubles),
        ("gap", _double),
        ("near", _double),
        ("fine", _double),
        ("room", _double),
        ("iterations", _int32),
        ("dual", _doubles),
        ("share", _doubles),
        ("load", _doubles),
        ("spent", _int32s),
        ("state", _bytes),
    )


_POINTERS: Final[dict[str, Any]] = {"float64": _doubles, "int32": _int32s, "uint8": _bytes}
"""Pointer type of each element type of numpy."""


def pointers(**arrays: NDArray[Any] | None) -> dict[str, Any]:
    """Return ctypes pointers to arrays by field name; leave out arrays that are None."""
    known = {name: array for name, array in arrays.items() if array is not None}
    return {name: array.ctypes.data_as(_POINTERS[array.dtype.name]) for name, array in known.items()}


def built() -> dict[str, Path]:
    """Return the compiled libraries by variant, fastest first.

    Libraries of the package come first if they match the sources; otherwise those of the cache are returned.
    """
    own = _within(Path(__file__).parent)
    return {name: path for name, path in own.items() if build.is_current(path)} or _within(build.cache())


def _within(folder: Path) -> dict[str, Path]:
    """Return the first shared library of each variant in a folder."""
    found = {name: sorted(folder.glob(f"_{name}.*")) for name in VARIANTS}
    usable = {name: [path for path in paths if path.suffix in _LIBRARIES] for name, paths in found.items()}
    return {name: paths[0] for name, paths in usable.items() if paths}


def _compiled() -> dict[str, Path]:
    """Compile the fastest variant of this processor on first use, if nothing is built.

    Try the compilers of `build.compilers` in order. If all of them fail, warn and return an empty dictionary.
    """
    fit = [name for name in build.variants() if runs_here(name)]
    problems = []
    for compiler in build.compilers() if fit else []:
        try:
            return {fit[0]: build.compile_variant(fit[0], build.cache(), compiler)}
        except (OSError, subprocess.CalledProcessError) as problem:
            problems.append(str(problem))
    if problems:
        warnings.warn(f"the kernel could not be compiled, so it is done without: {problems[-1]}", stacklevel=2)
    return {}


def runs_here(variant: str) -> bool:
    """Return True if this processor has the instructions of a variant."""
    return set(_NEEDED[variant]) <= _flags()


@cache
def _flags() -> frozenset[str]:
    """Return the processor flags from /proc/cpuinfo; an empty set where they are unknown."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        # Without this file only variants that need no special instructions run.
        return frozenset()
    for line in text.splitlines():
        if line.startswith("flags"):
            return frozenset(line.partition(":")[2].split())
    return frozenset()


@cache
def _found(wish: str) -> tuple[str, Path] | None:
    """Return name and path of the library that `wish` names ("": fastest); None if "off"."""
    if wish == "off":
        return None
    if os.sep in wish:
        return wish, Path(wish)
    usable = {name: path for name, path in (built() or _compiled()).items() if runs_here(name)}
    if wish and wish not in usable:
        raise InputError(SWITCH, f"no kernel {wish!r} is built that runs here", " or ".join([*usable, "off"]))
    return next(((name, path) for name, path in usable.items() if wish in ("", name)), None)


def chosen() -> str | None:
    """Return the name of the batch solver's variant in use, or None if there is none.

    `JLD_KERNEL` selects it; by default it is the fastest variant that is built and runs here.

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
    if found is None or not found[1].exists():
        raise InputError(SWITCH, f"no kernel at {variant!r}", "a variant that is built, or a library")
    loaded = ctypes.CDLL(str(found[1]))
    loaded.jld_lanes_solve.restype = ctypes.c_int32
    loaded.jld_lanes_solve.argtypes = (
        ctypes.POINTER(Problem),
        ctypes.POINTER(Try),
        ctypes.c_int32,
        ctypes.c_int64,
        _bytes,
        _doubles,
        ctypes.POINTER(Answers),
    )
    loaded.jld_lanes_shrink.restype = ctypes.c_int32
    loaded.jld_lanes_shrink.argtypes = tuple(ctypes.POINTER(kind) for kind in (Problem, Try, MinimizationOptions))
    loaded.jld_lanes_blocks.restype = ctypes.c_int32
    loaded.jld_lanes_blocks.argtypes = tuple(ctypes.POINTER(kind) for kind in (Blocks, BlockTask))
    i32, i64, data = ctypes.c_int32, ctypes.c_int64, ctypes.c_void_p
    loaded.jld_blocks.restype = loaded.jld_parts.restype = i32
    loaded.jld_blocks.argtypes = (i32, i32, data, i32, data, data, i64, data, data)
    loaded.jld_parts.argtypes = (i32, i32, data, data, data, i64, i64, i32, i64, data, data, data, data)
    loaded.jld_lanes_width.restype = ctypes.c_int32
    loaded.jld_lanes_variant.restype = ctypes.c_char_p
    return loaded


def described() -> str:
    """Describe the batch solver in use in words, for `jld --version`.

    Returns
    -------
    str
        Variant and number of labellings solved together, or "no kernel".
    """
    name = chosen()
    if name is None:
        return "no kernel"
    found = library(name)
    return f"kernel {found.jld_lanes_variant().decode()}, {found.jld_lanes_width()} labellings at a time"
