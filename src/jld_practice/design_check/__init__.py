"""Design check with partial factors: utilisation, reactions, joints near their limit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_practice.design_check.check import at_design_loads, at_design_values, combinations_of, design_check
    from jld_practice.design_check.page import content_of, html_of, in_words, path_of, sheet_of, to_json

__all__ = [
    "at_design_loads",
    "at_design_values",
    "combinations_of",
    "content_of",
    "design_check",
    "html_of",
    "in_words",
    "path_of",
    "sheet_of",
    "to_json",
]

export_lazily(
    __name__,
    {
        "check": ["at_design_loads", "combinations_of", "design_check", "at_design_values"],
        "page": ["html_of", "path_of", "sheet_of", "content_of", "in_words", "to_json"],
    },
)
