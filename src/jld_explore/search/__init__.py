"""A search: settings, refusals, the choice of the driver, and studies, which ask, evaluate and tell."""

from __future__ import annotations

__all__: list[str] = []
