"""The one door to numba: functions compiled on first use and kept on disk for the next process."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

from jld_core.errors import InputError

try:
    import numba
except ImportError as error:  # the extra is what is missing, and the reader should be told its name
    raise InputError("jld_experiment", "numba is not installed", "pip install 'jld[experiment]'") from error

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a function of arrays and numbers to machine code, without changing what its arithmetic means.

    No fast-math: two runs of one experiment are equal bit by bit.
    """
    return cast(F, numba.njit(cache=True, error_model="numpy")(function))
