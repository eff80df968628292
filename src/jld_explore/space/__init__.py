"""Define which labellings may be searched, the limits they must satisfy, and their counts.

- `CELLS`: block measure: number of free elements
- `EXEMPT`: block measure: number of elements that exempt the block from limits
- `LETTERS`: the letters d (dry) and i (inner) of a labelling as text
- `MEASURES`: block measures that can be limited
- `SHAPED`: limits on the shape of single blocks and the attributes they limit
- `BlockShapes`: outlines of the blocks of one assembly
- `Count`: definition of a count of labellings
- `Layouts`: labellings of an assembly with cached properties for counts
- `Limits`: all limits of a search over an assembly
- `Range`: inclusive bounds with a tolerance for rounding
- `SearchSpace`: labellings that may be searched
- `Sized`: sizes of elements or sets of elements by every measure
- `Terms`: count as a sum of binary terms, for proofs
- `Void`: cells that may be left out
- `beside_nothing`: return the faces beside a cell that is left out
- `block_sizes`: compute the sizes of all blocks
- `blocks_of`: compute the block of each element
- `canonical`: return the smallest image under the symmetries
- `connectivity`: build the element graph
- `count_named`: return a count by its name
- `counts`: compute the values of all counts
- `cut`: return the structure without the cells that a labelling leaves out, and its labels
- `dry_of`: convert letters, v among them, to a mask of dry faces
- `feasible`: return which labellings are in the space
- `from_string`: convert text to a labelling
- `is_labelling`: return whether an object is the text of a labelling
- `keys`: return hashable keys of labellings
- `omitted`: return the elements that a labelling leaves out
- `orbit_sizes`: return the number of images of a labelling under the symmetries
- `pack`: pack labellings to bits
- `reasons_against`: explain why a labelling is not in the space
- `register`: add a count
- `registered`: return all counts
- `representatives`: select the canonical labellings
- `search_space`: build the search space of a scene
- `slits`: return the dry faces inside a block
- `to_string`: convert a labelling to text
- `to_strings`: convert labellings to texts
- `unpack`: unpack bits to labellings
- `unregister`: remove a count
- `values_of`: compute the values of one count
"""

from __future__ import annotations

from jld_explore.space.counts import (
    Count,
    Layouts,
    Terms,
    count_named,
    counts,
    register,
    registered,
    unregister,
    values_of,
)
from jld_explore.space.labelling import (
    LETTERS,
    blocks_of,
    canonical,
    connectivity,
    from_string,
    keys,
    orbit_sizes,
    pack,
    representatives,
    slits,
    to_string,
    to_strings,
    unpack,
)
from jld_explore.space.limits import CELLS, EXEMPT, MEASURES, SHAPED, Limits, Range, Sized, block_sizes
from jld_explore.space.reasons import reasons_against
from jld_explore.space.search_space import SearchSpace, feasible, search_space
from jld_explore.space.shapes import BlockShapes
from jld_explore.space.void import Void, beside_nothing, cut, dry_of, is_labelling, omitted

__all__ = [
    "CELLS",
    "EXEMPT",
    "LETTERS",
    "MEASURES",
    "SHAPED",
    "BlockShapes",
    "Count",
    "Layouts",
    "Limits",
    "Range",
    "SearchSpace",
    "Sized",
    "Terms",
    "Void",
    "beside_nothing",
    "block_sizes",
    "blocks_of",
    "canonical",
    "connectivity",
    "count_named",
    "counts",
    "cut",
    "dry_of",
    "feasible",
    "from_string",
    "is_labelling",
    "keys",
    "omitted",
    "orbit_sizes",
    "pack",
    "reasons_against",
    "register",
    "registered",
    "representatives",
    "search_space",
    "slits",
    "to_string",
    "to_strings",
    "unpack",
    "unregister",
    "values_of",
]
