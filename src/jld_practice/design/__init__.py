"""From an outline to numbered stones: tessellations tried, searched, moved, checked and explained."""

from __future__ import annotations

__all__: list[str] = []
