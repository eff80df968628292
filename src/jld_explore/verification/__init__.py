"""Check proofs of the exact driver by code that is independent of the search.

- `verify`: check a certificate
"""

from __future__ import annotations

from jld_explore.verification.verify import verify

__all__ = [
    "verify",
]
