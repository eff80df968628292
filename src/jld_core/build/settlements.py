"""Conversion of a scene's settlements to velocities of its supports."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.errors import InputError
from jld_core.geometry import spun
from jld_core.scene import Scene


@dataclass(frozen=True)
class Settlement:
    """Movement of supports with a given direction and an unknown magnitude."""

    name: str  # name in the scene
    # (n, 3) velocity of each element about its centroid, translation then rotation; zero except for supports that move
    velocity: Floats
    load: float = 0.0  # share of the live load that acts during the settlement


def settlements_of(scene: Scene, assembly: Assembly) -> tuple[Settlement, ...]:
    """Return the settlements of a scene, in the scene's order.

    Raises InputError: an element is unknown, is no support, or touches no free element; a vector has the wrong length;
    or nothing moves.
    """
    return tuple(
        Settlement(one.name, _velocity(scene, assembly, place), one.load) for place, one in enumerate(scene.settlements)
    )


def _velocity(scene: Scene, assembly: Assembly, place: int) -> Floats:
    """Return the velocities (n, q) of all elements for one settlement.

    Raises InputError as `settlements_of`.
    """
    elements, d, q = assembly.elements, assembly.dimension, assembly.freedoms
    velocity = np.zeros((len(elements), q))
    faces = assembly.interfaces
    bearing = set(np.concatenate([faces.a, faces.b]).tolist())
    for number, part in enumerate(scene.settlements[place].supports):
        key = f"settlements[{place}].supports[{number}]"
        names = [part.elements] if isinstance(part.elements, str) else part.elements
        rows = []
        for name in names:
            if name not in elements.index:
                raise InputError(f"{key}.elements", f"no element is named {name!r}", "ids of supports")
            row = elements.index[name]
            if not elements.support[row]:
                raise InputError(f"{key}.elements", f"{name!r} is no support", "ids of supports")
            rows.append(row)
        if not bearing.intersection(rows):
            raise InputError(f"{key}.elements", "no free element touches them", "supports that bear something")
        move = _sized(part.move if part.move is not None else [0.0] * d, d, f"{key}.move")
        turn = _sized(np.atleast_1d(part.turn).tolist() if np.any(part.turn) else [0.0] * (q - d), q - d, f"{key}.turn")
        about = elements.centroid[rows].mean(axis=0) if part.about is None else _sized(part.about, d, f"{key}.about")
        for row in rows:
            arm = elements.centroid[row] - about
            velocity[row] += np.concatenate([move + spun(turn, arm), turn])
    if not velocity.any():
        raise InputError(f"settlements[{place}]", "nothing moves", '"move" or "turn" of some support')
    return velocity


def _sized(values: list[float], size: int, where: str) -> Floats:
    """Convert a list of numbers to a vector; raise InputError unless its length is `size`."""
    if len(values) != size:
        raise InputError(where, f"it has {len(values)} number{'s' * (len(values) != 1)}", f"{size} in this scene")
    return np.array(values, dtype=float)
