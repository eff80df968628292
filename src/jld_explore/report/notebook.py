"""What a notebook shows of a finished study: facts, the front with its layouts, the first rows of both tables."""

from __future__ import annotations

from jld_core.shown import show_with
from jld_core.views import notebook
from jld_explore.report import words
from jld_explore.report.exploration import Exploration


class ExplorationView:
    """A finished study."""

    def svg(self, thing: Exploration) -> str | None:
        """The front with its layouts; None where the structure is too large to be drawn unasked."""
        if len(thing.assembly.elements) > notebook.LARGEST:
            return None
        from jld_core.views.figures import svg_of
        from jld_explore.report.pictures import front_picture

        return svg_of(front_picture(thing))

    def html(self, thing: Exploration, drawing: str | None) -> str:
        """Its facts, its drawing and the first rows of its tables."""
        tables_of = {"strongest": words.best_rows(thing), f"front, {words.front_name(thing)}": thing.front}
        parts = [f"<p>{name}</p>{table[words.columns()].to_html(index=False)}" for name, table in tables_of.items()]
        return notebook.page(thing.scene.name, words.facts_of_exploration(thing), drawing, *parts)


show_with(Exploration, ExplorationView())
