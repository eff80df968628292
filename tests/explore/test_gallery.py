"""The gallery of the documentation: scenes come from their drawings, and links of the website lead somewhere."""

from __future__ import annotations

import html
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from tools.gallery import ENTRIES, PAGE, files_of, page_text, write_entry

from command import ROOT
from jld_core import load_scene, solve

SMALL = 1_300_000  # bytes of the files of one structure; pages in space hold 0.6 MB of drawing code


def test_the_page_is_current_and_names_ten_structures() -> None:
    assert PAGE.read_text("utf-8") == page_text()
    assert len({entry.name for entry in ENTRIES}) == 10
    assert sum(entry.drawing in ("3dm", "ifc") for entry in ENTRIES) >= 3


def made(name: str, folder: Path) -> None:
    """Write the files of one structure; λ of the scene read from its drawing is that of the given one."""
    (entry,) = (one for one in ENTRIES if one.name == name)
    place = folder / "gallery" / name
    write_entry(entry, place)
    assert {path.name for path in place.iterdir()} == set(files_of(entry).values())
    assert sum(path.stat().st_size for path in place.iterdir()) < SMALL
    given, read = solve(entry.make()), solve(load_scene(place / "scene.json"))
    assert read.load_factor == pytest.approx(given.load_factor, rel=1e-6)
    assert read.bracket[0] <= given.bracket[1] * (1.0 + 1e-7)
    assert given.bracket[0] <= read.bracket[1] * (1.0 + 1e-7)


def test_a_structure_of_the_gallery(tmp_path: Path) -> None:
    made("flat_arch", tmp_path)
    linked = re.findall(r'(?:href|src)="(gallery/flat_arch/[^"]+)"', page_text())
    assert len(set(linked)) == 5
    assert all((tmp_path / link).stat().st_size > 500 for link in linked)


def wrong_links(site: Path) -> list[str]:
    """Links of a website that lead nowhere, and what its pages would load from elsewhere."""
    wrong = []
    ids: dict[Path, set[str]] = {}
    pages = sorted(site.rglob("*.html"))
    for path in pages:
        text = re.sub(r"<(script|style)\b[^>]*>.*?</\1>", "", path.read_text("utf-8"), flags=re.S)
        ids[path.resolve()] = set(map(html.unescape, re.findall(r'\b(?:id|name)="([^"]+)"', text)))
    for path in pages:
        text = re.sub(r"(<script\b[^>]*>).*?</script>", r"\1", path.read_text("utf-8"), flags=re.S)
        for tag, kind, link in re.findall(r'<(\w+)\b[^>]*?\b(href|src)="([^"]*)"', text):
            parts = urlsplit(html.unescape(link))
            if parts.scheme in ("http", "https") or parts.netloc:
                if tag != "a":
                    wrong.append(f"{path.name}: {tag} {kind} loads {link}")
                continue
            if parts.scheme:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path.resolve()
            if not target.exists():
                wrong.append(f"{path.name}: {link} does not exist")
            elif parts.fragment and target in ids and unquote(parts.fragment) not in ids[target] | {""}:
                wrong.append(f"{path.name}: {link} has no such place")
    return wrong


def test_wrong_links_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(
        '<a href="b.html#here">1</a><a href="b.html#there">2</a><a href="c.html">3</a><img src="https://x.org/d.png">'
        '<a href="https://x.org">4</a>'
    )
    (tmp_path / "b.html").write_text('<p id="here">')
    assert wrong_links(tmp_path) == [
        "a.html: b.html#there has no such place",
        "a.html: c.html does not exist",
        "a.html: img src loads https://x.org/d.png",
    ]


@pytest.mark.long
def test_the_website_is_whole(tmp_path: Path) -> None:
    """As `make docs` builds it: all ten structures, no warning, no link that leads nowhere, nothing from elsewhere."""
    for entry in ENTRIES:
        made(entry.name, tmp_path / "files")
    site = tmp_path / "site"
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    extra = f"html_extra_path=scene.schema.json,{tmp_path / 'files'}"
    done = subprocess.run(
        [*command, "-D", extra, "-d", str(tmp_path / "trees"), str(ROOT / "docs"), str(site)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert wrong_links(site) == []
