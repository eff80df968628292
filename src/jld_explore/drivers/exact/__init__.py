"""Exact search: refute labellings by conflicts until none can exceed the best known one (docs/notes/exact.md)."""

from __future__ import annotations

__all__: list[str] = []
