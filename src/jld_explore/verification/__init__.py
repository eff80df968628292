"""Check proofs of the exact driver by code that is independent of the search."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_explore.verification.verify import Checker, verify

if TYPE_CHECKING:
    from jld_explore.verification import certificate

__all__ = ["Checker", "certificate", "verify"]

export_lazily(__name__, {}, submodules=["certificate"])
