"""Define which labellings may be searched, the limits they must satisfy, and their counts.

- `LETTERS`: the letters d (dry) and i (inner) of a labelling as text
- `Count`: definition of a count of labellings
- `Layouts`: labellings of an assembly with cached properties
- `Terms`: count as a sum of binary terms
- `count_named`: return a count by its name
- `cut`: return the structure without the cells that a labelling leaves out, and its labels
- `feasible`: return (k,) whether labellings (k, m) are in the search space
- `from_string`: convert text to a labelling
- `keys`: hashable keys of labellings
- `labelling`: labellings as text, bits and letters
- `reasons_against`: return one sentence for each condition of the space that a labelling (m,) violates
- `register`: add a count
- `registered`: return all counts
- `to_string`: convert a labelling to text
- `unpack`: unpack bits to labellings
- `unregister`: remove a count
- `values_of`: compute the values of one count
"""

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
    __name__,
    {
        "labelling": ["cut"],
        "search_space": ["feasible", "reasons_against"],
    },
    submodules=["labelling"],
)
