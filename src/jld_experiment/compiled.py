"""The one door to numba: functions compiled on first use and kept on disk for the next process."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar, cast

from jld_core.errors import InputError

try:
    import numba
except ImportError as error:  # the extra is what is missing, and the reader should be told its name
    raise InputError("jld_experiment", "numba is not installed", "pip install 'jld[experiment]'") from error

F = TypeVar("F", bound=Callable[..., object])

_SOURCES: Final = tuple(
    (path.name, path.stat().st_mtime, path.stat().st_size) for path in sorted(Path(__file__).parent.glob("*.py"))
)


def compiled(function: F) -> F:
    """Compile a function of arrays and numbers to machine code, without changing what its arithmetic means.

    No fast-math: two runs of one experiment are equal bit by bit. What is kept on disk is good for the sources of the
    whole package as they are: numba by itself looks at the file of a function only, and would go on calling what
    another file held before.
    """
    made: Any = numba.njit(cache=True, error_model="numpy")(function)
    made._cache._cache_file._source_stamp = _SOURCES
    return cast(F, made)
