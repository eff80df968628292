"""Warnings about names of version 0.2 that keep working for one version."""

from __future__ import annotations

import warnings


def warn_renamed(old: str, new: str, stacklevel: int = 3) -> None:
    """Warn that a public name has been replaced.

    Parameters
    ----------
    old : str
        Name of version 0.2.
    new : str
        Name that replaces it.
    stacklevel : int
        Number of frames from here to the caller who used the old name.
    """
    warnings.warn(f"{old} is now {new}; the old form works until version 0.4", FutureWarning, stacklevel=stacklevel)
