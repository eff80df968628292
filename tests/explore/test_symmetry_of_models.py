"""Layouts are merged as mirror images only where the model that answers cannot tell them apart."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import pytest
from benchmarks.claims import Tally, symmetry

from cases import dry_and_inner
from jld_core import InputError, build_assembly, parse_scene
from jld_explore import explore, search_space

Document = dict[str, Any]
Change = Callable[[Document], None]


def lintel(cracks: Any = "faces", **more: Any) -> Document:
    """A lintel of 4 cells of 1 m on two supports under two equal forces."""
    return {
        "grid": {"cell": [1.0, 1.0], "rows": ["aaaa", "#..#"]},
        "materials": dry_and_inner(2000.0, 0.6, 1e5, 2e5),
        "loads": {
            "live": [{"element": f"c{k}r0", "force": [0, -1e3], "at": [x, 2.0]} for k, x in ((1, 1.35), (2, 2.65))]
        },
        "search": {"segmentation": False},
        "cracks": cracks,
        **more,
    }


def group_of(document: Document) -> int:
    """Number of symmetries, with the identity."""
    scene = parse_scene(document)
    return len(search_space(scene, build_assembly(scene)).group)


def widths(document: Document) -> None:
    for entry, width in zip(document["loads"]["live"], (0.8, 0.1), strict=True):
        entry["width"] = width


def equal_widths(document: Document) -> None:
    for entry in document["loads"]["live"]:
        entry["width"] = 0.4


def halves(document: Document) -> None:
    """The same resultant on a shorter part of the right cell."""
    parts = [([1.1, 1.9], 1e3), ([2.3, 2.7], 2e3)]
    document["loads"]["live"] = [
        {"face": {"along": [[x, 2.0] for x in ends]}, "pressure": value} for ends, value in parts
    ]


def slopes(document: Document) -> None:
    """Pressures that rise towards the middle, stated from left to right: their own mirror image."""
    parts = [([1.0, 2.0], [0.0, 1e3]), ([2.0, 3.0], [1e3, 0.0])]
    document["loads"]["live"] = [
        {"face": {"along": [[x, 2.0] for x in ends]}, "pressure": values} for ends, values in parts
    ]


def tie_on_one_side(document: Document) -> None:
    anchors = [{"element": "c0r0", "at": [0.25, 1.75]}, {"element": "c0r1", "at": [0.75, 0.5]}]
    document["members"] = [{"kind": "tie", "from": anchors[0], "to": anchors[1], "tension": 1e3}]


def ties(document: Document) -> None:
    tie_on_one_side(document)
    anchors = [{"element": "c3r0", "at": [3.75, 1.75]}, {"element": "c3r1", "at": [3.25, 0.5]}]
    document["members"].append({"kind": "tie", "from": anchors[0], "to": anchors[1], "tension": 1e3})


def one_load_varies(document: Document) -> None:
    document["loads"]["live"][0]["force"] = [0, {"mean": -1e3, "cov": 0.3, "kind": "normal"}]


def both_loads_vary(document: Document) -> None:
    for entry in document["loads"]["live"]:
        entry["force"] = {"mean": [0, -1e3], "cov": 0.3, "kind": "lognormal"}


def one_joint_varies(document: Document) -> None:
    """The mean friction of one joint is that of the others."""
    friction = {"mean": 0.6, "cov": 0.2, "kind": "normal"}
    document["materials"]["faces"] = [{"between": ["c0r0", "c1r0"], "dry": {"friction_coefficient": friction}}]


def all_joints_vary(document: Document) -> None:
    document["materials"]["dry"]["friction_coefficient"] = {"mean": 0.6, "cov": 0.2, "kind": "normal", "each": True}


def joint_beside_varying_ones(document: Document) -> None:
    all_joints_vary(document)
    document["materials"]["faces"] = [{"between": ["c0r0", "c1r0"], "dry": {"friction_coefficient": 0.6}}]


def cases(document: Document) -> None:
    """Two load cases that are each other's mirror image."""
    entries = document["loads"]["live"]
    document["loads"] = {"cases": [{"name": f"{k}", "live": [entry]} for k, entry in enumerate(entries)]}


def cases_of_other_widths(document: Document) -> None:
    widths(document)
    cases(document)


CELLS, FIELDS = {"kind": "cells", "cell": 0.5}, {"kind": "fields", "gap": 0.1}


@pytest.mark.parametrize(
    ("cracks", "change", "count"),
    [
        ("faces", widths, 2),
        (FIELDS, widths, 1),
        (FIELDS, equal_widths, 2),
        ("faces", halves, 2),
        (CELLS, halves, 1),
        (FIELDS, halves, 1),
        (CELLS, slopes, 2),
        (FIELDS, slopes, 2),
        ("faces", tie_on_one_side, 1),
        ("faces", ties, 2),
        (CELLS, ties, 2),
        ("faces", one_load_varies, 1),
        ("faces", both_loads_vary, 2),
        ("faces", one_joint_varies, 1),
        ("faces", all_joints_vary, 2),
        ("faces", joint_beside_varying_ones, 1),
        ("faces", cases, 2),
        (FIELDS, cases, 2),
        (FIELDS, cases_of_other_widths, 1),
    ],
)
def test_symmetry_is_that_of_the_model(cracks: Any, change: Change, count: int) -> None:
    document = copy.deepcopy(lintel(cracks))
    change(document)
    assert group_of(document) == count
    document["search"]["symmetry"] = "mirror-x"
    if count > 1:
        assert group_of(document) == 2
    else:
        with pytest.raises(InputError, match="the scene has no mirror-x symmetry: "):
            group_of(document)


def test_an_objective_of_the_user_is_asked_for_each_mirror_image() -> None:
    """The function sees the left end only; the right one is better where it says so."""

    def left_joint(evaluation: Any, assembly: Any, labels: Any) -> float:
        return evaluation.load_factor * (2.0 if labels[0] else 1.0)

    scene = parse_scene(lintel() | {"search": {"segmentation": False, "dry_faces": [1, 1]}})
    all_of_them = explore(scene, driver="enumeration", objective=left_joint, pictures=False)
    left_joint.symmetric = True  # type: ignore[attr-defined]
    merged = explore(scene, driver="enumeration", objective=left_joint, pictures=False)
    assert all_of_them.summary.evaluated == 3
    assert merged.summary.evaluated == 2


def test_merged_layouts_have_one_load_factor() -> None:
    """A share of `python -m benchmarks.claims symmetry`: cases by faces and cells."""
    tally = Tally(symmetry.CLAIM)
    assert [symmetry.case(seed, tally) for seed in (0, 1, 6, 40)] == [""] * 4
    assert tally.notes["cells: merged"] > 0
