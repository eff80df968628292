"""Restrict access to the studio to its own page on this machine, by a token and a content security policy."""

from __future__ import annotations

import secrets
from typing import Final

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

LARGEST: Final = 16_000_000
"""Largest size of a request, bytes: files of 12 MB in base64."""

HEADERS: Final = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "cache-control": "no-store",
}
"""Security headers of every response."""


class Guard:
    """ASGI middleware that admits only requests with the right host, origin and token, of at most `LARGEST` bytes.

    POST requests need JSON, and an `Origin` of these hosts or none. token: first part of every path.
    """

    def __init__(self, app: ASGIApp, token: str, hosts: tuple[str, ...]) -> None:
        self.app, self.token, self.hosts = app, token, hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass an admissible HTTP request to the application, and answer any other with a refusal.

        scope, receive, send: arguments of the ASGI interface. Other kinds of connections are ignored.
        """
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return
        refused = self._refusal(scope)
        if refused is not None:
            await PlainTextResponse(refused[1], status_code=refused[0])(scope, receive, _with_headers(send))
            return
        prefix = f"/{self.token}"
        inside = {**scope, "path": scope["path"][len(prefix) :], "root_path": scope.get("root_path", "")}
        body = await _body(receive) if scope["method"] == "POST" else b""
        if body is None:
            await PlainTextResponse("too large\n", status_code=413)(scope, receive, _with_headers(send))
            return
        whole: Message = {"type": "http.request", "body": body, "more_body": False}
        waiting = [whole]

        async def once() -> Message:
            return waiting.pop() if waiting else await receive()

        await self.app(inside, once, _with_headers(send))

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Return status code and text of a refusal, None for an admissible request."""
        headers: dict[str, list[str]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.decode("latin-1").lower(), []).append(value.decode("latin-1"))
        if headers.get("host", []) not in [[host] for host in self.hosts]:
            return 421, "this server answers to 127.0.0.1 only\n"
        origins = headers.get("origin", [])
        if any(origin not in [f"http://{host}" for host in self.hosts] for origin in origins):
            return 403, "not from another page\n"
        if headers.get("sec-fetch-site", ["none"])[0] not in ("none", "same-origin"):
            return 403, "not from another page\n"
        given, slash, _ = scope["path"].removeprefix("/").partition("/")
        if not slash or not secrets.compare_digest(given.encode("utf-8"), self.token.encode("ascii")):
            return 403, "the token is missing; use the whole address that jld studio printed\n"
        if scope["method"] not in ("GET", "HEAD", "POST"):
            return 405, "GET or POST\n"
        if scope["method"] == "POST":
            if headers.get("content-type", [""])[0].partition(";")[0].strip() != "application/json":
                return 415, "JSON only\n"
            length = headers.get("content-length", ["0"])[0]
            if not length.isdigit() or int(length) > LARGEST:
                return 413, "too large\n"
        return None


async def _body(receive: Receive) -> bytes | None:
    """Return the body of a request, None if it is larger than `LARGEST`.

    The actual size counts, whatever the request states as its length.
    """
    parts, size, more = [], 0, True
    while more:
        message = await receive()
        parts.append(message.get("body", b""))
        size += len(parts[-1])
        if size > LARGEST:
            return None
        more = message.get("more_body", False)
    return b"".join(parts)


def _with_headers(send: Send) -> Send:
    """Return a `send` that adds the security headers to every response."""

    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            own = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
            message = {**message, "headers": [*message.get("headers", []), *own]}
        await send(message)

    return sending
