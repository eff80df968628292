"""Small scenes whose pages the tests look at."""

from __future__ import annotations

from typing import Any

from cases import dry_and_inner

HOSTILE = "<script>document.title='broken'</script> & \"$\\frac{1}{2}$\" </script><img src=x onerror=alert(1)>"
"""A name that a careless page would run."""


def small_scene(name: str = "two courses", rows: list[str] | None = None) -> dict[str, Any]:
    """Four cells on a base, pushed sideways and from above: some forty layouts, searched in a moment."""
    return {
        "name": name,
        "grid": {"cell": [0.4, 0.2], "thickness": 0.2, "rows": rows or ["abb", "ccd", "###"]},
        "materials": dry_and_inner(2000, 0.65, 2e4, 2e4),
        "loads": {"live": [{"body": [1, 0]}, {"element": "c1r0", "force": [0, -100], "at": [0.6, 0.4]}]},
    }


def cube(name: str, x: float, z: float, wide: float = 1.0, **more: Any) -> dict[str, Any]:
    """A box of height 1 at a place."""
    corners = [[x + i * wide, j, z + k] for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return {"id": name, "vertices": corners, "faces": faces, **more}


def spatial_scene(name: str = "four cubes") -> dict[str, Any]:
    """Four cubes on a slab, pushed sideways."""
    return {
        "name": name,
        "elements": [
            cube("slab", -0.5, -1.0, 3.0, support=True),
            cube("a", 0.0, 0.0),
            cube("b", 1.0, 0.0),
            cube("c", 0.0, 1.0),
            cube("d", 1.0, 1.0),
        ],
        "materials": dry_and_inner(2000, 0.5, 2e4, 2e4),
        "loads": {"live": [{"body": [1, 0, 0]}]},
    }


def scene_of_cases(name: str = "two courses, two winds") -> dict[str, Any]:
    """The small scene pushed to the right, of which twice as much is required, and to the left."""
    scene = small_scene(name)
    right, left = [{"body": [1, 0]}], [{"body": [-1, 0]}]
    scene["loads"] = {
        "cases": [{"name": "right", "live": right, "required": 2.0}, {"name": "<b>left</b>", "live": left}]
    }
    return scene
