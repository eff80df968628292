"""The compiled solver of many cone programs: closed forms, Clarabel, and answers that do not depend on company."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from cases import grid_assembly
from jld_core import Assembly, Bits
from jld_core.batch import chosen
from jld_core.fields import ConeProgram, ConeSizes
from jld_core.fields import bounds as field_bounds

compiled = pytest.mark.skipif(chosen() is None, reason="no compiled solver")

PUSHED: list[dict[str, Any]] = [{"element": "c1r0", "force": [0.3, -1], "at": [0.15, 0.3]}]
KINDS: dict[str, dict[str, Any]] = {
    "plain": {},
    "friction": {"inner_friction": 0.4, "tension": 4e5},
    "crushing": {"crush_dry": 3e5, "crush_inner": 4e5},
    "cohesion": {"cohesion": 2e4},
}


def frame(**more: Any) -> Assembly:
    return grid_assembly(["aaa", "aaa", "#.#"], live=PUSHED, **{"tension": 2e6, "shear": 2e5, **more})


DISC = np.array([[0.0, 0, 1], [1, 0, 0], [0, 0, 0], [-1, 0, 0], [0, -1, 0]])


@pytest.fixture
def _alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Programs are solved by the compiled solver, none is handed over to Clarabel."""

    def handed_over(*_: object) -> Any:
        raise AssertionError("handed over to Clarabel")

    monkeypatch.setattr(ConeProgram, "_by_clarabel", handed_over)


def disc() -> ConeProgram:
    """Least a x + b y + c u where u = 1, x ≤ 1 and √(x² + y²) ≤ 2: rows are the equation, x ≤ 1, and the cone."""
    return ConeProgram(np.zeros(3), sp.csr_array(DISC), np.array([1.0, 1, 2, 0, 0]), ConeSizes(1, 1, 1), many=True)


@compiled
@pytest.mark.usefixtures("_alone")
def test_closed_form_with_rows_on_and_off() -> None:
    """Least value over a disc of radius 2 is −2 √(a² + b²); where it is cut at x = 1 and a < 0: a − √3 |b|."""
    costs = np.array([[-3.0, 0.5, 7.0], [-3.0, 0.5, 7.0], [3.0, 4.0, 0.0]])
    off = np.zeros((3, 5), dtype=bool)
    off[0, 1] = True
    found = disc().solve_all(off, costs)
    assert [one.status for one in found] == ["Solved"] * 3
    exact = [7.0 - 2.0 * np.hypot(3.0, 0.5), 7.0 - 3.0 - 0.5 * np.sqrt(3.0), -10.0]
    assert [one.objective for one in found] == pytest.approx(exact, abs=1e-7)
    assert found[1].point == pytest.approx([1.0, -np.sqrt(3.0), 1.0], abs=1e-6)
    # multipliers: q + A' z = 0
    assert costs + np.array([one.dual for one in found]) @ DISC == pytest.approx(np.zeros((3, 3)), abs=1e-7)


@compiled
@pytest.mark.usefixtures("_alone")
def test_unbounded_and_infeasible_programs_are_named() -> None:
    """Without the cone x decreases for ever, along a ray; x ≤ 1 and x ≥ 2 have no point in common."""
    off = np.array([False, False, True, True, True])
    found = disc().solve(off, np.array([1.0, 0.0, 0.0]))
    assert found.status == "DualInfeasible"
    assert found.point[0] < 0.0
    matrix, rhs = sp.csr_array(np.array([[1.0], [-1.0], [0], [1], [0]])), np.array([1.0, -2, 9, 0, 0])
    found = ConeProgram(np.ones(1), matrix, rhs, ConeSizes(0, 2, 1), many=True).solve(np.zeros(5, dtype=bool))
    assert found.status == "PrimalInfeasible"
    # Farkas: multipliers ≥ 0 with A' z = 0 and b z < 0
    assert abs(found.dual @ matrix.toarray()) <= 1e-7
    assert found.dual @ rhs < 0.0


@compiled
@pytest.mark.usefixtures("_alone")
def test_dependent_equations_are_left_out() -> None:
    """Of three equations in a plane two remain, whichever; the multiplier of the other is 0."""
    equations = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, 1.0], [1.0, 3.0, 1.0]])
    matrix = np.vstack([equations, np.zeros((1, 3)), -np.eye(3)[:2]])
    rhs, costs = np.array([1.0, 0.5, 1.5, 1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
    found = ConeProgram(costs, sp.csr_array(matrix), rhs, ConeSizes(3, 0, 1), many=True).solve(np.zeros(6, dtype=bool))
    # y = (1 − x)/2 on a disc of radius 1: x = −3/5
    assert (found.status, found.objective) == ("Solved", pytest.approx(-0.6, abs=1e-7))
    assert np.count_nonzero(found.dual[:3]) == 2
    assert costs + found.dual @ matrix == pytest.approx(np.zeros(3), abs=1e-7)


@compiled
@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", KINDS)
def test_same_bounds_as_clarabel(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both programs have one optimum each; what both solvers leave to repair is some 1e-7 of λ."""
    assembly = frame(**KINDS[kind])
    setting = field_bounds.FieldSetting.of(assembly)
    labellings = np.random.default_rng(5).random((11, len(assembly.interfaces))) < 0.5
    alone = field_bounds.CoarseBounds(setting, many=False)
    for found, bound in zip(
        field_bounds.CoarseBounds(setting).both(labellings), (alone.lower, alone.upper), strict=True
    ):
        expected = [bound(labels)[0] for labels in labellings]
        assert found == pytest.approx(expected, rel=2e-6, abs=1e-7 * setting.units.load)

    fields = field_bounds.Fields.on(setting, setting.coarse, labellings[0])

    # the programs themselves are solved, not handed over
    def handed_over(*_: object) -> Any:
        raise AssertionError("handed over to Clarabel")

    monkeypatch.setattr(ConeProgram, "_by_clarabel", handed_over)
    upper = type(fields.upper)(fields.problem, many=True)
    assert all(answer.status in ("Solved", "DualInfeasible") for answer in map(upper.propose, labellings))


def both(assembly: Assembly, labellings: Bits) -> list[list[float]]:
    low, high = field_bounds.CoarseBounds(field_bounds.FieldSetting.of(assembly)).both(labellings)
    return [low.tolist(), high.tolist()]


@compiled
def test_bounds_do_not_depend_on_company(monkeypatch: pytest.MonkeyPatch) -> None:
    """Together, alone and in another order: the same bits; by Clarabel alone: the same but for rounding."""
    assembly = frame()
    labellings = np.random.default_rng(7).random((13, len(assembly.interfaces))) < 0.5
    together = both(assembly, labellings)
    coarse = field_bounds.CoarseBounds(field_bounds.FieldSetting.of(assembly))
    assert together == [[coarse.lower(one)[0] for one in labellings], [coarse.upper(one)[0] for one in labellings]]
    assert together == [part[::-1] for part in both(assembly, labellings[::-1])]
    monkeypatch.setenv("JLD_KERNEL", "off")
    assert chosen() is None
    for found, expected in zip(both(assembly, labellings), together, strict=True):
        assert found == pytest.approx(expected, rel=2e-6, abs=1e-7 * 1e3)


# One field proves bounds of many labellings: against the bounds computed for each of them.


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", KINDS)
def test_one_field_bounds_other_labellings(kind: str) -> None:
    """Upper bounds of mechanisms lie above every lower bound, those of the own labelling are the certified ones."""
    assembly = frame(**KINDS[kind])
    coarse = field_bounds.CoarseBounds(field_bounds.FieldSetting.of(assembly))
    rng = np.random.default_rng(3)
    labellings = rng.random((14, len(assembly.interfaces))) < 0.5
    lows, highs, mechanisms, stresses = [], [], [], []
    for labels in labellings:
        low, field = coarse.lower(labels)
        high, mechanism = coarse.upper(labels)
        lows.append(low)
        highs.append(high)
        if mechanism is not None:
            own = float(mechanism.bounds(labels[None])[0])
            assert high * (1 - 1e-9) <= own <= high + 1e-3 * abs(high)
            mechanisms.append(mechanism)
        if field is not None:
            assert field.bounds(labels[None])[0] == low
            stresses.append(field)
    above = np.min([one.bounds(labellings) for one in mechanisms], axis=0)
    below = np.max([one.bounds(labellings) for one in stresses], axis=0)
    # both programs are solved to their optimum on this mesh, so that no other field of the mesh is better
    assert (above >= np.array(highs) - 1e-6 * np.abs(highs)).all()
    assert (below <= np.array(lows) + 1e-6 * np.abs(lows)).all()
    assert np.isfinite(above).all()
    # a field does speak of others than its own labelling
    assert sum(np.isfinite(one.bounds(labellings)).sum() for one in mechanisms) > 2 * len(mechanisms)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", KINDS)
def test_power_of_faces_is_that_of_the_certified_field(kind: str) -> None:
    """Each face weighed alone, against the power of the whole field computed under other labels."""
    assembly = frame(**KINDS[kind])
    setting = field_bounds.FieldSetting.of(assembly)
    rng = np.random.default_rng(5)
    labels = rng.random(len(assembly.interfaces)) < 0.4
    fields = field_bounds.Fields.on(setting, setting.coarse, labels)
    assert fields.velocity is not None
    mechanism = fields.for_all[1]
    assert mechanism is not None
    upper = fields.upper
    compared = 0
    for _ in range(12):
        other = rng.random(len(labels)) < 0.5
        bound = float(mechanism.bounds(other[None])[0])
        opened = upper.certify(fields.velocity.velocity, other)
        if np.isfinite(bound) and opened is not None:
            # certify moves the field, but never above what it was given, up to what opens still faces
            assert opened.factor * setting.units.load <= bound + 2e-3 * abs(bound)
            compared += 1
    assert compared >= 3


def test_a_face_that_may_be_dry() -> None:
    """A column pressed down: joints across it may be dry, glued cells beside one another by no stress at all."""
    assembly = grid_assembly(["ab", "ab", "##"], live=[{"body": [0, 1]}])
    labels = np.zeros(len(assembly.interfaces), dtype=bool)
    low, field = field_bounds.CoarseBounds(field_bounds.FieldSetting.of(assembly)).lower(labels)
    assert field is not None
    bed = np.array([abs(normal[1]) > 0.5 for normal in assembly.interfaces.normal])
    assert low > 1.0
    assert field.bounds(labels[None])[0] == low
    lifted = field.bounds((labels | bed)[None])[0]
    # lifted by more than its weight, no bed joint may be dry
    assert lifted == -np.inf
