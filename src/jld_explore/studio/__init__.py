"""A local page with a live core: joints are moved by hand and λ follows, proven; searches run behind it.

- `open_studio`: serve the studio on 127.0.0.1 until it is interrupted
"""

from __future__ import annotations

from jld_explore.studio.server import open_studio

__all__ = ["open_studio"]
