"""Design check with partial factors: utilisation, reactions, joints near their limit.

Functions are imported from the modules that define them.
"""

from __future__ import annotations

__all__: list[str] = []
