"""From an outline to numbered stones: tessellations tried, searched, moved, checked and explained.

Functions are imported from the modules that define them.
"""

from __future__ import annotations

__all__: list[str] = []
