"""Figures of an assembly, its forces and its mechanism, which `jld_views` draws."""

from __future__ import annotations

from jld_core.plugins import door

__getattr__ = door("figures")
