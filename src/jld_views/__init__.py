"""Drawings of structures, results and searches, notebook output, and interactive pages (`jld plot`).

- `annotations`: loads, arrows, axes and legends of figures, and their styles
- `field_figures`: figures of fields of stress and velocity
- `figure_of_move`: return a figure of a structure before and after a move of its joints
- `figures`: figures of an assembly, its forces and its mechanism, on any matplotlib axes
- `look`: colours, line styles and marks, shared by matplotlib figures and web pages
- `moved_joints`: drawings of moved joints, and λ along the paths of moving loads
- `notebook`: notebook representations of assemblies and results: a table of facts and a drawing
- `page_contract`: define the data format of a page
- `page_data`: assemble the data of a page as JSON, docs/guide/page.md: structure, loads and solutions, rounded
- `page_of_study`: make pages of finished searches and single scenes, and choose the layouts they contain
- `pictures`: figures of the tables of a search: front, distribution, convergence
- `png_of`: return a figure as the content of a PNG file of at most `_PNG` bytes, in few colours
- `quantities`: quantities shown in figures: block colours, centres of pressure, utilisation, movements
- `show_page`: make the page of a finished search for a notebook
- `structure`: drawing of elements and interfaces: planar outlines, or an axonometric view
- `write_pictures`: draw the pictures of a search
- `write_report`: write the page of a search
- `writing`: text in figures: ids of elements, values of loads and of forces
"""

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_views import (
        annotations,
        field_figures,
        figures,
        look,
        moved_joints,
        notebook,
        page_contract,
        page_data,
        page_of_study,
        pictures,
        quantities,
        structure,
        writing,
    )
    from jld_views.moved_joints import figure_of_move
    from jld_views.page_of_study import show_page, write_report
    from jld_views.search_pictures import write_pictures
    from jld_views.small_pictures import png_of

__all__ = [
    "annotations",
    "field_figures",
    "figure_of_move",
    "figures",
    "look",
    "moved_joints",
    "notebook",
    "page_contract",
    "page_data",
    "page_of_study",
    "pictures",
    "png_of",
    "quantities",
    "show_page",
    "structure",
    "write_pictures",
    "write_report",
    "writing",
]

export_lazily(
    __name__,
    {
        "moved_joints": ["figure_of_move"],
        "page_of_study": ["show_page", "write_report"],
        "search_pictures": ["write_pictures"],
        "small_pictures": ["png_of"],
    },
    submodules=[
        "annotations",
        "field_figures",
        "figures",
        "look",
        "moved_joints",
        "notebook",
        "page_contract",
        "page_data",
        "page_of_study",
        "pictures",
        "quantities",
        "structure",
        "writing",
    ],
)
