"""The scene file: its keys, how it is read, and what is said of a wrong one."""

from __future__ import annotations

from jld_core.scene.form import json_schema, key_tables
from jld_core.scene.reading import load_scene, parse_scene
from jld_core.scene.schema import BodyLoad, Contact, Dry, Element, Grid, Inner, Materials, PointLoad, Scene, Search

__all__ = [
    "BodyLoad",
    "Contact",
    "Dry",
    "Element",
    "Grid",
    "Inner",
    "Materials",
    "PointLoad",
    "Scene",
    "Search",
    "json_schema",
    "key_tables",
    "load_scene",
    "parse_scene",
]
