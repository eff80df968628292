"""Reliability of a layout: first-order method, simulation, comparison of layouts.

Its functions are imported from the modules that define them.
"""

from __future__ import annotations

__all__: list[str] = []
