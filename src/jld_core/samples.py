"""Parametric sample structures, which `jld_samples` makes: `samples.arch()`, `samples.wall(courses=6)` and others."""

from __future__ import annotations

from typing import Any

from jld_core.plugins import part


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(name)
    return getattr(part("samples"), name)
