"""The outline of a design that is a scene: its loads stay on the parts that carry them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jld_core import InputError
from jld_practice.design.options import DesignOptions
from jld_practice.design.outline import read_outline


def outline(rows: list[str], live: list[dict[str, Any]], path: Path, **more: Any) -> dict[str, Any]:
    document = {
        "grid": {"cell": [1.0, 1.0], "thickness": 1.0, "rows": rows},
        "materials": {"density": 2000, "dry": {"friction_coefficient": 0.6}},
        "loads": {"live": live},
        **more,
    }
    path.write_text(json.dumps(document), encoding="utf-8")
    return read_outline(path, DesignOptions()).scene.model_dump(mode="json", exclude_defaults=True)


@pytest.mark.parametrize("at", [[3.0, 2.5], [1.5, 3.0], [5.0, 3.0], None])
@pytest.mark.parametrize("column", [1, 4])
def test_a_load_stays_on_the_outline_of_its_element(column: int, at: list[float] | None, tmp_path: Path) -> None:
    """Two piers: a force may act half way between them, or even within the other one."""
    load = {"element": f"c{column}r0", "force": [0, -1e3]}
    document = outline(
        ["aa..bb", "aa..bb", "######"], [load if at is None else {**load, "at": at}], tmp_path / "s.json"
    )
    loaded = document["loads"]["live"][0]["element"]
    (polygon,) = (entry["polygon"] for entry in document["elements"] if entry["id"] == loaded)
    low, high = np.min(polygon, axis=0)[0], np.max(polygon, axis=0)[0]
    assert low < column + 0.5 < high


@pytest.mark.parametrize(
    ("live", "more", "where"),
    [
        ({"face": {"between": ["c1r0", "outside"]}, "pressure": 1e3}, {}, "loads"),
        (
            {"body": [1, 0]},
            {
                "members": [
                    {
                        "kind": "tie",
                        "from": {"element": "c0r0", "at": [0.5, 2.5]},
                        "to": {"element": "c1r0", "at": [1.5, 2.5]},
                        "tension": 1e3,
                    }
                ]
            },
            "members",
        ),
    ],
)
def test_what_names_cells_of_an_outline_is_refused(live: Any, more: Any, where: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="become one outline") as complaint:
        outline(["aa", "##"], [live], tmp_path / "s.json", **more)
    assert complaint.value.where.endswith(where)
