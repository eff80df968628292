"""Which label a face has: the interface's, else of the lists, the default, or its place; glued supports are said."""

from __future__ import annotations

from typing import Any

import pytest

from jld_core import build_assembly, parse_scene, solve

Document = dict[str, Any]


def stack(labels: Document, interface: str | None = None) -> Document:
    """Two blocks of weight 1000 N on a support, pushed at the lower one."""
    document: Document = {
        "elements": [
            {"id": "S", "polygon": [[0, 0], [2, 0], [2, 0.5], [0, 0.5]], "support": True},
            {"id": "B", "polygon": [[0.5, 0.5], [1.5, 0.5], [1.5, 1], [0.5, 1]], "weight": 1000},
            {"id": "C", "polygon": [[0.5, 1], [1.5, 1], [1.5, 1.5], [0.5, 1.5]], "weight": 1000},
        ],
        "materials": {
            "dry": {"friction_coefficient": 0.5},
            "inner": {"tensile_strength": 1e5, "shear_strength": 1e5},
        },
        "labels": labels,
        "loads": {"live": [{"element": "B", "force": [300, 0], "at": [1, 0.6]}]},
    }
    if interface is not None:
        lines = [(["S", "B"], [[0.5, 0.5], [1.5, 0.5]]), (["B", "C"], [[0.5, 1], [1.5, 1]])]
        document["interfaces"] = [{"elements": pair, "polygon": line} for pair, line in lines]
        document["interfaces"][0]["label"] = interface
    return document


@pytest.mark.parametrize(
    ("labels", "interface", "support", "between"),
    [
        ({}, None, True, True),
        ({"default": "inner"}, None, False, False),
        ({"default": "dry"}, None, True, True),
        ({"default": "inner", "inner": [["B", "S"]]}, None, False, False),
        ({"default": "inner", "dry": [["B", "C"]]}, None, False, True),
        ({"inner": [["S", "B"]]}, None, False, True),
        ({"default": "inner"}, "inner", False, False),
        ({"default": "inner", "inner": [["S", "B"]]}, "dry", True, False),
    ],
)
def test_labels_of_faces(labels: Document, interface: str | None, support: bool, between: bool) -> None:
    """True = dry, at the support and between the blocks; a note says where a default glues supports."""
    built = build_assembly(parse_scene(stack(labels, interface)))
    found = {built.pair(face): bool(dry) for face, dry in enumerate(built.labels)}
    assert found == {"S–B": support, "B–C": between}
    noted = labels.get("default") == "inner" and not support and "inner" not in labels and interface is None
    assert bool(built.notes) == noted


def test_a_support_that_is_named_dry_stays_a_joint() -> None:
    """A stack of 2000 N slides at 0.5 · 2000 / 300."""
    result = solve(build_assembly(parse_scene(stack({"default": "inner", "dry": [["S", "B"]]}))))
    assert result.load_factor == pytest.approx(0.5 * 2000 / 300, rel=1e-6)
