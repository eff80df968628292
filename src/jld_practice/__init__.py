"""Practice: outline to stones, printed report, stock, design check, reliability.

- `Printed`: content of a printed report
- `Stone`: one block as a workshop sees it; lengths and masses in the units of the scene
- `making_of`: return the stones of a layout with their moulds and stock
- `pages_of`: return the pages of a printed report: overview, stones, moulds, laying, assumptions
- `smallest_rectangle`: return the sides of the rectangle of least area around points (k, 2)
- `stones_of`: return the stones, numbered in the order of `blocks.csv`
- `stones_table`: return the cutting list: one row per stone, as numbered in the report
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_practice.printed import Printed, Stone, making_of, pages_of, smallest_rectangle, stones_of, stones_table

__all__ = ["Printed", "Stone", "making_of", "pages_of", "smallest_rectangle", "stones_of", "stones_table"]

export_lazily(
    __name__,
    {"printed": ["Printed", "Stone", "making_of", "pages_of", "smallest_rectangle", "stones_of", "stones_table"]},
)
