"""Figures, tables and notebook representations of assemblies and results.

- `facts_of_assembly`: describe an assembly by named facts
- `facts_of_result`: describe a result by named facts
- `figure_of_move`: return a figure of a structure before and after a move of its joints
- `figures`: figures of an assembly, its forces and its mechanism, on any matplotlib axes
- `look`: colours, line styles and marks, shared by matplotlib figures and web pages
- `moved_joints`: drawings of moved joints, and λ along the paths of moving loads
- `notebook`: notebook representations of assemblies and results: a table of facts and a drawing
- `png_of`: return a figure as the content of a PNG file of at most `_PNG` bytes, in few colours
- `quantities`: quantities shown in figures: block colours, centres of pressure, utilisation, movements
- `structure`: drawing of elements and interfaces: planar outlines, or an axonometric view
- `writing`: text in figures: ids of elements, values of loads and of forces
"""

from typing import TYPE_CHECKING

from jld_core.lazy_exports import export_lazily
from jld_core.views.notebook import facts_of_assembly, facts_of_result

if TYPE_CHECKING:
    from jld_core.views import figures, look, moved_joints, notebook, quantities, structure, writing
    from jld_core.views.moved_joints import figure_of_move
    from jld_core.views.small_pictures import png_of

__all__ = [
    "facts_of_assembly",
    "facts_of_result",
    "figure_of_move",
    "figures",
    "look",
    "moved_joints",
    "notebook",
    "png_of",
    "quantities",
    "structure",
    "writing",
]

export_lazily(
    __name__,
    {
        "moved_joints": ["figure_of_move"],
        "small_pictures": ["png_of"],
    },
    submodules=["figures", "look", "moved_joints", "notebook", "quantities", "structure", "writing"],
)
