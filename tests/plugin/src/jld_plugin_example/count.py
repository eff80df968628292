"""A count: dry faces that are longer (in space: larger) than the mean."""

import numpy as np

from jld_explore.space import Count, Layouts, Terms


def is_long(assembly):
    """Return which faces count: (m,)."""
    size = assembly.face_sizes
    return assembly.free_faces & (size > size[assembly.free_faces].mean() * (1 + 1e-9))


def number(layouts: Layouts) -> np.ndarray:
    """Return the count of each layout: (k,)."""
    return (layouts.labellings & is_long(layouts.assembly)).sum(axis=1)


long_faces = Count(
    "long_faces",
    of=number,
    axis="dry faces longer than the mean",
    noun="long dry face",
    terms=lambda assembly: Terms(faces=is_long(assembly)),  # lets the exact driver prove fronts and limits
)
