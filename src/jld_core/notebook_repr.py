"""Notebook output of data classes that do not know how they are drawn.

A class names its view as text, and the view is loaded when it is asked for: data modules do not import views.
"""

from __future__ import annotations

from functools import cached_property
from importlib import import_module
from typing import Any, ClassVar, Final, Protocol


class View(Protocol):
    """Interface of the drawing code that shows objects of one class in notebooks."""

    def drawing(self, thing: Any) -> str | bytes | None:
        """Return the drawing of an object as SVG text or the content of a PNG file.

        The result is None if the object is too large to be drawn unasked.
        """

    def figure(self, thing: Any, *, ids: bool = False, values: bool = False) -> Any:
        """Return the drawing of an object as a matplotlib figure, of any size."""

    def html(self, thing: Any, drawing: str | bytes | None) -> str:
        """Return the main facts of an object as HTML, followed by its drawing if there is one."""


# Module that makes interactive pages; it uses this package, and is loaded by name when a page is asked for
_PAGES: Final = "jld_studio.notebook"


class Showable:
    """Base class of objects that have an interactive page for notebooks."""

    def show(self, height: int | None = None) -> Any:
        """Make the interactive page of this object, with sliders for friction and strengths.

        Make it the last line of a cell, or give it to `display`. The running kernel solves what the sliders say. A
        saved notebook keeps facts, picture and table; pages of planar structures that are not large stay interactive.
        Result: page; its `html` is the part that needs no kernel. Raises ParameterError if the height is no number of
        pixels. Raises InputError if a scene is invalid.
        """
        return import_module(_PAGES).make_page(self, height)


class NotebookRepr(Showable):
    """Base class of objects that a notebook shows by a view."""

    shown_by: ClassVar[str]  # module and class of the view, as "package.module:Class"

    @property
    def _view(self) -> View:
        """Return the view of this class, whose module is loaded where it has not been."""
        module, name = self.shown_by.split(":")
        made: View = getattr(import_module(module), name)()
        return made

    @cached_property
    def _drawing(self) -> str | bytes | None:
        """Return the drawing, computed once."""
        return self._view.drawing(self)

    def drawn(self, *, ids: bool = False, values: bool = False) -> Any:
        """Return the object's drawing as a matplotlib figure."""
        return self._view.figure(self, ids=ids, values=values)

    def _repr_svg_(self) -> str | None:
        """Return the drawing where it is SVG text, as Jupyter calls for it."""
        return self._drawing if isinstance(self._drawing, str) else None

    def _repr_png_(self) -> bytes | None:
        """Return the drawing where it is PNG, as Jupyter calls for it."""
        return self._drawing if isinstance(self._drawing, bytes) else None

    def _repr_html_(self) -> str:
        """Return facts and drawing, as Jupyter calls for them."""
        return self._view.html(self, self._drawing)
