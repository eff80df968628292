"""Design check with partial factors: utilisation, reactions, joints near their limit, and a page of it.

Functions are imported from the modules that define them.
"""

from __future__ import annotations

__all__: list[str] = []
