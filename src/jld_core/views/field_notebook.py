"""Notebook representation of results by fields."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from jld_core.models.by_fields import FieldResult
from jld_core.views.notebook import LARGEST, page

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class FieldResultView:
    """Notebook representation of a result by fields: stresses and cracks of its governing case, beside its facts."""

    def drawing(self, thing: FieldResult) -> str | bytes | None:
        """Return the drawing as SVG text or PNG; None above `LARGEST` elements."""
        if len(thing.assembly.elements) > LARGEST:
            return None
        from jld_core.views import small_pictures

        return small_pictures.drawing_of(self.figure(thing))

    def figure(self, thing: FieldResult, *, ids: bool = False, values: bool = False) -> Figure:
        """Return the figure of a result; in space, where fields have no picture, that of the labelled structure."""
        from jld_core.views import field_figures, figures

        if thing.assembly.dimension == 3:
            return figures.figure_of_assembly(replace(thing.assembly, labels=thing.labels), ids=ids, values=values)
        return field_figures.figure_of_fields(*thing.governing_case)

    def html(self, thing: FieldResult, drawing: str | bytes | None) -> str:
        """Return the HTML of a result's facts and drawing; drawing: as in `ResultView.html`."""
        return page(thing.assembly.name, thing.facts_in_words(), drawing)
