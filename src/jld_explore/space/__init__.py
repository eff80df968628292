"""What may be labelled, under which limits, and what is counted.

- `CELLS`: the measure of a block that counts its elements
- `EXEMPT`: the measure of a block that counts the elements that limits except
- `LETTERS`: d and i, of a labelling as text
- `MEASURES`: measures of blocks that limits may speak of
- `SHAPED`: limits on the shape of single blocks, and what they measure
- `BlockShapes`: the shapes of all blocks that are asked for, of one assembly
- `Count`: one count of labellings
- `Layouts`: labellings (k, m) of an assembly, as counts look at them
- `Limits`: all limits of a search over an assembly
- `Range`: inclusive bounds, rounding allowed for
- `SearchSpace`: what may be labelled
- `Sized`: things with a size by every measure
- `Terms`: a count as a sum of ones, for proofs
- `Void`: what may be left out
- `Words`: rows of labels as words of 64 bits
- `as_words`: rows of labels as words that compare as they do
- `beside_nothing`: faces beside a cell that is left out, by the letters of a labelling
- `block_sizes`: sizes of all blocks
- `blocks_of`: the block of each element
- `canonical`: the smallest image under the symmetries
- `connectivity`: the element graph
- `count_named`: a count by its name
- `counts`: values of all counts
- `cut`: the structure that a labelling (m letters) leaves, and its labels
- `dry_of`: the letters of a labelling, v among them → which faces are dry
- `feasible`: which labellings are in the space
- `from_string`: text → labelling
- `is_labelling`: whether something is the letters of a labelling
- `keys`: hashable keys of labellings
- `omitted`: (n,) elements that the letters (m,) of a labelling leave out: free ones whose every face is beside nothing
- `orbit_sizes`: how many images a labelling has
- `pack`: labellings → bits
- `reasons_against`: why a labelling is not in the space
- `register`: take a count of one's own
- `registered`: all counts
- `representatives`: labellings that are canonical
- `search_space`: what a scene's "search" asks for
- `slits`: dry faces inside a block
- `to_string`: labelling → text
- `to_strings`: labellings → texts
- `unpack`: bits → labellings
- `unregister`: take it back
- `values_of`: values of one count
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
    Words,
    as_words,
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
    "Words",
    "as_words",
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
