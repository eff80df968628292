"""What the tests in a browser share: a visit to a page, and its comparison with a reference picture."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

if TYPE_CHECKING:
    from playwright.sync_api import Page

REFERENCES = Path(__file__).parent / "browser" / "references"
WIDTH = 420  # px of a reference picture
ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"]
"""A container has neither a sandbox for root nor a graphics card; WebGL is drawn in software, and nothing else is drawn
by way of it."""


def chromium() -> str | None:
    """The system's browser."""
    named = os.environ.get("JLD_BROWSER")
    return named or next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@dataclass
class Visit:
    """A page, and what it said and asked for while it was open."""

    page: Page
    errors: list[str] = field(default_factory=list)
    outside: list[str] = field(default_factory=list)

    def text(self, selector: str) -> str:
        """What an element says."""
        return self.page.locator(selector).first.inner_text()

    def run(self, script: str, *arguments: Any) -> Any:
        """The value of a script on the page."""
        return self.page.evaluate(script, *arguments)

    def pixels(self, selector: str | None = None) -> np.ndarray[Any, Any]:
        """A screenshot (height, width, 3), 0 … 255."""
        shot = self.page.locator(selector).first.screenshot() if selector else self.page.screenshot()
        return np.asarray(Image.open(BytesIO(shot)).convert("RGB"), dtype=float)


Open = Callable[..., Visit]


SETTLED, PAUSE = 20, 250
"""Screenshots at the most before a page must look right, and the time between them, ms."""


def looks_like(found: Visit, name: str, selector: str | None = None) -> None:
    """Compare with a small reference picture; JLD_WRITE_REFERENCES=1 writes it, for people to look at.

    Answers that arrive one after the other move a page: it must look right once it has settled.
    """
    path = REFERENCES / f"{name}.png"
    if os.environ.get("JLD_WRITE_REFERENCES"):
        _small(found, selector).quantize(64).save(path, optimize=True)
    reference = Image.open(path).convert("RGB")
    for _ in range(SETTLED):
        small = _small(found, selector)
        # other fonts move lines of text: what must agree is what the eye sees from afar
        far = [np.asarray(p.resize((42, 32), Image.Resampling.BOX), dtype=float) for p in (small, reference)]
        difference = abs(far[0] - far[1]).max(axis=2)
        taller = abs(small.height - reference.height) / reference.height
        if taller <= 0.06 and difference.mean() < 5.0 and np.quantile(difference, 0.99) < 70.0:
            return
        found.page.wait_for_timeout(PAUSE)
    raise AssertionError(
        f"{name}: differs from its reference by {difference.mean():.1f} of 255 on average, its height by {taller:.0%}"
    )


def _small(found: Visit, selector: str | None) -> Image.Image:
    """A screenshot of the width of the reference pictures."""
    picture = Image.fromarray(found.pixels(selector).astype(np.uint8))
    return picture.resize((WIDTH, round(WIDTH * picture.height / picture.width)), Image.Resampling.BOX)
