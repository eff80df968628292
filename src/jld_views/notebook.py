"""Notebook representations: a table of facts and a drawing; matplotlib is imported only when it draws."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import replace
from html import escape
from typing import TYPE_CHECKING, Final

from jld_core import Assembly, LimitAnalysisResult
from jld_core.views import facts_of_assembly, facts_of_result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from jld_core.models import by_fields


LARGEST: Final = 1500
"""Largest number of elements that a notebook draws unasked; larger drawings take megabytes and many seconds."""


class AssemblyView:
    """Notebook representation of an assembly: structure, labels and loads, beside its facts."""

    def drawing(self, thing: Assembly) -> str | bytes | None:
        if len(thing.elements) > LARGEST:
            return None
        from jld_views import figures

        return figures.drawing_of(figures.figure_of_assembly(thing))

    def figure(self, thing: Assembly, *, ids: bool = False, values: bool = False) -> Figure:
        from jld_views import figures

        return figures.figure_of_assembly(thing, ids=ids, values=values)

    def html(self, thing: Assembly, drawing: str | bytes | None) -> str:
        return page(thing.name, facts_of_assembly(thing), drawing)


class ResultView:
    """Notebook representation of a result: labels, forces and mechanism, beside its facts."""

    def drawing(self, thing: LimitAnalysisResult) -> str | bytes | None:
        if len(thing.assembly.elements) > LARGEST:
            return None
        from jld_views import figures

        return figures.drawing_of(figures.figure_of_result(thing))

    def figure(self, thing: LimitAnalysisResult, *, ids: bool = False, values: bool = False) -> Figure:
        from jld_views import figures

        return figures.figure_of_result(thing, ids=ids, values=values)

    def html(self, thing: LimitAnalysisResult, drawing: str | bytes | None) -> str:
        return page(thing.assembly.name, facts_of_result(thing), drawing)


def page(title: str, facts: Mapping[str, str], drawing: str | bytes | None, *tables: str) -> str:
    """Return HTML that shows one object in a notebook: title, facts, drawing, further tables."""
    cell = 'style="text-align: left; vertical-align: top"'
    rows = "".join(f"<tr><th {cell}>{escape(k)}</th><td {cell}>{escape(v)}</td></tr>" for k, v in facts.items())
    picture = f"<p>more than {LARGEST} elements: drawn only by <code>jld_core.views.figures</code></p>"
    if drawing is not None:
        # a separate image, since ids inside the drawing would collide with those of other drawings on the page
        kind, content = ("svg+xml", drawing.encode()) if isinstance(drawing, str) else ("png", drawing)
        data = base64.b64encode(content).decode("ascii")
        picture = f'<img alt="{escape(title)}" style="max-width: 100%" src="data:image/{kind};base64,{data}">'
    return f"<div><p><strong>{escape(title)}</strong></p><table>{rows}</table>{picture}{''.join(tables)}</div>"


class FieldResultView:
    """Notebook representation of a result by fields: stresses and cracks of its governing case, beside its facts."""

    def drawing(self, thing: by_fields.FieldResult) -> str | bytes | None:
        if len(thing.assembly.elements) > LARGEST:
            return None
        from jld_views import figures

        return figures.drawing_of(self.figure(thing))

    def figure(self, thing: by_fields.FieldResult, *, ids: bool = False, values: bool = False) -> Figure:
        """Return the figure of a result; in space, where fields have no picture, that of the labelled structure."""
        from jld_views import field_figures, figures

        if thing.assembly.dimension == 3:
            return figures.figure_of_assembly(replace(thing.assembly, labels=thing.labels), ids=ids, values=values)
        return field_figures.figure_of_fields(*thing.governing_case)

    def html(self, thing: by_fields.FieldResult, drawing: str | bytes | None) -> str:
        return page(thing.assembly.name, thing.facts_in_words(), drawing)
