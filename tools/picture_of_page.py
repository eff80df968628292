"""A picture of a page, as the README shows it: `python -m tools.picture_of_page PAGE[#PLACE] OUT.png`."""

from __future__ import annotations

import argparse
import io
import shutil
from pathlib import Path
from typing import Final

from PIL import Image

WIDTH: Final = 1360
HEIGHT: Final = 1230
COLOURS: Final = 256


def main() -> None:
    """Open a page in the system's Chromium and write what is seen first."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", help="a report.html, with a place in it after #")
    parser.add_argument("out", type=Path)
    given = parser.parse_args()
    file, _, place = given.page.partition("#")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        arguments = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=arguments)
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.goto(f"{Path(file).absolute().as_uri()}#{place}")
        page.wait_for_selector("body[data-ready=yes]")
        page.wait_for_timeout(500)
        shot = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
        browser.close()
    # the palette of the octree keeps small marks in their colour, which that of the median cut does not
    shot.quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(given.out, optimize=True)


if __name__ == "__main__":
    main()
