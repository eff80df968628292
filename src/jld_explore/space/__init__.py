"""Define which labellings may be searched, the limits they must satisfy, and their counts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_explore.space.counts import Count, Layouts, Terms, count_named, register, registered, unregister, values_of
from jld_explore.space.labelling import LETTERS, from_string, keys, to_string, unpack

if TYPE_CHECKING:
    from jld_explore.space import labelling
    from jld_explore.space.labelling import cut
    from jld_explore.space.search_space import feasible, reasons_against

__all__ = [
    "LETTERS",
    "Count",
    "Layouts",
    "Terms",
    "count_named",
    "cut",
    "feasible",
    "from_string",
    "keys",
    "labelling",
    "reasons_against",
    "register",
    "registered",
    "to_string",
    "unpack",
    "unregister",
    "values_of",
]

export_lazily(
    __name__, {"labelling": ["cut"], "search_space": ["feasible", "reasons_against"]}, submodules=["labelling"]
)
