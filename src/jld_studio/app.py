"""Serve the studio: its page, front-end modules, and JSON under `api/`."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, Final

import anyio
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from jld_core import InputError, SolverError
from jld_explore.report import page_data
from jld_studio.api import Api
from jld_studio.evaluation import evaluate
from jld_studio.guard import Guard

KINDS: Final = {"js": "text/javascript", "css": "text/css", "html": "text/html"}
"""Media type by file extension."""


def _asked(body: bytes) -> dict[str, Any]:
    """Return the JSON object of a request; raise InputError if there is none."""
    try:
        # json raises ValueError for invalid JSON, invalid UTF-8, or a number of thousands of digits.
        asked = json.loads(body or b"{}")
    except (ValueError, RecursionError):
        raise InputError("request", "it is not JSON", "one JSON object") from None
    if not isinstance(asked, dict):
        raise InputError("request", "it is no JSON object", "an object")
    return asked


def build_app(answers: Api, token: str, hosts: tuple[str, ...]) -> Guard:
    """Return the web application of the studio: page, front-end files and the API."""

    def calling(call: Callable[[dict[str, Any]], dict[str, Any]]) -> Callable[[Request], Any]:
        async def answer(request: Request) -> Response:
            try:
                asked = _asked(await request.body()) if request.method == "POST" else {}
                return JSONResponse(await anyio.to_thread.run_sync(call, asked))
            except InputError as error:
                return JSONResponse({"error": str(error), "key": error.where}, status_code=400)
            except SolverError as error:
                return JSONResponse({"error": str(error)}, status_code=400)
            except OSError as error:
                words = f"{error.filename or 'a file'}: {error.strerror or error}"
                line = f"{words}; expected a place that can be read and written"
                return JSONResponse({"error": line}, status_code=500)

        return answer

    async def page(_: Request) -> Response:
        return HTMLResponse(page_data.asset("studio.html", "studio"))

    ours, shared = page_data.asset_names("studio"), page_data.asset_names()

    async def file(request: Request) -> Response:
        name = request.path_params["name"]
        if name not in ours and name not in shared:
            return Response("no such file\n", status_code=404, media_type="text/plain")
        text = page_data.asset(name, "studio" if name in ours else "report")
        return Response(text, media_type=KINDS[name.rpartition(".")[2]])

    calls: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
        "solve": answers.solve,
        "evaluate": evaluate,
        "edit": answers.edit,
        "open": answers.open,
        "read": answers.read,
        "design": answers.design,
        "show": answers.show,
        "support": answers.support,
        "drawing": answers.drawing,
        "fields": answers.fields,
        "improve": answers.improve,
        "start": answers.start_job,
        "stop": answers.stop_job,
        "resume": answers.resume_job,
        "results": answers.results,
        "report": answers.report,
        "candidates": answers.keep,
        "scene": answers.scene,
        "export": answers.export,
        "save": answers.save,
    }
    routes = [
        Route("/", page),
        Route("/assets/{name:path}", file),
        Route("/api/data", calling(answers.data)),
        Route("/api/jobs", calling(answers.list_jobs)),
        *(Route(f"/api/{name}", calling(call), methods=["POST"]) for name, call in calls.items()),
    ]
    return Guard(Starlette(routes=routes), token, hosts)
