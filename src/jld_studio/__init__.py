"""Serve a local page on which joints are edited by hand and λ is solved with proof.

- `Api`: handlers of the page's requests
- `Jobs`: all searches of one folder; thread-safe
- `NotebookPage`: interactive page of a scene, a result or a search
- `StudioSession`: solver of labellings of one scene
- `build_app`: the web application
- `collapse_loads`: state λ times every live load
- `evaluate`: solve a scene as another program states it
- `make_page`: make the page that a notebook shows
- `open_studio`: serve the studio until it is interrupted
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_studio.api import Api
    from jld_studio.jobs import Jobs, evaluate
    from jld_studio.notebook import NotebookPage, make_page
    from jld_studio.server import build_app, open_studio
    from jld_studio.session import StudioSession, collapse_loads

__all__ = [
    "Api",
    "Jobs",
    "NotebookPage",
    "StudioSession",
    "build_app",
    "collapse_loads",
    "evaluate",
    "make_page",
    "open_studio",
]

export_lazily(
    __name__,
    {
        "api": ["Api"],
        "jobs": ["Jobs", "evaluate"],
        "notebook": ["NotebookPage", "make_page"],
        "server": ["build_app", "open_studio"],
        "session": ["StudioSession", "collapse_loads"],
    },
)
