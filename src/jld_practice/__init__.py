"""Practice: outline to stones, printed report, stock, design check, reliability."""

from __future__ import annotations

__all__: list[str] = []
