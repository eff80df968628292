"""Serve a local page on which joints are edited by hand and λ is solved with proof.

- `Api`: handlers of the page's requests: from the JSON object of a request to that of the answer
- `Jobs`: all searches of one folder, earlier ones too; thread-safe
- `NotebookPage`: interactive page of a scene, a result or a search; pages: data, the largest first; height: pixels
- `StudioSession`: solver of labellings of one scene, all of which may change but its elements
- `build_app`: return the web application of the studio: page, front-end files and the API
- `collapse_loads`: state λ times every live load: for each case one text per live entry, as "11.9 kN", "" without λ
- `evaluate`: solve a scene as another program states it, and return JSON data
- `make_page`: make the page of a scene, an assembly, a result or a finished search, shown as the last line of a cell
- `open_studio`: serve the studio on 127.0.0.1 until it is interrupted
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
