"""Operators that draw, change and cross labellings."""

from __future__ import annotations

__all__: list[str] = []
