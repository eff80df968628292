"""Reliability of a layout: first-order method, simulation, comparison of layouts."""

from __future__ import annotations

__all__: list[str] = []
