"""Structures with closed forms for derivatives, optimisation and bounds of joint geometry."""

from __future__ import annotations

from typing import Any

from cases import dry_and_inner

Document = dict[str, Any]


def block(width: float, height: float, *, friction: float = 2.0, lean: float = 0.0, label: str = "dry") -> Document:
    """A block on a support, pushed sideways by a share λ of its weight; the joint rises by `lean` to the right."""
    outline = [[0.0, 0.0], [width, lean], [width, lean + height], [0.0, height]]
    ground = [[-1.0, -1.0], [width + 1.0, -1.0], [width, lean], [0.0, 0.0]]
    return {
        "elements": [{"id": "b", "polygon": outline}, {"id": "g", "polygon": ground, "support": True}],
        "materials": dry_and_inner(1000.0, friction, 1e7, 3e3),
        "loads": {"live": [{"body": [1.0, 0.0]}]},
        "labels": {label: [["b", "g"]]},
    }


SPAN, HEIGHT, WIDE, DEEP = 2.0, 0.4, 1.0, 5.0
"""Flat arch on piers: clear span, height, width and height of a pier, m."""


def flat_arch(phi: float, top: float = 1.05, key: float = 0.15, root: float = 0.1, **move: Any) -> Document:
    """A flat arch of three wedges on two piers with skewbacks, with 1 N on its key.

    phi: angle of friction, degrees. top: half the distance of the tops of the springings. key, root: half the widths of
    the key at its top and bottom.
    """
    half, wide = 0.5 * SPAN, 0.5 * SPAN + WIDE
    pier = [[half, -DEEP], [wide, -DEEP], [wide, HEIGHT], [top, HEIGHT], [half, 0.0]]
    wedge = [[root, 0.0], [half, 0.0], [top, HEIGHT], [key, HEIGHT]]
    elements: list[Document] = [{"id": "key", "polygon": [[-root, 0.0], [root, 0.0], [key, HEIGHT], [-key, HEIGHT]]}]
    for name, polygon in (("pier", pier), ("wedge", wedge)):
        elements.append({"id": f"{name} right", "polygon": polygon})
        elements.append({"id": f"{name} left", "polygon": [[-x, y] for x, y in polygon[::-1]]})
    ground = [[-5.0, -DEEP - 0.5], [5.0, -DEEP - 0.5], [5.0, -DEEP], [-5.0, -DEEP]]
    elements.append({"id": "ground", "polygon": ground, "support": True})
    return {
        "name": "flat arch on piers",
        "elements": elements,
        "materials": {"density": 1000.0, "gravity": 9.81, "dry": {"friction_angle": phi}},
        "loads": {"live": [{"element": "key", "force": [0.0, -1.0], "at": [0.0, HEIGHT]}]},
        **({"move": move} if move else {}),
    }


def flat_arch_load(top: float, key: float, root: float, load: float = 1.0) -> float:
    """λ of the flat arch with hinges at key top, springing bottom and pier toe: docs/method.md (11.8)."""
    unit = 1000.0 * 9.81
    half = 0.5 * SPAN

    def moments(outline: list[list[float]]) -> tuple[float, float]:
        """Return weight and first moment of weight about x = 0 of an outline."""
        area = first = 0.0
        for (x0, y0), (x1, y1) in zip(outline, outline[1:] + outline[:1], strict=True):
            turn = x0 * y1 - x1 * y0
            area += 0.5 * turn
            first += (x0 + x1) * turn / 6.0
        return unit * abs(area), unit * abs(first)

    wedge = moments([[root, 0.0], [half, 0.0], [top, HEIGHT], [key, HEIGHT]])
    key_half = moments([[0.0, 0.0], [root, 0.0], [key, HEIGHT], [0.0, HEIGHT]])[0]
    pier = moments([[half, -DEEP], [half + WIDE, -DEEP], [half + WIDE, HEIGHT], [top, HEIGHT], [half, 0.0]])
    # H h = (v + W_k)(L/2 − x) + W L/2 − S_x and H Hp = (v + W_k + W) B + W_p (L/2 + B) − S_p, solved for v
    thrust = (half - key) / HEIGHT
    constant = (key_half * (half - key) + wedge[0] * half - wedge[1]) / HEIGHT
    held = (key_half + wedge[0]) * WIDE + pier[0] * (half + WIDE) - pier[1]
    force = (held - constant * DEEP) / (thrust * DEEP - WIDE)
    return 2.0 * force / load
