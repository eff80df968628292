"""Joints that move: derivatives of λ by geometry, optimisation, shapes of joints, bounds over boxes."""

from __future__ import annotations

__all__: list[str] = []
