"""Exact search: refute labellings by conflicts until none can exceed the best one known."""

from __future__ import annotations

__all__: list[str] = []
