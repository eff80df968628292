"""Colours, line styles and marks of figures and pages, distinct also in greyscale; meanings differ in shape too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

from jld_views.quantities import SMALL, YIELDING, MovementSign

TINTS: Final = ("#CFE1F2", "#FBE3B5", "#D3EBCD", "#F6D3D9", "#E3D9EE", "#D5EFEE", "#EDE7CF", "#F9D9C0")
"""Fill colours of blocks: light, so that lines remain visible, and of different lightness."""

PLAIN: Final = "#F4F3EF"
"""Fill colour of elements where blocks are not distinguished."""

SUPPORT: Final = "#DADADA"
"""Fill colour of supports."""

HATCH: Final = "#9A9A9A"
"""Colour of the hatching of supports."""

INK: Final = "#1B1B1B"
"""Colour of dry faces and main lines."""

SOFT: Final = "#5C5C5C"
"""Colour of inner faces, outlines and secondary text."""

REST: Final = "#8A8A8A"
"""Colour of outlines at rest."""

WHITE: Final = "#FFFFFF"
"""Colour of hollow marks and text halos."""

LOAD: Final = "#B8321A"
"""Colour of live loads."""

PRESS: Final = "#1F4E9E"
"""Colour of face forces."""

MEMBER: Final = "#0B6E4F"
"""Colour of ties, tendons and pins."""

FRONT: Final = "#B8321A"
"""Colour of the Pareto front and of support movements."""

DOTS: Final = "#7C9CBF"
"""Colour of visited layouts."""

USED_STOPS: Final = ("#B4B4B4", "#D89A2B", "#8C2300")
"""Colours of utilisation 0 … 1, darker with it."""

INNER_DASH: Final = (1.0, 1.6)  # lengths of line and gap of inner faces, in line widths
THRUST_COLOUR: Final = "#8A2F8F"
"""Colour of the thrust line."""

THRUST_DASH: Final = (4.0, 1.5)  # lengths of line and gap of the thrust line, in line widths
EYE: Final = (-62.0, 24.0)  # azimuth and elevation of the viewing direction in spatial figures, degrees
Shape = Literal["circle", "diamond", "thin diamond", "triangle", "cross"]  # name of a marker shape

# Markers of matplotlib by shape
_MARKERS: Final[dict[Shape, str]] = {
    "circle": "o", "diamond": "D", "thin diamond": "d", "triangle": "^", "cross": "X",
}  # fmt: skip


@dataclass(frozen=True)
class Mark:
    """Marker that figures and pages draw alike, with its legend text."""

    shape: Shape  # name of the shape
    # fill, edge: colours #rrggbb
    fill: str
    edge: str
    meaning: str  # legend text

    @property
    def style(self) -> dict[str, Any]:
        """Return the keyword arguments of matplotlib that draw a line's marker in this style."""
        return {"marker": _MARKERS[self.shape], "color": self.fill, "markeredgecolor": self.edge}


MOVEMENTS: Final[dict[MovementSign, Mark]] = {  # marks by kind of movement of a face
    MovementSign.HINGE: Mark("circle", WHITE, INK, "hinge"),
    MovementSign.SLIDE: Mark("diamond", "#E69F00", INK, "slide"),
    MovementSign.OPEN: Mark("triangle", "#56B4E9", INK, "joint opens"),
    MovementSign.CRACK: Mark("cross", LOAD, WHITE, "crack in a block"),
}

YIELDS: Final[dict[str, Mark]] = {  # marks of yielding faces, by label
    "dry": Mark("thin diamond", "#F0E442", INK, "dry face at yield"),
    "inner": Mark("cross", LOAD, WHITE, "inner face at yield"),
}

EVIDENCE: Final[dict[str, Mark]] = {  # marks of layouts, by evidence for their optimality
    "proven": Mark("diamond", FRONT, INK, "proven: none carries more, or as much with a better count"),
    "found": Mark("circle", WHITE, FRONT, "found: the best known for its count"),
    "visited": Mark("circle", DOTS, DOTS, "visited on the way"),
}


def rules() -> dict[str, Any]:
    """Return all colours, dashes and marks as the object `look` of a page's data."""
    # The format of the object is in docs/guide/page.md.

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
        "member": MEMBER,
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
