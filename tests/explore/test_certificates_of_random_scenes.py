"""Members, limits and drivers together: `--certificate` ends in a certificate that verifies, or in one line."""

from __future__ import annotations

import random
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from cases import dry_and_inner
from jld_core import InputError, parse_scene
from jld_explore import explore
from jld_explore.verification import verify

CELL = 2000 * 9.81 * 0.4 * 0.3 * 0.2
LIMITS: dict[str, list[Any]] = {
    "block_cells": [[1, 2], [2, 3], [1, 3]],
    "block_weight": [[1.5 * CELL, None], [0, 3.2 * CELL]],
    "block_mass": [[1.5 * CELL / 9.81, None]],
    "block_extent": [[None, 0.85], [None, 1.3]],
    "dry_faces": [[1, 5], [2, None]],
    "candidates": ["all", "all+supports"],
    "segmentation": [False],
}
NARROWER: dict[str, list[Any]] = {
    "blocks": [[1, 3]],
    "shapes": [[1, 3]],
    "convex_blocks": [True],
    "saw_cuts": [[1, 30]],
    "sawn_length": [[None, 8.0]],
    "assemble": ["translation"],
}
DRIVERS = ("exact", "exact", "exact", "enumeration", "genetic")


def _document(seed: int) -> dict[str, Any]:
    """Return a wall of at most six cells with members, load cases and limits drawn at random."""
    draw = random.Random(seed)
    columns, rows = draw.choice([(2, 2), (2, 3), (3, 2), (1, 3)])
    grid = ["".join(draw.choice("abc") for _ in range(columns)) for _ in range(rows)] + ["#" * columns]
    free = [(c, r) for r in range(rows) for c in range(columns)]
    every = [*free, *((c, rows) for c in range(columns))]

    def end(place: tuple[int, int]) -> dict[str, Any]:
        """Return a point within a cell."""
        at = [(place[0] + draw.uniform(0.1, 0.9)) * 0.4, (rows - place[1] + draw.uniform(0.1, 0.9)) * 0.3]
        return {"element": f"c{place[0]}r{place[1]}", "at": at}

    members = []
    for _ in range(draw.choice([0, 1, 2])):
        first = draw.choice(free)
        second = draw.choice([one for one in every if one != first])
        member = {"kind": draw.choice(["tie", "tendon", "pin"]), "from": end(first), "to": end(second), "tension": 20.0}
        if member["kind"] == "pin":
            member |= {"compression": 20.0, "shear": 5.0}
        members.append(member)
    document: dict[str, Any] = {
        "name": f"random {seed}",
        "grid": {"cell": [0.4, 0.3], "thickness": 0.2, "rows": grid},
        "materials": dry_and_inner(2000, draw.choice([0.3, 0.6]), draw.choice([1e3, 5e3]), 4e3),
        "loads": {"live": [{"body": draw.choice([[1, 0], [0.5, -0.2]])}]},
        "search": {
            key: draw.choice(values)
            for share, limits in ((0.3, LIMITS), (0.1, NARROWER))
            for key, values in limits.items()
            if draw.random() < share
        },
    }
    if members:
        document["members"] = members
    if draw.random() < 0.25:
        cases = [("right", 1), ("left", -1)]
        document["loads"] = {"cases": [{"name": name, "live": [{"body": [x, 0]}]} for name, x in cases]}
    return document


@pytest.mark.parametrize("seed", [*range(12), *(pytest.param(k, marks=pytest.mark.long) for k in range(12, 150))])
def test_a_certificate_verifies_or_is_refused_in_one_line(seed: int, tmp_path: Path) -> None:
    path = tmp_path / "proof.jld"
    with suppress(InputError):  # one line by construction
        scene = parse_scene(_document(seed))
        done = explore(scene, driver=DRIVERS[seed % len(DRIVERS)], certificate=path, pictures=False, seconds=30)
        assert verify(path, scene).claim.bound >= done.summary.best


def test_a_pin_beside_a_lower_limit_on_blocks(tmp_path: Path) -> None:
    """A member bounds no block: the rule that a block is too small speaks of faces alone."""
    document = _document(0)
    document["grid"]["rows"] = ["aa", "aa", "##"]
    document["search"] = {"block_weight": [1.5 * CELL, None]}
    document["loads"] = {"live": [{"body": [1, 0]}]}
    pin = {"kind": "pin", "tension": 5.0, "compression": 20.0, "shear": 5.0}
    ends = {"from": {"element": "c1r0", "at": [0.6, 0.7]}, "to": {"element": "c1r1", "at": [0.6, 0.5]}}
    document["members"] = [{**pin, **ends}]
    path = tmp_path / "proof.jld"
    done = explore(parse_scene(document), driver="exact", certificate=path, pictures=False)
    assert verify(path).claim.bound >= done.summary.best
