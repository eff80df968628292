"""Drawings of structures, results and searches, notebook output, and interactive pages (`jld plot`).

- `annotations`: loads, arrows, axes and legends of figures
- `field_figures`: figures of fields of stress and velocity
- `figure_of_move`: figure of a structure before and after a move
- `figures`: figures of an assembly, its forces and its mechanism
- `look`: colours, line styles and marks of figures and pages
- `moved_joints`: drawings of moved joints and moving loads
- `notebook`: notebook representations of assemblies and results
- `page_contract`: define the data format of a page
- `page_data`: assemble the data of a page, docs/guide/page.md
- `page_of_study`: pages of finished searches and single scenes
- `pictures`: figures of the tables of a search
- `png_of`: a figure as the content of a PNG file
- `quantities`: quantities shown in figures
- `show_page`: make the page of a finished search for a notebook
- `structure`: drawing of elements and interfaces
- `write_pictures`: draw the pictures of a search
- `write_report`: write the page of a search
- `writing`: text in figures
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
    from jld_views.figures import png_of
    from jld_views.moved_joints import figure_of_move
    from jld_views.page_of_study import show_page, write_report
    from jld_views.search_pictures import write_pictures

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
        "figures": ["png_of"],
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
