"""How things show themselves in a notebook without knowing how they are drawn.

What draws them registers itself here, so that data stands on the ground and views above it.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, Protocol


class View(Protocol):
    """How one kind of thing is shown."""

    def svg(self, thing: Any) -> str | None:
        """Its drawing as SVG text; None where it is too large to be drawn unasked."""

    def html(self, thing: Any, drawing: str | None) -> str:
        """Its facts and its drawing, as HTML."""


_VIEWS: dict[type, View] = {}


def register_repr(kind: type, view: View) -> None:
    """From now on things of a kind are shown by a view."""
    _VIEWS[kind] = view


class NotebookRepr:
    """A thing that a notebook shows by the view registered for its kind; one without a view shows its repr."""

    @cached_property
    def _drawing(self) -> str | None:
        view = _VIEWS.get(type(self))
        return None if view is None else view.svg(self)

    def _repr_svg_(self) -> str | None:
        return self._drawing

    def _repr_html_(self) -> str | None:
        view = _VIEWS.get(type(self))
        return None if view is None else view.html(self, self._drawing)
