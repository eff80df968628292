"""Reliability of a layout: random variables, first-order method, simulation, and comparison of layouts.

Its functions are imported from the modules that define them.
"""

from __future__ import annotations

__all__: list[str] = []
