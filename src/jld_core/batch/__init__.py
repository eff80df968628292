"""Batch solver: a compiled interior-point method that bounds λ of many labellings of one assembly at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.batch.library import chosen
from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_core.batch import batch_solver, build, library

__all__ = ["batch_solver", "build", "chosen", "library"]

export_lazily(__name__, {}, submodules=["batch_solver", "build", "library"])
