"""Files of the studio's own front end; the rest is the report's."""

from __future__ import annotations

from importlib.resources import files


def studio_asset(name: str) -> str:
    """Text of a file of the studio's front end."""
    return files("jld_explore.studio").joinpath("assets", name).read_text(encoding="utf-8")


def studio_asset_names() -> list[str]:
    """Its modules and styles."""
    root = files("jld_explore.studio").joinpath("assets")
    return sorted(entry.name for entry in root.iterdir() if entry.name.endswith((".js", ".css")))
