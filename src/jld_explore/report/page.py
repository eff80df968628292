"""Make a self-contained HTML page from modules, style and data of the front end.

The front end under `assets/` consists of plain modules that a browser runs unchanged.
`linked` joins them into one script, because browsers refuse imports in pages opened from disk.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import json
import re
from collections.abc import Mapping
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any, Final

from jld_core._version import __version__

_IMPORT: Final = re.compile(r'^import \{([^}]*)\} from "\./([\w./]+)";\n', re.M)
_STAR: Final = re.compile(r'^import \* as (\w+) from "\./([\w./]+)";\n', re.M)
_EXPORT: Final = re.compile(r"^export ((?:async )?(?:function|class|const) (\w+))", re.M)
_BUNDLE: Final = re.compile(r"export\{([^}]*)\};?\s*$")
_TOKEN: Final = re.compile(r"\{\{(\w+)\}\}")

PLANAR: Final = {"figures.js": "figures_planar.js"}
"""Modules replaced in pages of planar scenes, which need no WebGL."""


def asset(name: str, wing: str = "report") -> str:
    """Return the text of a front-end file.

    name: name of the file under `assets/`. wing: sub-package that holds it, "report" or "studio".
    """
    return _assets(wing).joinpath(name).read_text(encoding="utf-8")


def asset_names(wing: str = "report") -> list[str]:
    """List the front-end files that a browser loads.

    wing: sub-package that holds them, "report" or "studio". Result: modules and styles, and modules of vendors as
    "vendor/...", sorted.
    """
    own = [entry.name for entry in _assets(wing).iterdir() if entry.name.endswith((".js", ".css"))]
    vendor = _assets(wing).joinpath("vendor")
    theirs = [f"vendor/{entry.name}" for entry in vendor.iterdir()] if vendor.is_dir() else []
    return sorted([*own, *(name for name in theirs if name.endswith(".js"))])


def _assets(wing: str) -> Traversable:
    """Return the folder of front-end files of a sub-package."""
    return files(f"jld_explore.{wing}").joinpath("assets")


def linked(entry: str, instead: Mapping[str, str] | None = None) -> str:
    """Join a JavaScript module of the page and all its imports into one script.

    Imported modules come first, each in a scope of its own. entry: file name of the module. instead: replacements of
    modules by name. Raises ValueError for circular imports, and for text that would end the script element.
    """
    instead = instead or {}
    done: dict[str, str] = {}

    def visit(name: str, above: tuple[str, ...]) -> None:
        if name in above:
            raise ValueError(f"the modules {' → '.join((*above, name))} import one another in a circle")
        if name in done:
            return
        text = asset(name)
        for _, wanted in (*_IMPORT.findall(text), *_STAR.findall(text)):
            visit(instead.get(wanted, wanted), (*above, name))
        done[name] = _scoped(name, text, instead, last=name == entry)

    visit(entry, ())
    script = "const $modules = {};\n" + "".join(done.values())
    if "</script" in script.lower() or "<!--" in script:
        raise ValueError("a module contains text that would end its script")
    return script


def _scoped(name: str, text: str, instead: Mapping[str, str], last: bool) -> str:
    """Return a module as a block with its own scope, with imports and exports rewritten."""
    text = _IMPORT.sub(lambda m: f"const {{{m[1].replace(' as ', ': ')}}} = {_place(m[2], instead)};\n", text)
    text = _STAR.sub(lambda m: f"const {m[1]} = {_place(m[2], instead)};\n", text)
    bundle = _BUNDLE.search(text)
    if bundle:
        pairs = [pair.strip().split(" as ") for pair in bundle[1].split(",")]
        names = ", ".join(f"{pair[-1]}: {pair[0]}" for pair in pairs)
        text = text[: bundle.start()]
    else:
        names = ", ".join(found for _, found in _EXPORT.findall(text))
        text = _EXPORT.sub(r"\1", text)
    if last:
        return f"{{\n{text}}}\n"
    return f'$modules["{name}"] = (() => {{\n{text}\nreturn {{ {names} }};\n}})();\n'


def _place(name: str, instead: Mapping[str, str]) -> str:
    """Return the expression for an imported module."""
    return f'$modules["{instead.get(name, name)}"]'


def page(data: Mapping[str, Any]) -> str:
    """Return the self-contained HTML of a report page.

    data: data of the page, as `page_data` assembles them. The content security policy of the page admits only its own
    script and style, by their hashes.
    """
    script = linked("report.js", PLANAR if data["structure"]["dimension"] == 2 else None)
    style = asset("page.css")
    policy = (
        f"default-src 'none'; script-src '{_hash(script)}'; style-src '{_hash(style)}'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )
    return filled(
        asset("report.html"),
        {
            "policy": html.escape(policy, quote=False),
            "version": html.escape(__version__),
            "title": html.escape(str(data["title"])),
            "style": style,
            "data": packed(data),
            "script": script,
        },
    )


def packed(data: Mapping[str, Any]) -> str:
    """Return data as base64 of gzipped JSON, which is safe in HTML for any content.

    Raises ValueError for NaN and infinities.
    """
    text = json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return base64.b64encode(gzip.compress(text.encode("utf-8"), compresslevel=6, mtime=0)).decode("ascii")


def filled(template: str, parts: Mapping[str, str]) -> str:
    """Replace each {{name}} in a template by its part; parts are not expanded again.

    template: text with {{name}} tokens. parts: replacement of each token. Result: text with all tokens replaced. Raises
    KeyError if a token has no part.
    """
    return _TOKEN.sub(lambda found: parts[found[1]], template)


def _hash(text: str) -> str:
    """Return the SHA-256 of a text in the form of a content security policy."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
