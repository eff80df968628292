"""Compile functions with numba on first use and cache them on disk."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar, cast

from jld_core.errors import InputError

try:
    import numba
except ImportError as error:  # Name the missing optional dependency.
    raise InputError("jld_experiment", "numba is not installed", "pip install 'jld[experiment]'") from error

F = TypeVar("F", bound=Callable[..., object])

# Name, time and size of all source files of the package, which identify the cached code
_SOURCES: Final = tuple(
    (path.name, path.stat().st_mtime, path.stat().st_size) for path in sorted(Path(__file__).parent.glob("*.py"))
)


def compiled(function: F) -> F:
    """Return a function of arrays and numbers that numba compiles at its first call.

    There is no fast-math, so two runs of one experiment are bitwise equal. The machine code is cached on disk.
    The cache depends on the sources of the whole package: numba alone checks only the file of the function and would
    keep outdated code of other files. Importing this module raises InputError where numba is not installed.
    """
    made: Any = numba.njit(cache=True, error_model="numpy")(function)
    made._cache._cache_file._source_stamp = _SOURCES
    return cast(F, made)
