"""What `--json` prints is enough to check a result by: forces in the frames of the faces balance the loads."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cases import assembly_in_space as spatial_assembly
from cases import box, grid_document
from jld_core import Assembly, build_assembly, parse_scene, solve


def planar() -> Assembly:
    return build_assembly(parse_scene(grid_document(["aab", "cbb", "###"])))


def spatial() -> Assembly:
    return spatial_assembly(
        [
            box("base", (0, 0, -1), (2, 2, 0), support=True),
            box("one", (0, 0, 0), (1, 1, 1)),
            box("two", (0, 0, 1), (1, 1, 2)),
        ]
    )


@pytest.mark.parametrize("make", [planar, spatial])
def test_forces_and_frames_balance_the_loads(make: object) -> None:
    assembly = make()
    result = solve(assembly)
    found = json.loads(json.dumps(result.to_json()))
    assert [face["index"] for face in found["faces"]] == list(range(len(assembly.interfaces)))
    d = assembly.dimension
    total = {name: np.zeros(d) for name in assembly.elements.ids}
    for face, force in zip(found["faces"], found["forces"], strict=True):
        assert face["elements"] == force["elements"]
        assert face["label"] == force["label"]
        assert face["area" if d == 3 else "length"] > 0.0
        axes = [face["normal"], face["e1"]] if d == 2 else [face["normal"], face["e1"], face["e2"]]
        names = ("N", "V") if d == 2 else ("N", "V1", "V2")
        vector = sum(force[name] * np.array(axis) for name, axis in zip(names, axes, strict=True))
        total[face["elements"][1]] += vector
        total[face["elements"][0]] -= vector
    scale = assembly.total_dead
    for k in assembly.elements.free.tolist():
        load = assembly.dead[k, :d] + found["bracket"][0] * assembly.live[k, :d]
        assert total[assembly.elements.ids[k]] + load == pytest.approx(np.zeros(d), abs=1e-6 * scale)
