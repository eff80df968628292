"""Schur-complement interior-point method for large assemblies."""

from __future__ import annotations

__all__: list[str] = []
