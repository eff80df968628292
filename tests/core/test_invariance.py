"""λ is a property of the structure: units, rotation, numbering and mirror leave it alone, to 1e-9 relative."""

from __future__ import annotations

from typing import Any

import pytest

from cases import as_elements, grid_document, in_units, mirrored, renumbered, rotated
from command import SCENES
from jld_core import Status, build_assembly, load_scene, parse_scene, solve

ARCH = grid_document(
    ["#aabbcc#", "#aaabcc#"], friction=0.6, live=[{"element": "c3r0", "force": [0, -1]}, {"body": [0.2, 0]}]
)
SCENES_TO_MOVE: dict[str, Any] = {
    "wall 1": load_scene(SCENES / "ferris_tinloi_1.json"),
    "wall 2": load_scene(SCENES / "ferris_tinloi_2.json"),
    "wall 4": load_scene(SCENES / "ferris_tinloi_4.json"),
    "beam": load_scene(SCENES / "flat_beam_arch.json"),
    "confined arch": parse_scene(ARCH),
}
MOVES = {
    "metres to millimetres": lambda d: in_units(d, 1e3, 1.0),
    "N to MN": lambda d: in_units(d, 1.0, 1e-6),
    "µN and km": lambda d: in_units(d, 1e-3, 1e6),
    "turned by 37.3°": lambda d: rotated(d, 37.3),
    "turned by 90° and moved far away": lambda d: rotated(d, 90.0, (1000.0, -500.0)),
    "turned by 201.7°": lambda d: rotated(d, 201.7, (0.3, 0.1)),
    "renumbered": lambda d: renumbered(d, 7),
    "mirrored": mirrored,
}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("move", MOVES)
@pytest.mark.parametrize("name", SCENES_TO_MOVE)
def test_load_factor_is_invariant(name: str, move: str) -> None:
    document = as_elements(SCENES_TO_MOVE[name])
    before = solve(build_assembly(parse_scene(document)))
    after = solve(build_assembly(parse_scene(MOVES[move](document))))
    assert before.status is after.status is Status.COLLAPSE
    assert after.load_factor == pytest.approx(before.load_factor, rel=1e-9)
    assert after.gap < 1e-7
