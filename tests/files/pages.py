"""SVG as Inkscape, Illustrator and browsers write it, and CSV of tables."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from files.make import File

NAMES = (
    'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
    'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
)
MM = 'width="2000mm" height="2000mm" viewBox="0 0 2000 2000"'
GROUND = '<g id="SUPPORTS"><rect x="0" y="1000" width="1000" height="300"/></g>'


def svg(body: str, page: str = MM, ground: str = GROUND) -> Callable[[Path], None]:
    text = f'<?xml version="1.0" encoding="UTF-8"?>\n<svg {NAMES} {page}>\n{ground}{body}\n</svg>\n'
    return lambda path: path.write_text(text, encoding="utf-8") and None


def _scaled(factor: float) -> tuple[str, str]:
    """A stone of 1 × 0.5 on a support of 1 × 0.3, in units of 1 / factor."""
    one, half, low = 1.0 * factor, 0.5 * factor, 0.3 * factor
    stone = f'<rect x="0" y="{half}" width="{one}" height="{half}"/>'
    return stone, f'<g id="SUPPORTS"><rect x="0" y="{one}" width="{one}" height="{low}"/></g>'


LOW = '<rect x="0" y="500" width="1000" height="500"/>'


def files() -> list[File]:
    bodies: list[tuple[str, str, int, float, dict[str, Any]]] = [
        ("rects", LOW + '<rect x="0" y="0" width="1000" height="500"/>', 2, 1.0, {}),
        ("use", LOW + '<rect id="q" x="0" y="0" width="500" height="500"/><use xlink:href="#q" x="500"/>', 3, 1.0, {}),
        ("use_of_defs", '<defs><rect id="q" width="1000" height="500"/></defs><use href="#q" y="500"/>', 1, 0.5, {}),
        (
            "use_of_use",
            '<defs><rect id="q" width="500" height="500"/><g id="p"><use href="#q"/><use href="#q" x="500"/></g></defs>'
            '<use href="#p" y="500"/><use href="#p"/>',
            4,
            1.0,
            {},
        ),
        (
            "symbol",
            '<symbol id="s" viewBox="0 0 10 5"><rect width="10" height="5"/></symbol>'
            '<use href="#s" x="0" y="500" width="1000" height="500"/>',
            1,
            0.5,
            {},
        ),
        (
            "turned",
            '<rect transform="translate(0,1000) rotate(-90)" x="0" y="0" width="500" height="1000"/>',
            1,
            0.5,
            {},
        ),
        ("matrix", '<rect transform="matrix(2 0 0 -1 0 1000)" width="500" height="500"/>', 1, 0.5, {}),
        (
            "groups",
            '<g transform="translate(0,500)"><g transform="scale(10)"><rect width="100" height="50"/></g></g>',
            1,
            0.5,
            {},
        ),
        ("polygon", '<polygon points="0,1000 1000,1000 500,500"/>', 1, 0.25, {}),
        ("path", '<path d="M0 1000h1000v-500h-1000z"/>', 1, 0.5, {}),
        ("path_relative", '<path d="m0,1000 1000,0 0,-500 -1000,0 z m 0,-500 1000,0 0,-500 -1000,0 z"/>', 2, 1.0, {}),
        ("arc", '<path d="M0 1000 A500 500 0 0 1 1000 1000 Z"/>', 1, math.pi / 8, {}),
        ("bezier", '<path d="M0 1000 C0 500 1000 500 1000 1000 Z"/>', 1, 0.3, {}),
        ("hidden", LOW + '<rect visibility="hidden" width="1000" height="500"/>', 1, 0.5, {}),
        ("hidden_by_style", LOW + '<g style="visibility:hidden"><rect width="1000" height="500"/></g>', 1, 0.5, {}),
        ("not_displayed", LOW + '<g style="display:none"><rect width="1000" height="500"/></g>', 1, 0.5, {}),
        ("layers", '<g inkscape:groupmode="layer" inkscape:label="Mauer">' + LOW + "</g>", 1, 0.5, {}),
        ("frame", LOW + '<g id="Rahmen"><rect x="-500" y="-500" width="2000" height="2000"/></g>', 1, 0.5, {}),
        ("window", LOW + '<g id="Fenster"><rect x="400" y="600" width="200" height="200"/></g>', 2, 0.46, {}),
        ("skip", LOW + '<g id="old"><rect width="1000" height="500"/></g>', 1, 0.5, {"skip": ("old",)}),
    ]
    found = [File(f"{n}.svg", "Inkscape", svg(body), c, area, "mm", how) for n, body, c, area, how in bodies]
    clip = '<clipPath id="c"><rect width="10" height="10"/></clipPath><g clip-path="url(#c)">' + LOW + "</g>"
    found.append(File("clip_path.svg", "Inkscape", svg(clip), 1, 0.5, "mm", doubtful="clip path"))
    pages: list[tuple[str, str, float, str]] = [
        ("page_cm", 'width="200cm" height="200cm" viewBox="0 0 2000 2000"', 1000.0, "cm"),
        ("page_cm_without_box", 'width="200cm" height="200cm"', 96 / 0.0254, "cm"),
        ("page_mm_without_box", 'width="2000mm" height="2000mm"', 96 / 0.0254, "mm"),
        ("page_in", 'width="80in" height="80in" viewBox="0 0 80 80"', 1 / 0.0254, "in"),
        ("page_pt", 'width="5669.3pt" height="5669.3pt" viewBox="0 0 5669.3 5669.3"', 72 / 0.0254, "mm"),
        ("page_pc", 'width="472.44pc" height="472.44pc" viewBox="0 0 2000 2000"', 1000.0, "mm"),
        ("page_meet", 'width="2000mm" height="4000mm" viewBox="0 0 2000 2000"', 1000.0, "mm"),
        (
            "page_slice",
            'width="1000mm" height="2000mm" viewBox="0 0 2000 2000" preserveAspectRatio="xMinYMin slice"',
            1000.0,
            "mm",
        ),
        ("page_by_width", 'width="2000mm" viewBox="0 0 2000 2000"', 1000.0, "mm"),
        ("page_metres", 'viewBox="0 0 2 2"', 1.0, "m"),
    ]
    for name, page, factor, unit in pages:
        stone, ground = _scaled(factor)
        program = "Illustrator" if "pt" in name else "Inkscape"
        found.append(File(f"{name}.svg", program, svg(stone, page, ground), 1, 0.5, unit))
    stone, ground = _scaled(1000.0)
    uneven = 'width="4000mm" height="2000mm" viewBox="0 0 2000 2000" preserveAspectRatio="none"'
    found.append(File("page_uneven.svg", "Inkscape", svg(stone, uneven, ground), 1, 1.0, "mm"))
    px = 'width="2000px" height="2000px" viewBox="0 0 2000 2000"'
    found.append(File("page_px.svg", "Illustrator", svg(stone, px, ground), 1, 5e5, doubtful="--unit mm"))
    bomb = "".join(f'<g id="b{k}">' + f'<use href="#b{k - 1}"/>' * 10 + "</g>" for k in range(1, 10))
    found.append(File("bomb.svg", "nobody", svg(f'<g id="b0">{LOW}</g>{bomb}'), refused="expands to"))
    rows = "id;x;y;layer\n" + "".join(
        f"{name};{x};{y};{layer}\n"
        for name, y0, layer in (("a", 0.0, "SUPPORT"), ("b", 0.5, "STONE"), ("c", 1.0, "STONE"))
        for x, y in ((0, y0), (1, y0), (1, y0 + 0.5), (0, y0 + 0.5))
    )
    found.append(File("table.csv", "Excel", lambda path: path.write_text(rows) and None, 2, 1.0))
    return found
