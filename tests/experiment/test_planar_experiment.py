"""The planar experiment against limit analysis under its own laws, closed forms, and an earlier engine."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from benchmarks.experiment import beam_arch, far_plateau
from scipy.spatial.transform import Rotation
from studies.scenes import leonardo_flat_arch, stacked_cubes

from cases import ROUTE, as_elements, grid_document, in_units, renumbered, rotated
from command import SCENES
from jld_core import Assembly, build_assembly, load_scene, parse_scene, solve
from jld_core.mechanics import equilibrium_matrix, load_vectors
from jld_experiment import (
    Curve,
    Joints,
    Push,
    Settings,
    Specimen,
    Standing,
    experiments,
    push,
    ramp,
    run_experiment,
    specimen_of,
)
from jld_experiment.experiment import scout

ASSOCIATIVE = Joints(dilation="friction", inner="plastic")
NO_DILATION = Joints(dilation=0.0, inner="plastic")
LIMIT = Settings(scheme="limit", gaps="plastic")
"""Limit analysis' own laws: its yield points, and gaps plastic like everything else."""


def wall(number: int) -> Assembly:
    return build_assembly(load_scene(SCENES / f"ferris_tinloi_{number}.json"))


def pushed(specimen: Specimen, scale: float, periods: float) -> Push:
    """A push of given slowest periods in all, at one rate, over the length that is set."""
    settled, standing = specimen.settle()
    assert standing is Standing.RESTS
    return push(specimen, settled, scale, periods / specimen.settings.length, endless=True)


def plateau(found: Push) -> float:
    """Mean λ over the last quarter of the way."""
    return float(found.load_factor[found.distance > 0.75 * found.distance[-1]].mean())


@pytest.mark.sampled(2)
@pytest.mark.parametrize("joints", [ASSOCIATIVE, NO_DILATION])
@pytest.mark.parametrize(
    ("friction", "tension", "shear", "expected"),
    [(0.9, 1.0, 0.2, 0.2), (0.27, 1.0, 0.5, 0.27), (0.9, 0.0, 0.6, 1.0 / 3.0), (0.9, 3.0, 0.9, 0.5)],
    ids=["inner shear", "base sliding", "inner opening", "base rocking"],
)
def test_two_cubes(joints: Joints, friction: float, tension: float, shear: float, expected: float) -> None:
    """Paper 3.2b: λ = min(μ, 1/2, τA/W, (1 + σtA/W)/3), whatever the dilation."""
    assembly = build_assembly(stacked_cubes(2, friction=friction, tension=tension, shear=shear))
    settings = Settings(scheme="limit", gaps="plastic", length=8.0, hasten=100.0)
    found = pushed(specimen_of(assembly, assembly.labels, joints, settings), expected, 1000.0)
    assert plateau(found) == pytest.approx(expected, rel=5e-4)
    assert found.load_factor.max() == pytest.approx(expected, rel=3e-3)


@pytest.mark.parametrize("tension", [0.2, pytest.param(0.4, marks=pytest.mark.long)])
def test_first_crack_of_an_elastic_face(tension: float) -> None:
    """Elastic edge stress of a rectangle, σ = N/A − 6M/(lA): two cubes crack at (1 + σtA/W)/3, with a slope of 1/reach
    before. Simpson's points integrate the linear stress exactly."""
    assembly = build_assembly(stacked_cubes(2, friction=0.9, tension=tension, shear=9.0))
    settings = Settings(scheme="simpson", segments=1, periods=150.0)
    curve = run_experiment(assembly, joints=Joints(), settings=settings)
    assert curve.stands
    assert curve.first_crack == pytest.approx((1.0 + tension) / 3.0, rel=5e-3)
    # at the edge of the dry base p = 2W(1 − 6λ) slips first, at λ = 0.14
    elastic = (curve.load_factor > 0.03) & (curve.load_factor < 0.13)
    # a record's λ is that of its middle
    middle = curve.distance - 0.5 * np.diff(curve.distance, prepend=0.0)
    slope = np.polyfit(middle[elastic], curve.load_factor[elastic], 1)[0]
    assert slope * curve.reach == pytest.approx(1.0, rel=5e-3)


def test_reach_of_a_block_on_springs() -> None:
    """One block b × h on an elastic base: live·u/λ = W² (1/(ks b) + (h/2)² / (kn b³/12)) at unit thickness."""
    wide, high = 1.2, 0.7
    scene = parse_scene(
        {
            "elements": [
                {"id": "block", "polygon": [[0, 0], [wide, 0], [wide, high], [0, high]], "weight": 3.0},
                {"id": "base", "polygon": [[0, -1], [wide, -1], [wide, 0], [0, 0]], "support": True},
            ],
            "materials": {"dry": {"friction_coefficient": 0.5}},
            "loads": {"live": [{"body": [1, 0]}]},
        }
    )
    assembly = build_assembly(scene)
    joints = Joints(normal_stiffness=7e3, shear_stiffness=2e3)
    specimen = specimen_of(assembly, assembly.labels, joints, Settings(scheme="simpson", segments=1))
    expected = 9.0 * (1.0 / (2e3 * wide) + (0.5 * high) ** 2 / (7e3 * wide**3 / 12.0))
    assert specimen.system.reach == pytest.approx(expected, rel=1e-12)
    settled, _ = specimen.settle()
    assert settled.moved[0, 1] == pytest.approx(-3.0 / (7e3 * wide), rel=1e-6)


@pytest.mark.parametrize(
    ("number", "expected", "tolerance", "length", "periods"),
    [
        (1, 0.6428590033, 3e-4, 30.0, 1000.0),
        pytest.param(2, 0.5799986113, 3e-4, 75.0, 1500.0, marks=pytest.mark.long),
        pytest.param(4, 0.3319483952, 5e-4, 24.0, 5000.0, marks=pytest.mark.long),
    ],
)
def test_walls_with_dilation(number: int, expected: float, tolerance: float, length: float, periods: float) -> None:
    """Ferris & Tin-Loi 2001: with limit analysis' own laws the plateau is its λ."""
    assembly = wall(number)
    settings = Settings(scheme="limit", gaps="plastic", length=length, hasten=1e9)
    found = pushed(specimen_of(assembly, assembly.labels, ASSOCIATIVE, settings), expected, periods)
    assert plateau(found) == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize(
    ("number", "expected", "length"), [(1, 0.6413, 10.0), pytest.param(4, 0.2638, 8.0, marks=pytest.mark.long)]
)
def test_walls_without_dilation(number: int, expected: float, length: float) -> None:
    """An earlier engine's end from gravity, at 20 000 periods; never above the associative λ (limit theorem)."""
    assembly = wall(number)
    settings = Settings(scheme="limit", length=length, hasten=1e9)
    found = pushed(specimen_of(assembly, assembly.labels, NO_DILATION, settings), expected, 1000.0)
    assert plateau(found) == pytest.approx(expected, abs=5e-4)
    assert found.load_factor.max() <= solve(assembly).load_factor * (1.0 + 2e-3)


FLAT_ARCH = [
    pytest.param("plastic", "friction", 2094.0, marks=pytest.mark.long),
    pytest.param("plastic", 0.0, 1444.8, marks=pytest.mark.long),
    ("brittle", "friction", 1588.0),
    pytest.param("brittle", 0.0, 1443.0, marks=pytest.mark.long),
]
"""An earlier engine, five points a face, geometry at rest, kn = ks; N per force. Faces that stay plastic hold longest,
and are tested on walls as well."""


@pytest.mark.parametrize(("inner", "dilation", "expected"), FLAT_ARCH)
def test_flat_arch(inner: str, dilation: float | str, expected: float) -> None:
    """Brittle peaks are as sharp as the records are short. The ramp, which demands rest at every step, agrees."""
    assembly = build_assembly(leonardo_flat_arch())
    joints = Joints(normal_stiffness=1e9, dilation=dilation, inner=inner)
    settings = Settings(periods=400.0, length=12.0, hasten=4.0)
    curve = run_experiment(assembly, joints=joints, settings=settings)
    assert curve.rates_agree
    assert curve.collapse_load == pytest.approx(expected, rel=3e-3)
    specimen = specimen_of(assembly, assembly.labels, joints, settings)
    settled, _ = specimen.settle()
    found = ramp(specimen, settled, expected, width=5e-3)
    assert found.rests * (1.0 - 5e-3) <= curve.collapse_load <= found.fails * (1.0 + 5e-3)


def test_static_proof_of_a_state_at_rest() -> None:
    """With the yield points of limit analysis a state at rest is a lower bound of the static theorem."""
    assembly = build_assembly(leonardo_flat_arch())
    exact = solve(assembly)
    specimen = specimen_of(assembly, assembly.labels, ASSOCIATIVE, LIMIT)
    settled, _ = specimen.settle()
    found = ramp(specimen, settled, exact.load_factor, first=0.3, width=5e-3)
    forces = specimen.resultants(found.state)
    dead, live = load_vectors(assembly)
    residual = equilibrium_matrix(assembly) @ forces.ravel() + dead + found.rests * live
    assert np.abs(residual).max() <= 1e-6 * found.rests
    assert outside(assembly, assembly.labels, forces) <= 1e-9 * found.rests
    assert 0.99 * exact.load_factor <= found.rests <= exact.load_factor * (1.0 + 1e-6)


def outside(assembly: Assembly, labels: np.ndarray, forces: np.ndarray) -> float:
    """Largest violation of METHOD's planar yield sets, written down anew: a force, or a moment over l/2."""
    n, v, m = forces.T
    arm = assembly.interfaces.l1 / 2.0
    area, strengths = assembly.interfaces.area, assembly.strengths(ROUTE)
    dry = np.maximum(abs(v) - strengths.friction * n, abs(m) / arm - n)
    inner = np.maximum(abs(v) - strengths.shear * area, abs(m) / arm - (n + strengths.tension * area) / 3.0)
    return float(np.where(labels, dry, inner).max())


@pytest.mark.long
def test_layouts_of_the_beam_arch() -> None:
    """Method's own laws give λ (70 of 70 layouts within 1e-3 in benchmarks/experiment.py), and nothing that is proven
    unstable settles under its own weight."""
    assembly, labellings = beam_arch()
    stood = fell = 0
    for labels in labellings[::641]:
        exact = solve(assembly, labels)
        if str(exact.status) == "unstable":
            specimen = specimen_of(assembly, labels, ASSOCIATIVE, LIMIT)
            assert specimen.settle()[1] is not Standing.RESTS
            fell += 1
        elif str(exact.status) == "collapse" and exact.load_factor > 0.2:
            assert far_plateau(assembly, labels, exact.load_factor) == pytest.approx(exact.load_factor, rel=1e-3)
            stood += 1
    assert stood >= 4
    assert fell >= 2


def test_weaker_when_cracks_are_brittle() -> None:
    """The strongest layout of the beam-arch keeps less than half of λ (an earlier engine: 5.78 of 12.62)."""
    scene = load_scene(SCENES / "flat_beam_arch.json")
    assembly = build_assembly(scene)
    curve = run_experiment(assembly, strongest(), joints=Joints(dilation="friction"))
    assert curve.rates_agree
    assert curve.collapse_load == pytest.approx(5.78, rel=1e-2)
    assert 0.0 < curve.cracked.max() <= 1.0


def strongest() -> np.ndarray:
    """The proven best layout of the beam-arch, as in docs/images/best.png."""
    return np.array([letter == "d" for letter in "iiidididddddiididdidiiid"])


def brittle(assembly: Assembly, joints: Joints | None = None) -> Curve:
    """Run a coarse experiment, three times as fast as by default: it is compared with others of its kind only."""
    joints = joints or Joints(inner="brittle", dilation=0.0)
    return run_experiment(assembly, joints=joints, settings=Settings(periods=50.0))


def test_repeats_are_equal_bit_by_bit() -> None:
    assembly = build_assembly(leonardo_flat_arch())
    one, two = brittle(assembly), brittle(assembly)
    assert np.array_equal(one.load_factor, two.load_factor)
    assert np.array_equal(one.at_end, two.at_end)


def test_invariance() -> None:
    """Stiffness × 100 at rest geometry, a turn, other units and another order change nothing beyond 1e-3."""
    scene = leonardo_flat_arch()
    document = as_elements(scene)
    base = brittle(build_assembly(parse_scene(document))).collapse_load
    stiff = Joints(inner="brittle", dilation=0.0, normal_stiffness=1e11)
    soft = Joints(inner="brittle", dilation=0.0, normal_stiffness=1e9)
    assembly = build_assembly(scene)
    assert brittle(assembly, stiff).collapse_load == pytest.approx(brittle(assembly, soft).collapse_load, rel=1e-3)
    turned = brittle(build_assembly(parse_scene(rotated(document, 37.0))))
    assert turned.collapse_load == pytest.approx(base, rel=1e-3)
    other = brittle(build_assembly(parse_scene(in_units(document, length=1e3, force=1e-6))))
    assert other.collapse_load == pytest.approx(base, rel=1e-3)
    mixed = brittle(build_assembly(parse_scene(renumbered(document, 5))))
    assert mixed.collapse_load == pytest.approx(base, rel=1e-3)


def test_a_locked_structure_has_no_collapse_load() -> None:
    """A cell between fixed supports is locked: no push ends, and no collapse load is made up."""
    scene = parse_scene(
        {
            "grid": {"cell": [1, 1], "rows": ["#a#", "###"]},
            "materials": {"density": 1, "gravity": 1, "dry": {"friction_coefficient": 0.5}},
            "loads": {"live": [{"body": [0, -1]}]},
        }
    )
    curve = run_experiment(build_assembly(scene))
    assert curve.stands
    assert curve.rising
    assert np.isnan(curve.collapse_load)
    assert not curve.rates_agree
    assert experiments.summary(curve, np.nan)["status"] == "locked"
    # a push of a structure with a proven λ that never ends says nothing
    assert experiments.summary(curve, 42.5)["status"] == "uncertified"


def test_a_layout_that_collapses_late_is_not_locked() -> None:
    """λ of this layout of the beam-arch is 5.351; it takes some 50 elastic displacements to reach it."""
    assembly = build_assembly(load_scene(SCENES / "flat_beam_arch.json"))
    labels = np.array([letter == "d" for letter in "iiiidiiiididddiddidiiiid"])
    specimen = specimen_of(assembly, labels, ASSOCIATIVE, Settings())
    settled, _ = specimen.settle()
    assert scout(specimen, settled) == pytest.approx(solve(assembly, labels).load_factor, rel=0.05)


def test_agreement_of_two_rates_is_not_called_accuracy() -> None:
    """A curve whose rates agree to 1e-5 may end 1 % below λ (seen with plastic, associative joints): it says so."""
    assembly = build_assembly(parse_scene(grid_document(["a", "#"], friction=0.6)))
    curve = run_experiment(assembly, joints=Joints(dilation="friction", inner="plastic"))
    facts = experiments.summary(curve, solve(assembly).load_factor)
    assert curve.rates_agree
    assert facts["rate_error"] < 5e-3
    assert facts["accuracy"] == 0.01
    assert abs(facts["ratio"] - 1.0) <= facts["accuracy"]


# The spatial experiment against closed forms, limit analysis and the planar experiment.


LIMIT_IN_SPACE = Settings(scheme="limit", gaps="plastic", periods=100.0)


TWO_CUBES = [(0.9, 3.0, 0.2), (0.25, 3.0, 0.6), (0.9, 0.0, 0.6), (0.9, 4.0, 0.9)]
"""Friction, tension and shear strength; each pair fails in another way."""


# all ways to fail in one direction askew, one of them in the other directions
@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("friction", "tension", "shear", "degrees"),
    [
        *((*each, 30.0) for each in TWO_CUBES),
        *((*TWO_CUBES[0], degrees) for degrees in (0.0, 45.0)),
        *(pytest.param(*each, degrees, marks=pytest.mark.long) for each in TWO_CUBES[1:] for degrees in (0.0, 45.0)),
    ],
)
def test_two_cubes_in_any_direction(friction: float, tension: float, shear: float, degrees: float) -> None:
    """The corners of a dry rectangle, and points at a third of them of an inner one, are the uncoupled yield sets of
    the paper as long as nothing twists: the experiment gives λ."""
    assembly = build_assembly(
        stacked_cubes(2, friction=friction, tension=tension, shear=shear, direction=float(np.radians(degrees)))
    )
    curve = run_experiment(assembly, joints=Joints(inner="plastic"), settings=LIMIT_IN_SPACE)
    assert curve.rates_agree
    assert curve.collapse_load == pytest.approx(solve(assembly).load_factor, rel=3e-3)


def prism(sides: int, live: dict[str, Any]) -> dict[str, Any]:
    """A regular prism of unit radius on a base of the same shape, weight 5, μ = 0.4."""
    turn = 2.0 * np.pi * np.arange(sides) / sides

    def solid(low: float, high: float) -> dict[str, Any]:
        ring = [[float(np.cos(a)), float(np.sin(a))] for a in turn]
        vertices = [[*p, low] for p in ring] + [[*p, high] for p in ring]
        walls = [[k, (k + 1) % sides, sides + (k + 1) % sides, sides + k] for k in range(sides)]
        return {"vertices": vertices, "faces": [[*range(sides)][::-1], [*range(sides, 2 * sides)], *walls]}

    return {
        "elements": [
            {"id": "prism", "weight": 5.0, **solid(0.0, 0.5)},
            {"id": "base", "support": True, **solid(-0.5, 0.0)},
        ],
        "materials": {"dry": {"friction_coefficient": 0.4}},
        "loads": {"live": [{"element": "prism", **live}]},
    }


@pytest.mark.parametrize("sides", [4, pytest.param(6, marks=pytest.mark.long)])
def test_torsion_of_a_prism(sides: int) -> None:
    """MT = μ N c_T under a pressure that stays even; polygons by a fan of triangles, rectangles by a product."""
    document = prism(sides, {"force": [0, 0, 0], "moment": [0, 0, 1]})
    assembly = build_assembly(parse_scene(document))
    settings = Settings(scheme="midpoint", segments=16, periods=60.0)
    curve = run_experiment(assembly, joints=Joints(inner="plastic"), settings=settings)
    faces = assembly.interfaces
    assert curve.collapse_load == pytest.approx(0.4 * 5.0 * float(faces.c_t[0]), rel=5e-3)


@pytest.mark.parametrize("scheme", ["trapezoid", "simpson", "midpoint", "limit"])
@pytest.mark.parametrize("sides", [3, 4, 5])
def test_sub_contacts_of_a_polygon(scheme: str, sides: int) -> None:
    """Areas are positive, add up, and leave the centroid where it is; Simpson's give the second moments exactly."""
    assembly = build_assembly(parse_scene(prism(sides, {"force": [1, 0, 0]})))
    points = specimen_of(assembly, assembly.labels, Joints(), Settings(scheme=scheme, segments=3)).points
    x1, x2, area = points.place.T
    assert area.min() > 0.0
    assert area.sum() == pytest.approx(assembly.interfaces.area[0], rel=1e-12)
    assert abs(x1 @ area) + abs(x2 @ area) < 1e-12
    exact = sides / 8.0 * np.sin(2 * np.pi / sides) * (2.0 + np.cos(2 * np.pi / sides)) / 3.0
    found = np.array([(x1 * x1) @ area, (x2 * x2) @ area])
    if scheme == "simpson":
        assert found == pytest.approx(exact, rel=1e-9)
    elif scheme != "limit":
        assert found == pytest.approx(exact, rel=0.25)


def turned(document: dict[str, Any], rotation: Rotation) -> dict[str, Any]:
    """The scene turned about the origin, with its loads."""
    changed = copy.deepcopy(document)
    for element in changed["elements"]:
        element["vertices"] = rotation.apply(np.array(element["vertices"])).tolist()
    changed["materials"]["gravity"] = rotation.apply([0.0, 0.0, -9.81]).tolist()
    for entry in changed["loads"]["live"]:
        for key in ("force", "moment"):
            if key in entry:
                entry[key] = rotation.apply(np.array(entry[key], dtype=float)).tolist()
    return changed


@pytest.mark.long
def test_invariance_to_a_turn_in_space() -> None:
    document = prism(6, {"force": [0.3, 0.1, 0.0], "moment": [0.0, 0.0, 0.6]})
    base = run_experiment(build_assembly(parse_scene(document)), joints=Joints(inner="plastic"))
    moved = turned(document, Rotation.from_rotvec([0.3, -1.1, 0.7]))
    other = run_experiment(build_assembly(parse_scene(moved)), joints=Joints(inner="plastic"))
    assert base.rates_agree
    assert other.collapse_load == pytest.approx(base.collapse_load, rel=1e-3)


def test_forces_at_rest_are_in_equilibrium() -> None:
    """The batch solver's resultants against the equilibrium of limit analysis, which is built elsewhere."""
    assembly = build_assembly(stacked_cubes(3, friction=0.5, tension=1.0, shear=0.5, direction=0.4))
    specimen = specimen_of(assembly, assembly.labels, Joints(inner="plastic"), Settings())
    settled, standing = specimen.settle()
    assert standing is Standing.RESTS
    factor = 0.1
    specimen.march(settled, round(20 * specimen.system.period), load_factor=(0.0, factor))
    assert specimen.rest(settled, factor) is Standing.RESTS
    dead, live = load_vectors(assembly)
    residual = equilibrium_matrix(assembly) @ specimen.resultants(settled).ravel() + dead + factor * live
    assert np.abs(residual).max() < 1e-6
