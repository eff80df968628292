"""A share of the family `converged` of random scenes: brackets hold when weighed again, and few stay open."""

from __future__ import annotations

import pytest
from benchmarks.claims.converged import GROUPS, drawn, run, weighed

from jld_core import solve


def test_random_scenes_are_converged_and_hold_when_weighed_again() -> None:
    tally = run(12, 24, 600.0)
    assert tally.disagreements == []
    opened = {group: sum(n for name, n in tally.notes.items() if name.startswith(f"{group} unc")) for group in GROUPS}
    assert opened["space"] == 0
    assert opened["plane"] == 0


def test_weighing_tells_wrong_bounds() -> None:
    """A bracket that is moved, or forces that are, do not pass."""
    assembly, labels = drawn(4)
    result = solve(assembly, labels)
    assert weighed(assembly, labels, result, False) == ""
    low, high = result.bracket
    wrong = type(result)(**{**result.__dict__, "bracket": (low, 1.001 * high + 1e-3)})
    assert "upper end" in weighed(assembly, labels, wrong, False)
    assert result.forces is not None
    forces = type(result)(**{**result.__dict__, "forces": 1.01 * result.forces})
    assert "out of balance" in weighed(assembly, labels, forces, False)


@pytest.mark.parametrize("seed", [1690, 2152, 2725, 2869])
def test_crushing_faces_without_force(seed: int) -> None:
    """Forces of zero lie on the boundary of crushing's cones, away from their tips: at 0.2 these were uncertified."""
    assembly, labels = drawn(seed)
    result = solve(assembly, labels)
    assert str(result.status) == "collapse"
    assert weighed(assembly, labels, result, False) == ""


@pytest.mark.parametrize(("seed", "status"), [(31395, "locked"), (32469, "collapse"), (30156, "collapse")])
def test_stepped_joints_at_45_degrees(seed: int, status: str) -> None:
    """Uncertified at first: locked by forces that grow as λ², and upper bounds by a poor projection of the motion."""
    assembly, labels = drawn(seed)
    result = solve(assembly, labels)
    assert str(result.status) == status
    assert weighed(assembly, labels, result, False) == ""


def test_contacts_that_are_no_rectangles_are_weighed_by_their_hull() -> None:
    """A face of six corners counted as its bounding rectangle, turned into a false alarm."""
    assembly, labels = drawn(32295)
    assert not assembly.interfaces.rectangle.all()
    assert weighed(assembly, labels, solve(assembly, labels), False) == ""
