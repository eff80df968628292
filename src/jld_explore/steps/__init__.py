"""What follows a search: the protocol of a step and its runner, own steps, and the division of a time limit."""

from __future__ import annotations

__all__: list[str] = []
