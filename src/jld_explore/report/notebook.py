"""Show a finished study in a notebook: facts, front and first rows, or its page."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import TYPE_CHECKING

from jld_core.views import notebook
from jld_explore.report import words
from jld_explore.report.page_of_study import PATIENCE, study_page
from jld_explore.report.reading import Exploration

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class ExplorationView:
    """Notebook representation of a finished study: facts, front, and first rows of its tables."""

    def drawing(self, thing: Exploration) -> str | bytes | None:
        """Return the front with its layouts as SVG text or PNG; None above `LARGEST` elements."""
        if len(thing.assembly.elements) > notebook.LARGEST:
            return None
        from jld_core.views.small_pictures import drawing_of
        from jld_explore.report.pictures import front_picture

        return drawing_of(front_picture(thing))

    def figure(self, thing: Exploration, *, ids: bool = False, values: bool = False) -> Figure:
        """Return the figure of the front with its layouts; `ids` and `values` have no effect."""
        from jld_explore.report.pictures import front_picture

        return front_picture(thing)

    def html(self, thing: Exploration, drawing: str | bytes | None) -> str:
        """Return the facts, the drawing and the first rows of both tables as HTML."""
        tables_of = {"strongest": words.best_rows(thing), f"front, {words.front_name(thing)}": thing.front}
        parts = [
            f"<p>{name}</p>{table[words.columns(thing)].to_html(index=False)}" for name, table in tables_of.items()
        ]
        return notebook.page(thing.scene.name, words.facts_of_exploration(thing), drawing, *parts)


@dataclass(frozen=True)
class Page:
    """Interactive page of a search, which a notebook shows in a frame."""

    text: str  # HTML of the page
    height: int = 900  # height of the frame, pixels

    def _repr_html_(self) -> str:
        """Return the page in a frame, as Jupyter calls for it."""
        frame = 'style="width: 100%; border: 1px solid #888" title="the page of a search"'
        return f'<iframe srcdoc="{html.escape(self.text)}" height="{self.height}" {frame}></iframe>'

    def __repr__(self) -> str:
        return f"Page({len(self.text)} characters)"


def show_page(done: Exploration, height: int = 900, patience: float = PATIENCE) -> Page:
    """Make the interactive page of a finished search for a notebook; no file is written.

    Parameters
    ----------
    done : Exploration
        Finished search.
    height : int
        Height of the frame, pixels.
    patience : float
        Time limit for solving layouts to be drawn, s; the best come first.

    Returns
    -------
    Page
        Page for the notebook.
    """
    return Page(study_page(done, patience), height)
