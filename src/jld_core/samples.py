"""Parametric sample structures, which `jld_samples` makes: `samples.arch()`, `samples.wall(courses=6)` and others."""

from __future__ import annotations

from jld_core.plugins import door

__getattr__ = door("samples")
