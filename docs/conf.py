"""Sphinx configuration: a short guide, and the reference built from the docstrings."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx

from jld_core import __version__

project = "jld"
author = "The jld developers"
release = version = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "_gallery"]
html_theme = "furo"
html_title = f"jld {release}"
# files of the gallery, which `make docs` makes first
html_extra_path = ["scene.schema.json", *(["_gallery"] if (Path(__file__).parent / "_gallery").is_dir() else [])]
html_show_sourcelink = False
html_copy_source = False

myst_heading_anchors = 3
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "exclude-members": "model_config"}
autodoc_type_aliases = {name: name for name in ("Bits", "Bools", "Floats", "Ints")}
python_use_unqualified_type_names = True
# the scene file of the contract holds comments and dots, as no JSON does
suppress_warnings = ["misc.highlighting_failure"]


def plain(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Docstrings are read as plain text with `code` between backticks, as they stand in the source.

    |V| is a magnitude, c_T a letter with an index and 2* a number: none of it is markup. Titles of sections become
    rubrics; the entries of a section are definition lists as they stand.
    """
    for number in range(1, len(lines)):
        if re.fullmatch(r"-{3,}", lines[number]) and re.fullmatch(r"[A-Z][a-z]+", lines[number - 1]):
            lines[number - 1], lines[number] = f".. rubric:: {lines[number - 1]}", ""
    for number, line in enumerate(lines):
        parts = re.split(r"`+([^`]+)`+", line)
        parts[::2] = [re.sub(r"([\\*|_])", r"\\\1", text) for text in parts[::2]]
        parts[1::2] = [f"``{code}``" for code in parts[1::2]]
        lines[number] = "".join(parts)


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", plain)
