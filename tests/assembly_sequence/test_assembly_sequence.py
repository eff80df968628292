"""How blocks are laid: cones of free directions, sweeps, groups, locks, and the props that stages need."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cases import dry_and_inner, grid_assembly
from cases_spatial import assembly as spatial_assembly
from cases_spatial import box
from jld_core import Assembly, LimitAnalysis, build_assembly, parse_scene
from jld_practice.laying import assembly_order
from jld_practice.laying.order import locked_blocks


def names(assembly: Assembly, elements: tuple[int, ...]) -> list[str]:
    return [assembly.elements.ids[e] for e in elements]


def planar(elements: list[dict[str, Any]], **keys: Any) -> Assembly:
    scene = {
        "elements": elements,
        "materials": dry_and_inner(2000, 0.65, 1e6, 1e6),
        "loads": {"live": [{"body": [1, 0]}]},
        **keys,
    }
    return build_assembly(parse_scene(scene))


def test_a_pile_is_laid_from_the_ground() -> None:
    assembly = grid_assembly(["a", "b", "c", "#"])
    found = assembly_order(assembly, assembly.labels)
    assert [names(assembly, (int(found.blocks.elements(s.blocks[0])[0]),))[0] for s in found.steps] == [
        "c0r2",
        "c0r1",
        "c0r0",
    ]
    assert found.possible
    assert found.stands
    assert all(step.direction[1] > -1e-9 for step in found.steps)


DOVETAIL = {
    "base": [[0, 0], [4, 0], [4, 2], [2.5, 2], [3, 1], [1, 1], [1.5, 2], [0, 2]],
    "key": [[1, 1], [3, 1], [2.5, 2], [1.5, 2]],
}


def dovetail() -> Assembly:
    return planar(
        [
            {"id": "base", "polygon": DOVETAIL["base"], "support": True},
            {"id": "key", "polygon": DOVETAIL["key"]},
        ]
    )


def test_a_dovetail_locks_in_its_plane_and_slides_out_of_it() -> None:
    assembly = dovetail()
    assert names(assembly, locked_blocks(assembly, assembly.labels)) == ["key"]
    found = assembly_order(assembly, assembly.labels)
    assert not found.possible
    assert [found.blocks.name(block) for block in found.locked] == ["key"]
    beside = assembly_order(assembly, assembly.labels, sideways=True)
    assert beside.possible
    assert beside.steps[0].direction.tolist() == [0.0, 0.0, 1.0]


def test_a_dovetail_in_space_slides_along_its_groove() -> None:
    def prism(outline: list[list[float]]) -> dict[str, Any]:
        count = len(outline)
        front, back = [[x, 0.0, z] for x, z in outline], [[x, 1.0, z] for x, z in outline]
        sides = [[k, (k + 1) % count, count + (k + 1) % count, count + k] for k in range(count)]
        return {
            "vertices": front + back,
            "faces": [list(range(count))[::-1], list(range(count, 2 * count)), *[side[::-1] for side in sides]],
        }

    # the groove in three convex pieces of one support: nothing that is not convex is swept for its hull
    left = [[0, 0], [1, 1], [1.5, 2], [0, 2]]
    right = [[4, 0], [4, 2], [2.5, 2], [3, 1]]
    floor = [[0, 0], [4, 0], [3, 1], [1, 1]]
    elements = [{"id": n, **prism(o), "support": True} for n, o in (("l", left), ("r", right), ("f", floor))]
    elements.append({"id": "key", **prism(DOVETAIL["key"])})
    assembly = spatial_assembly(elements)
    found = assembly_order(assembly, assembly.labels)
    assert found.possible
    assert abs(found.steps[0].direction) == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)


def test_two_that_hold_one_another_leave_together() -> None:
    """A key in its dovetail, both loose on a slab: neither leaves the other, together they are lifted."""
    base = [[x, y + 1] for x, y in DOVETAIL["base"]]
    key = [[x, y + 1] for x, y in DOVETAIL["key"]]
    slab = [[0, 0], [4, 0], [4, 1], [0, 1]]
    assembly = planar(
        [
            {"id": "slab", "polygon": slab, "support": True},
            {"id": "base", "polygon": base},
            {"id": "key", "polygon": key},
        ]
    )
    # the key must go with the base: neither is free, whichever is asked first
    alone = assembly_order(assembly, assembly.labels, group=1)
    assert sorted(alone.blocks.name(k) for k in alone.locked) == ["base", "key"]
    together = assembly_order(assembly, assembly.labels, group=2)
    assert [len(step.blocks) for step in together.steps] == [2]


def test_a_block_may_be_free_at_first_and_meet_another_on_its_way_out() -> None:
    """Below a lid that does not touch it, between two posts: nothing touches it above, and it cannot leave."""
    posts = [[[0, 0], [1, 0], [1, 3], [0, 3]], [[2, 0], [3, 0], [3, 3], [2, 3]]]
    elements: list[dict[str, Any]] = [
        {"id": "floor", "polygon": [[0, -1], [3, -1], [3, 0], [0, 0]], "support": True},
        {"id": "lid", "polygon": [[0, 3], [3, 3], [3, 4], [0, 4]], "support": True},
        {"id": "block", "polygon": [[1, 0], [2, 0], [2, 1], [1, 1]]},
    ]
    elements += [{"id": f"post{k}", "polygon": post, "support": True} for k, post in enumerate(posts)]
    assembly = planar(elements)
    assert names(assembly, locked_blocks(assembly, assembly.labels)) == ["block"]
    without = planar([e for e in elements if e["id"] != "lid"])
    assert locked_blocks(without, without.labels) == ()
    # the same in space, where the sweep is of hulls
    solids = [
        box("floor", (0, 0, -1), (3, 1, 0), support=True),
        box("front", (1, -1, 0), (2, 0, 3), support=True),
        box("back", (1, 1, 0), (2, 2, 3), support=True),
        box("left", (0, 0, 0), (1, 1, 3), support=True),
        box("right", (2, 0, 0), (3, 1, 3), support=True),
        box("block", (1, 0, 0), (2, 1, 1)),
    ]
    pit = spatial_assembly(solids)
    assert locked_blocks(pit, pit.labels) == ()
    covered = spatial_assembly([*solids, box("lid", (0, 0, 3), (3, 1, 4), support=True)])
    assert names(covered, locked_blocks(covered, covered.labels)) == ["block"]


def test_the_prop_of_an_overhang() -> None:
    """Weight W, width b, resting on a: W (b/2 − a) = p (b − a) about the edge, by moments."""
    a, b = 0.3, 1.0
    assembly = planar(
        [
            {"id": "base", "polygon": [[0, 0], [a, 0], [a, 1], [0, 1]], "support": True},
            {"id": "slab", "polygon": [[0, 1], [b, 1], [b, 1.2], [0, 1.2]]},
        ]
    )
    (step,) = assembly_order(assembly, assembly.labels).steps
    weight = 2000 * 9.81 * 0.2 * b
    assert step.stage.stands is False
    assert step.stage.props.sum() == pytest.approx(weight * (0.5 * b - a) / (b - a), rel=1e-6)


def test_an_arch_needs_centring_until_it_is_closed() -> None:
    rows = ["#aabcc#", "##...##"]
    assembly = grid_assembly(rows, friction=0.8)
    found = assembly_order(assembly, assembly.labels)
    assert found.possible
    for step in found.steps:
        laid = step.stage
        assert laid.error < 1e-6
    assert assembly_order(assembly, assembly.labels, wish="standing").searched == (found.stands is not True)


@pytest.mark.parametrize("seed", range(6))
def test_stages_agree_with_the_limit_analysis(seed: int) -> None:
    """The last stage is the structure itself: it stands without props where λ = 0 is proven admissible."""
    rng = np.random.default_rng(seed)
    assembly = grid_assembly(["aaa", "aaa", ".a.", "###"])
    labels = rng.random(len(assembly.interfaces)) < 0.6
    found = assembly_order(assembly, labels, sideways=True)
    result = LimitAnalysis(assembly).solve(labels)
    if found.steps and result.stands_at_zero is not None:
        assert found.steps[-1].stage.stands == result.stands_at_zero
