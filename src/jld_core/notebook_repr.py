"""Notebook output of data classes, whose views are named as text and loaded when they are needed."""

from __future__ import annotations

from functools import cached_property
from importlib import import_module
from typing import Any, ClassVar, Final, Protocol


class View(Protocol):
    """Drawing code that shows objects of one class in notebooks."""

    def drawing(self, thing: Any) -> str | bytes | None:
        """Return the drawing of an object as SVG text or PNG content; None if it is too large to be drawn unasked."""

    def figure(self, thing: Any, *, ids: bool = False, values: bool = False) -> Any:
        """Return the drawing as a matplotlib figure of any size."""

    def html(self, thing: Any, drawing: str | bytes | None) -> str:
        """Return the main facts of an object as HTML, followed by its drawing if there is one."""


# Module that makes interactive pages; it uses this package, and is loaded by name when a page is asked for
_PAGES: Final = "jld_studio.notebook"


class Showable:
    """Base class of objects that have an interactive page for notebooks."""

    def show(self, height: int | None = None) -> Any:
        """Make the interactive page of this object, with sliders for friction and strengths.

        Make it the last line of a cell; the running kernel solves what the sliders say. A saved notebook keeps facts,
        picture and table. `html` of the page needs no kernel.
        """
        return import_module(_PAGES).make_page(self, height)


class NotebookRepr(Showable):
    """Base class of objects that a notebook shows by a view."""

    shown_by: ClassVar[str]  # module and class of the view, as "package.module:Class"

    @property
    def _view(self) -> View:
        module, name = self.shown_by.split(":")
        view: View = getattr(import_module(module), name)()
        return view

    @cached_property
    def _drawing(self) -> str | bytes | None:
        return self._view.drawing(self)

    def drawn(self, *, ids: bool = False, values: bool = False) -> Any:
        return self._view.figure(self, ids=ids, values=values)

    def _repr_svg_(self) -> str | None:
        return self._drawing if isinstance(self._drawing, str) else None

    def _repr_png_(self) -> bytes | None:
        return self._drawing if isinstance(self._drawing, bytes) else None

    def _repr_html_(self) -> str:
        return self._view.html(self, self._drawing)
