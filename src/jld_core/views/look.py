"""How things are drawn: colours, line styles and marks, stated once for matplotlib and for pages.

Colours are #rrggbb. They stay apart for colour-blind readers and in greys; dry and inner, pushing and pulling, kinds of
movement and of evidence differ by line or shape as well. Nothing here knows of matplotlib but `Mark.style`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

from jld_core.views.quantities import SMALL, YIELDING, MovementSign

TINTS: Final = ("#CFE1F2", "#FBE3B5", "#D3EBCD", "#F6D3D9", "#E3D9EE", "#D5EFEE", "#EDE7CF", "#F9D9C0")
"""Fills of blocks: light, so that lines show; also apart in lightness."""

PLAIN: Final = "#F4F3EF"
SUPPORT: Final = "#DADADA"
HATCH: Final = "#9A9A9A"
INK: Final = "#1B1B1B"
SOFT: Final = "#5C5C5C"
REST: Final = "#8A8A8A"
WHITE: Final = "#FFFFFF"
LOAD: Final = "#B8321A"
PRESS: Final = "#1F4E9E"
FRONT: Final = "#B8321A"
DOTS: Final = "#7C9CBF"

USED_STOPS: Final = ("#B4B4B4", "#D89A2B", "#8C2300")
"""Utilisation 0 … 1: it also gets darker, and the lines wider, so that it reads without colour."""

INNER_DASH: Final = (1.0, 1.6)
THRUST_COLOUR: Final = "#8A2F8F"
THRUST_DASH: Final = (4.0, 1.5)
"""Lengths of line and gap, in widths of the line."""

EYE: Final = (-62.0, 24.0)
"""Azimuth and elevation of the eye in spatial views, degrees."""

Shape = Literal["circle", "diamond", "thin diamond", "triangle", "cross"]
_MARKERS: Final[dict[Shape, str]] = {
    "circle": "o", "diamond": "D", "thin diamond": "d", "triangle": "^", "cross": "X",
}  # fmt: skip


@dataclass(frozen=True)
class Mark:
    """A small sign. shape, fill and edge are drawn; meaning stands in legends."""

    shape: Shape
    fill: str
    edge: str
    meaning: str

    @property
    def style(self) -> dict[str, Any]:
        """The same for matplotlib's lines."""
        return {"marker": _MARKERS[self.shape], "color": self.fill, "markeredgecolor": self.edge}


MOVEMENTS: Final[dict[MovementSign, Mark]] = {
    MovementSign.HINGE: Mark("circle", WHITE, INK, "hinge"),
    MovementSign.SLIDE: Mark("diamond", "#E69F00", INK, "slide"),
    MovementSign.OPEN: Mark("triangle", "#56B4E9", INK, "joint opens"),
    MovementSign.CRACK: Mark("cross", LOAD, WHITE, "crack in a block"),
}
YIELDS: Final[dict[str, Mark]] = {
    "dry": Mark("thin diamond", "#F0E442", INK, "dry face at yield"),
    "inner": Mark("cross", LOAD, WHITE, "inner face at yield"),
}
EVIDENCE: Final[dict[str, Mark]] = {
    "proven": Mark("diamond", FRONT, INK, "proven: no layout with this count carries more"),
    "found": Mark("circle", WHITE, FRONT, "found: the best known for its count"),
    "visited": Mark("circle", DOTS, DOTS, "visited on the way"),
}


def rules() -> dict[str, Any]:
    """All of it as plain numbers and texts, the object `look` of a page's data (docs/guide/page.md)."""

    def mark(of: Mark) -> dict[str, str]:
        return {"shape": of.shape, "fill": of.fill, "edge": of.edge, "meaning": of.meaning}

    return {
        "tints": list(TINTS),
        "plain": PLAIN,
        "support": SUPPORT,
        "hatch": HATCH,
        "ink": INK,
        "soft": SOFT,
        "rest": REST,
        "load": LOAD,
        "press": PRESS,
        "used": list(USED_STOPS),
        "thrust": THRUST_COLOUR,
        "thrust_dash": list(THRUST_DASH),
        "inner_dash": list(INNER_DASH),
        "movements": {str(kind): mark(of) for kind, of in MOVEMENTS.items()},
        "yielding": {kind: mark(of) for kind, of in YIELDS.items()},
        "evidence": {kind: mark(of) for kind, of in EVIDENCE.items()},
        "front": FRONT,
        "small": SMALL,
        "yields": YIELDING,
        "eye": list(EYE),
    }
