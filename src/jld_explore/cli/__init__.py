"""Provide the command line `jld`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_explore.cli import check, ending, layout, options, streams

__all__ = ["check", "ending", "layout", "options", "streams"]

export_lazily(__name__, {}, submodules=["check", "ending", "layout", "options", "streams"])
