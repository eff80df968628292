"""Small drawings for notebooks: SVG text, or PNG in few colours if SVG would be large."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Final

from jld_views.figures import svg_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SVG: Final = 50_000  # largest size of a drawing as SVG text, bytes; a notebook stores it in two forms

_PNG: Final = 45_000  # largest size of a drawing as PNG, bytes; larger ones are drawn with fewer pixels

# Pixels per inch of a PNG, of which the first that is small enough is taken, else the last
_DOTS: Final = (100, 75, 55, 40, 25)

_COLOURS: Final = 64  # number of colours of a PNG


def drawing_of(figure: Figure) -> str | bytes:
    """Return a figure as SVG text, or as PNG content if the text would be large."""
    text = svg_of(figure)
    return text if len(text) <= _SVG else png_of(figure)


def png_of(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file in few colours, of fewer pixels where it would be large.

    Parameters
    ----------
    figure : Figure
        Figure.

    Returns
    -------
    bytes
        Content.
    """
    from PIL import Image  # comes with matplotlib; slow to import

    small = io.BytesIO()
    for dots in _DOTS:
        whole, small = io.BytesIO(), io.BytesIO()
        figure.savefig(whole, format="png", dpi=dots)
        Image.open(whole).convert("RGB").quantize(_COLOURS).save(small, format="png", optimize=True)
        if small.tell() <= _PNG:
            break
    return small.getvalue()
