"""The compiled batch solver: which variants there are, which one this processor runs, and its plain C interface."""

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
"""From the fastest down; a build has those that its processor family knows."""

SWITCH: Final = "JLD_KERNEL"
"""Environment variable that names a variant, or "off"."""

_NEEDED: Final[dict[str, tuple[str, ...]]] = {
    "avx512": ("avx512f", "avx512dq", "avx512vl"),
    "avx2": ("avx2", "fma"),
    "neon": (),
    "base": (),
}

_LIBRARIES: Final = (".so", ".pyd", ".dll", ".dylib")

_int32 = ctypes.c_int32
_double = ctypes.c_double
_int32s = ctypes.POINTER(ctypes.c_int32)
_doubles = ctypes.POINTER(ctypes.c_double)
_bytes = ctypes.POINTER(ctypes.c_uint8)


class FactorPattern(ctypes.Structure):
    """`FactorPattern` of source/cholesky.h."""

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
    """`JldProblem` of source/problem.h."""

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
    """`JldTry`: settings of one pass over the labellings that are still open."""

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
    """`JldShrinking`: labellings to be shrunk to what makes them too weak, and where that goes."""

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
    """`JldAnswers`: where results go."""

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
    """`JldBlocks` of source/blocks.h."""

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
    """`JldBlockTask`: choices of blocks, how far they are solved, and where results go."""

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


def pointers(**arrays: NDArray[Any] | None) -> dict[str, Any]:
    """Arrays by the names of a structure's fields as it takes them, those that are None left out: they are null."""
    known = {name: array for name, array in arrays.items() if array is not None}
    return {name: array.ctypes.data_as(_POINTERS[array.dtype.name]) for name, array in known.items()}


def built() -> dict[str, Path]:
    """Libraries by variant, fastest first: those of the package, if made of its sources, else those in the cache."""
    own = _within(Path(__file__).parent)
    return {name: path for name, path in own.items() if build.is_current(path)} or _within(build.cache())


def _within(folder: Path) -> dict[str, Path]:
    found = {name: sorted(folder.glob(f"_{name}.*")) for name in VARIANTS}
    usable = {name: [path for path in paths if path.suffix in _LIBRARIES] for name, paths in found.items()}
    return {name: paths[0] for name, paths in usable.items() if paths}


def _compiled() -> dict[str, Path]:
    """What a compiler makes on first use, where nothing is built: the system's, or that of the extra `compiler`."""
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
    """Does this processor have the instructions of a variant?"""
    return set(_NEEDED[variant]) <= _flags()


@cache
def _flags() -> frozenset[str]:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        # elsewhere the variant without special instructions runs
        return frozenset()
    for line in text.splitlines():
        if line.startswith("flags"):
            return frozenset(line.partition(":")[2].split())
    return frozenset()


@cache
def _found(wish: str) -> tuple[str, Path] | None:
    if wish == "off":
        return None
    if os.sep in wish:
        return wish, Path(wish)
    usable = {name: path for name, path in (built() or _compiled()).items() if runs_here(name)}
    if wish and wish not in usable:
        raise InputError(SWITCH, f"no kernel {wish!r} is built that runs here", " or ".join([*usable, "off"]))
    return next(((name, path) for name, path in usable.items() if wish in ("", name)), None)


def chosen() -> str | None:
    """The batch solver in use: the fastest variant that is built and runs here, or what `JLD_KERNEL` names; None for
    none.

    Raises InputError where the variable names a variant that is not built or does not run here.
    """
    found = _found(os.environ.get(SWITCH, ""))
    return None if found is None else found[0]


@cache
def library(variant: str) -> ctypes.CDLL:
    """A batch solver, loaded, by the name of its variant or the path of a library. Raises InputError if it is not
    there."""
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
    """The batch solver in use, in words for `jld --version`."""
    name = chosen()
    if name is None:
        return "no kernel"
    found = library(name)
    return f"kernel {found.jld_lanes_variant().decode()}, {found.jld_lanes_width()} labellings at a time"
