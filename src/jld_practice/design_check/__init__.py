"""Design check with partial factors: utilisation, reactions, joints near their limit.

- `at_design_loads`: solve a layout under design loads
- `at_design_values`: return the scene with design values of strengths, friction, capacities and prestress
- `combinations_of`: return the combinations that differ for a structure, all actions unfavourable first
- `content_of`: return the content of the page in one language: "en", "de" or "it"
- `design_check`: check one layout with partial factors, by the scene's labels unless labels (m,) are given
- `html_of`: return the page of a design check
- `in_words`: return the lines of a design check
- `path_of`: return λ of each position of moving loads under its worst combination
- `sheet_of`: return the sheet of a design check; letters shrink where the tables would not fit on it
- `to_json`: return a design check as JSON
"""

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
