"""Design check with partial factors: utilisation, reactions, joints near their limit."""

from __future__ import annotations

__all__: list[str] = []
