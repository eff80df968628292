"""Provide the command line `jld`.

- `check`: provide `jld check` and `jld verify`, and checks of a scene that other commands share
- `ending`: end commands on errors and signals with one line on stderr and an exit code
- `layout`: find the layout that a command refers to: a scene's own, or a rank of a results folder
- `options`: define arguments and options shared by the commands
- `streams`: write safely to closed, full or unread streams and limited encodings, by the standard library alone
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily

if TYPE_CHECKING:
    from jld_explore.cli import check, ending, layout, options, streams

__all__ = [
    "check",
    "ending",
    "layout",
    "options",
    "streams",
]

export_lazily(__name__, {}, submodules=["check", "ending", "layout", "options", "streams"])
