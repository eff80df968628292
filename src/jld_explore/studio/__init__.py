"""A local page with a live core: joints are moved by hand and λ follows, proven; searches run behind it."""

from __future__ import annotations

from jld_explore.studio.server import open_studio

__all__ = ["open_studio"]
