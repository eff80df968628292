"""A browser without a display: the system's Chromium, driven by playwright; without one, these tests skip."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from browser_visits import ARGUMENTS, Open, Visit, chromium

if TYPE_CHECKING:
    from playwright.sync_api import Browser


_PATIENCE = 120_000  # ms, also of a busy machine: no test asserts a time


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = chromium()
    if path is None:
        pytest.skip("no Chromium on this machine; make browser installs it from the system's packages")
    with api.sync_playwright() as driver:
        made = driver.chromium.launch(executable_path=path, args=ARGUMENTS)
        yield made
        made.close()


@pytest.fixture
def visit(browser: Browser) -> Iterator[Open]:
    """Opens an address; at the end no page may have logged an error or asked for anything off this machine."""
    visits: list[Visit] = []

    def opened(address: str | Path, *, size: tuple[int, int] = (1200, 900), ready: bool = True, **more: Any) -> Visit:
        context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **more)
        context.set_default_timeout(_PATIENCE)
        found = Visit(context.new_page())
        found.page.on("console", lambda m: found.errors.append(m.text) if m.type in ("error", "warning") else None)
        found.page.on("pageerror", lambda error: found.errors.append(str(error)))
        found.page.on("request", lambda r: _note(found, r.url))
        found.page.goto(address.as_uri() if isinstance(address, Path) else address)
        if ready:
            found.page.wait_for_selector("body[data-ready]")
        visits.append(found)
        return found

    yield opened
    for found in visits:
        found.page.context.close()
        noise = ("GPU stall due to ReadPixels", "GL Driver Message")  # software WebGL talks about screenshots
        assert [text for text in found.errors if not any(word in text for word in noise)] == []
        assert found.outside == []


def _note(found: Visit, url: str) -> None:
    if not url.startswith(("file:", "data:", "blob:", "http://127.0.0.1:")):
        found.outside.append(url)
