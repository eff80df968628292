"""A studio in a thread of this process, asked over a socket."""

from __future__ import annotations

import http.client
import json
import re
import threading
import time
from pathlib import Path
from typing import Any

import jsonschema
import uvicorn

from command import ROOT
from jld_core import parse_scene
from jld_studio import Api, Jobs, StudioSession, build_app, server

TOKEN = "t0ken-of-this-test"

SCHEMA = json.loads(re.findall(r"```json\n(.*?)```", (ROOT / "docs/reference/http.md").read_text("utf-8"), re.S)[1])
"""The schema of what the page asks, as the documentation states it."""


def fits(document: Any, name: str) -> None:
    """Hold a request or an answer against the documented schema."""
    jsonschema.validate(document, {**SCHEMA, "$ref": f"#/$defs/{name}"})


class Local:
    """A studio in a thread of this process."""

    def __init__(self, root: Path, scene: dict[str, Any]) -> None:
        self.root = root
        self.desk = StudioSession(parse_scene(scene))
        self.jobs = Jobs(root)
        answers = Api(self.desk, self.jobs, root, lambda: server.first_data(self.desk, root, None))
        listener = server._listener(0)  # as the program does, which sends short answers at once
        self.port = listener.getsockname()[1]
        app = build_app(answers, TOKEN, (f"127.0.0.1:{self.port}", f"localhost:{self.port}"))
        self.server = uvicorn.Server(uvicorn.Config(app, log_level="warning", access_log=False))
        self.thread = threading.Thread(target=self.server.run, kwargs={"sockets": [listener]}, daemon=True)
        self.thread.start()
        while not self.server.started:
            time.sleep(0.01)

    def ask(
        self, path: str, body: Any = None, *, raw: bytes | None = None, method: str = "", **headers: str
    ) -> tuple[int, dict[str, str], str]:
        """Status, headers and text. body: posted as JSON; headers: with underscores for hyphens."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)
        content = raw if raw is not None else None if body is None else json.dumps(body).encode()
        sent = {name.replace("_", "-"): value for name, value in headers.items()}
        if content is not None:
            sent.setdefault("content-type", "application/json")
        connection.request(method or ("GET" if content is None else "POST"), path, content, sent)
        answer = connection.getresponse()
        found = answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read().decode()
        connection.close()
        return found

    def api(self, name: str, body: Any = None) -> tuple[int, Any]:
        """Status and JSON of a call with the token."""
        status, _, text = self.ask(f"/{TOKEN}/api/{name}", body)
        return status, json.loads(text)

    def close(self) -> None:
        self.server.should_exit = True
        self.thread.join(timeout=120)
        self.jobs.close()
