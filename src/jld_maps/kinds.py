"""Names of mechanisms by what yields in them."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from jld_core import Assembly, Bits

_WORDS: Final = ("sliding at the base", "sliding", "rocking", "hinges", "twisting", "inner shear", "inner opening")


def mechanism_names(assembly: Assembly, labels: Bits, kinds: Any) -> Any:
    """Name k mechanisms by the kinds (k, m) of movement of their faces.

    Sliding is "at the base" where all faces that slide touch a support. Hinges are "rocking" where there is one, or all
    touch supports. Several parts are joined by "and"; a mechanism in which joints only open is "opening".
    """
    faces, support = assembly.interfaces, assembly.elements.support
    own = np.arange(len(labels)) < assembly.faces
    base = (support[faces.a] | support[faces.b]) & own

    def found(kind: str, where: Any = own) -> Any:
        return (kinds == kind) & where

    slides, hinges = found("slide"), found("hinge")
    elsewhere, turns = (slides & ~base).any(axis=1), hinges.any(axis=1)
    rocks = turns & ((hinges.sum(axis=1) == 1) | ~(hinges & ~base).any(axis=1))
    flags = np.column_stack([
        slides.any(axis=1) & ~elsewhere, elsewhere, rocks, turns & ~rocks,
        *(found(kind).any(axis=1) for kind in ("twist", "crack in shear", "crack in tension")),
        found("open").any(axis=1),
    ])  # fmt: skip
    patterns, each = np.unique(flags, axis=0, return_inverse=True)
    return np.array([_name(row) for row in patterns.tolist()], dtype=object)[each.ravel()]


def _name(flags: list[bool]) -> str:
    parts = [word for word, flag in zip(_WORDS, flags, strict=False) if flag] or (["opening"] if flags[-1] else [])
    return " and ".join(filter(None, [", ".join(parts[:-1]), *parts[-1:]]))
