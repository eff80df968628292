"""Serve a local page on which joints are edited by hand and λ is solved with proof.

- `open_studio`: serve the studio on 127.0.0.1 until it is interrupted
"""

from __future__ import annotations

from jld_studio.server import open_studio

__all__ = ["open_studio"]
