"""Yield surfaces as data: equal to the standard criterion, closed forms, proofs, certificates, refusals."""

from __future__ import annotations

import json
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from cases import box, four_columns, grid_document, space_of, wall_in_space
from cases import scene_in_space as scene
from command import Command, refused
from jld_core import LimitAnalysis, build_assembly, parse_scene, solve, solve_many
from jld_core.batch import chosen
from jld_core.mechanics import scaling_of, yield_set
from jld_explore import ExploreSettings, explore, sweep
from jld_explore.verification import Checker, certificate, verify

Document = dict[str, Any]

SQUARE = [[0, 0], [1, 0], [1, 1], [0, 1]]
TEE = [[0, 0], [1, 0], [1, 0.4], [0.6, 0.4], [0.6, 1], [0.4, 1], [0.4, 0.4], [0, 0.4]]
GROUND = box("s", [-3, -3, -1], [3, 3, 0], support=True)
PLANAR = grid_document(["abcd", "ab.d", "#..#"], tension=2e3, shear=3e3)
SPATIAL = scene(
    [box("s", [0, 0, -1], [2, 1, 0], support=True), box("a", [0, 0, 0], [1, 1, 1]), box("b", [1, 0, 0], [2, 1, 1.5])]
)


def with_surface(document: Document, label: str, **surface: Any) -> Document:
    changed = deepcopy(document)
    changed["materials"][label] = {"surface": surface}
    return changed


def as_surfaces(document: Document, cone: str = "elliptic") -> Document:
    """The standard criterion of both labels as yield surfaces."""
    dry, inner = (document["materials"][label] for label in ("dry", "inner"))
    bending = {name: inner[name] for name in ("tensile_strength", "compressive_strength") if name in inner}
    rough = {"coefficients": inner.get("friction_coefficient", 0.0), "cohesion": inner["shear_strength"]}
    slides = {"coefficients": dry["friction_coefficient"], "cohesion": dry.get("cohesion", 0.0)}
    found = with_surface(document, "inner", friction={**rough, "cone": cone}, bending={"within": "kern", **bending})
    return with_surface(found, "dry", friction={**slides, "cone": cone}, bending={"within": "edges"})


# --- the standard criterion --------------------------------------------------------------------------------


def drawn(seed: int) -> tuple[Document, np.random.Generator]:
    """A structure with random strengths, in the plane and in space by turns."""
    rng = np.random.default_rng(seed)
    strengths = [10 ** rng.uniform(2, 5) for _ in range(2)]
    if seed % 2:
        rows = ["".join(rng.choice(list("abc"), 4)) for _ in range(3)] + ["####"]
        document = grid_document(rows, tension=strengths[0], shear=strengths[1], friction=rng.uniform(0.2, 1.0))
    else:
        walls = wall_in_space(2, 2, 1)
        document = scene(walls, loads={"live": [{"body": [*rng.normal(size=2), 0.0]}]})
        document["materials"]["inner"] = dict(
            zip(("tensile_strength", "shear_strength"), (1e-4 * x for x in strengths), strict=True)
        )
    inner, dry = document["materials"]["inner"], document["materials"]["dry"]
    if rng.random() < 0.3:
        inner["compressive_strength"] = 20.0 * inner["tensile_strength"]
    if rng.random() < 0.3:
        dry["cohesion"] = 0.2 * inner["shear_strength"]
    if rng.random() < 0.3:
        inner["friction_coefficient"] = 0.5 * min(1.0, inner["shear_strength"] / inner["tensile_strength"])
    return document, rng


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", [*range(10), *(pytest.param(k, marks=pytest.mark.long) for k in range(10, 200))])
def test_the_standard_criterion_as_a_surface(seed: int) -> None:
    document, rng = drawn(seed)
    one, two = (build_assembly(parse_scene(each)) for each in (document, as_surfaces(document)))
    for labels in rng.random((2, len(one.interfaces))) < 0.5:
        expected, found = (solve(each, labels, gap=1e-11) for each in (one, two))
        wide = np.nan_to_num(np.ptp(found.bracket) + np.ptp(expected.bracket))  # what a conic solver leaves
        assert found.load_factor == pytest.approx(expected.load_factor, rel=1e-9, abs=1e-9 + wide, nan_ok=True)
        # of 400 labellings the widest bracket of either form is 1.3e-8, where the aim is 1e-6
        assert wide < 1e-7 * max(1.0, abs(np.nan_to_num(expected.load_factor)))


def test_points_of_dry_joints_beside_a_surface_of_inner_faces() -> None:
    """A surface that no face bears changes nothing, also where joints are points; one that a face bears is refused."""
    within = {"within": "kern"}
    changed = with_surface(SPATIAL, "inner", friction={"coefficients": 0.3, "cohesion": 1e3}, bending=within)
    found, plain = (solve(one, contact="concave") for one in (changed, SPATIAL))
    assert found.load_factor == pytest.approx(plain.load_factor, rel=1e-9)
    with refused(match='"surface" is unknown to contact at points'):
        solve(changed, "ddi", contact="concave")


def changed(document: Document, dry: dict[str, float], inner: dict[str, float]) -> Document:
    found: Document = json.loads(json.dumps(document))
    for label, values in (("dry", dry), ("inner", inner)):
        found["materials"][label].update(values)
    return found


@pytest.mark.parametrize("document", [PLANAR, SPATIAL], ids=["plane", "space"])
@pytest.mark.parametrize(
    ("dry", "inner"),
    [
        ({}, {}),
        ({"cohesion": 0.1}, {"friction_coefficient": 0.3}),
        ({"friction_coefficient": 0.0}, {"compressive_strength": 4.0}),
        ({}, {"tensile_strength": 0.0, "shear_strength": 0.0}),
    ],
    ids=["plain", "cohesion", "crushing", "no strength"],
)
def test_rows_state_the_standard_criterion(document: Document, dry: dict[str, float], inner: dict[str, float]) -> None:
    """Dissipation, margin, active resultants, and the signs of slacks, of random faces, jumps and forces."""
    stated = changed(document, dry, inner)
    scaling, rng = scaling_of(build_assembly(stated)), np.random.default_rng(7)
    closed, rows = (yield_set(build_assembly(one), scaling) for one in (stated, as_surfaces(stated)))
    shape = scaling.face.shape
    for _ in range(30):
        labels = rng.random(shape[0]) < 0.5
        jumps, forces = rng.normal(size=(2, *shape))
        jumps[:, 0] = 3.0 * rng.random(shape[0])
        forces[:, 0] = 4.0 * rng.random(shape[0]) - 0.5
        assert np.array_equal(rows.active(labels), closed.active(labels))
        assert np.array_equal(rows.recession_active(labels), closed.recession_active(labels))
        margin = closed.margin(jumps, labels)
        assert rows.margin(jumps, labels) == pytest.approx(margin, rel=1e-12, abs=1e-12)
        finite = margin >= 0.0
        expected = closed.dissipation(jumps, labels)[finite]
        assert rows.dissipation(jumps, labels)[finite] == pytest.approx(expected, rel=1e-12, abs=1e-12)
        one, other = rows.slack(forces, labels), closed.slack(forces, labels)
        clear = abs(other) > 1e-9
        assert np.array_equal(one[clear] > 0.0, other[clear] > 0.0)


@pytest.mark.skipif(chosen() is None, reason="no batch solver")
@pytest.mark.parametrize("document", [PLANAR, SPATIAL], ids=["plane", "space"])
def test_rows_of_the_standard_criterion_are_known_to_the_batch_solver(document: Document) -> None:
    analyses = [LimitAnalysis(build_assembly(one)) for one in (document, as_surfaces(document))]
    labels = np.random.default_rng(3).random((20, len(analyses[0].assembly.interfaces))) < 0.5
    known, found = (analysis.batch.solve(labels) for analysis in analyses)
    assert found.verdict.tolist() == known.verdict.tolist()
    for one, other in ((found, known), (known, found)):
        assert one.low == pytest.approx(other.low, rel=1e-7, nan_ok=True)
        assert (np.nan_to_num(one.low) <= np.nan_to_num(other.high, nan=np.inf) + 1e-12).all()


def test_a_surface_is_stated_in_units_and_by_pairs() -> None:
    """Faces of one pair have a surface of their own, texts have units, and rows are vertices and rays too."""
    whole = as_surfaces(PLANAR)
    parts = deepcopy(PLANAR)
    bending = {"within": "kern", "tensile_strength": "2 kPa"}
    own = {"surface": {"friction": {"coefficients": 0, "cohesion": "3 kN/m²"}, "bending": bending}}
    parts["materials"]["faces"] = [{"between": ["c0r0", "c0r1"], "inner": own}]
    third = {"symmetric": ["V", "M"], "vertices": [{"N": -1, "V": 1.5}], "rays": [{"N": 3, "M": 1}]}
    rows = {"symmetric": ["V", "M"], "rows": [{"N": -1, "M": 3, "most": 1}, {"V": 1, "most": 1.5}]}
    others = [with_surface(whole, "inner", reference_strength=2e3, **one) for one in (third, rows)]
    labels = np.arange(len(build_assembly(PLANAR).interfaces)) % 4 == 0
    first, *more = (solve(one, labels).load_factor for one in (PLANAR, parts, *others))
    assert more == pytest.approx([first] * 3, rel=1e-9)


# --- closed forms ------------------------------------------------------------------------------------------


def pushed(size: list[float], angle: float, **dry: Any) -> float:
    """λ of a block about the origin, pushed by a share of its weight at an angle."""
    half = np.array(size) / 2.0
    low, high = [-half[0], -half[1], 0.0], [half[0], half[1], size[2]]
    block = box("a", low, high)
    document = scene([GROUND, block], loads={"live": [{"body": [np.cos(angle), np.sin(angle), 0.0]}]})
    return float(solve(with_surface(document, "dry", bending={}, **dry)).load_factor)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("cone", ["elliptic", "product"])
@pytest.mark.parametrize("locks", [0.0, 0.3])
def test_sliding_on_grooves_in_any_direction(cone: str, locks: float) -> None:
    """λ = 1/√((cos/μ1)² + (sin/μ2)²); a product cone: the weaker of both, with c A/W along the locks."""
    first, second, grooves, height = 0.6, 0.35, 0.4, 0.01
    for angle in 2.0 * np.pi * np.arange(9) / 9:
        friction = {"coefficients": [first, second], "direction": [np.cos(grooves), np.sin(grooves), 0], "cone": cone}
        along, across = abs(np.cos(angle - grooves)), abs(np.sin(angle - grooves))
        expected = 1.0 / np.hypot(along / first, across / second)
        if cone == "product":
            friction["cohesion"] = [locks * height, 0.0]
            expected = min((first + locks) / along, second / across)
        assert pushed([2, 2, height], angle, friction=friction) == pytest.approx(expected, rel=1e-9)


def test_rocking_on_grooves_in_any_direction() -> None:
    """A tall block turns about an edge however rough: λ = min(b1/|cos|, b2/|sin|)/h."""
    rough = {"coefficients": [5.0, 3.0], "direction": [1, 2, 0]}
    for cone in ("elliptic", "product"):
        for angle in 0.1 + 2.0 * np.pi * np.arange(7) / 7:
            expected = min(0.8 / abs(np.cos(angle)), 0.5 / abs(np.sin(angle))) / 2.0
            found = pushed([0.8, 0.5, 2.0], angle, friction={**rough, "cone": cone})
            assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("cone", ["elliptic", "product"])
def test_kinds_of_mechanisms_on_grooves(cone: str) -> None:
    """Dilation along and across grooves is sliding, not opening; what is lifted opens."""
    friction = {"coefficients": [0.6, 0.35], "direction": [1, 0.3, 0], "cone": cone}
    flat = scene([GROUND, box("a", [-1, -1, 0], [1, 1, 0.01])], loads={"live": [{"body": [1.0, 0.0, 0.0]}]})
    flat = with_surface(flat, "dry", bending={}, friction=friction)
    table = sweep(flat, {"loads.angle": [0.0, 40.0, 100.0]})
    assert set(table["mechanism"]) == {"sliding at the base"}
    flat["loads"]["live"] = [{"body": [0.0, 0.0, 1.0]}]
    assert list(sweep(flat, {"materials.density": [1.0]})["mechanism"]) == ["opening"]


def torsion_of_a_square(side: float) -> float:
    """∫ r dA over a square, the plastic torsion of unit strength."""
    return side**3 * (np.sqrt(2.0) + np.log(1.0 + np.sqrt(2.0))) / 6.0


def test_shear_and_torsion_of_a_lock() -> None:
    """A square lock of cohesion c: V = c b², MT = 0.3826 c b³ (the printed coefficient), and a line between both."""
    side, cohesion, reach = 0.06, 3e5, 0.1
    assert torsion_of_a_square(1.0) == pytest.approx(0.3826, abs=5e-5)
    locked = {"cones": [{"shear": [1, 1], "torsion": 1, "capacity": cohesion}], "bending": {"tensile_strength": 1e9}}
    document = scene([GROUND, box("a", [0, 0, 0], [side, side, side])])
    for force, arm in ((0.0, 1.0), (1.0, 0.0), (1.0, reach)):
        turn = {"force": [force, 0, 0], "moment": [0, 0, arm], "at": [side / 2, side / 2, 0]}
        document["loads"]["live"] = [{"element": "a", **turn}]
        found = solve(with_surface(document, "dry", **locked)).load_factor
        share = force / (cohesion * side**2) + arm / (cohesion * torsion_of_a_square(side))
        assert found == pytest.approx(1.0 / share, rel=1e-8)


@pytest.mark.parametrize("space", [False, True])
def test_sliding_on_rock(space: bool) -> None:
    """At the stress of a tangent, τ = ½ √(m σc (n + σt)); elsewhere on that tangent."""
    strength, m, weight = 40.0, 8.0, 1.0 * 2.0
    tension = strength / m
    rock = {"compressive_strength": strength, "m": m, "points": [(weight + tension) / strength]}
    for more in (0.0, 3.0):
        n = weight + more
        tau = 0.5 * np.sqrt(m * strength * (weight + tension)) * (1.0 + 0.5 * more / (weight + tension))
        if space:
            document = scene([GROUND, box("a", [0, 0, 0], [1, 1, 0.02])], loads={"live": [{"body": [0.6, 0.8, 0.0]}]})
            document["materials"] = {"density": 1.0, "gravity": n / 0.02}
        else:
            document = grid_document(["a", "#"])
            document["grid"] |= {"cell": [1.0, 0.02], "thickness": 1.0}
            document["materials"] = {"density": 1.0, "gravity": n / 0.02}
        bending = {"bending": {"tensile_strength": 11.9}}
        found = solve(with_surface(document, "dry", hoek_brown=rock, **bending)).load_factor
        assert found == pytest.approx(tau / n, rel=1e-8)


def test_a_plastic_section() -> None:
    """A square section without an end of compression is bending at its edges with tension; m = (n + t)(c − n)/(c + t)
    holds at the vertices of one with an end; a tee bends one way as its mirror image bends the other."""
    block = grid_document(["a", "#"], tension=1.0, shear=1e6)
    area, weight, side = 0.01, 1400 * 9.81 * 1e-3, 0.1

    def lam(way: float, **section: Any) -> float:
        document = deepcopy(block)
        document["loads"] = {"live": [{"body": [way, 0.0]}]}
        given = with_surface(document, "inner", section={"shear_strength": 1e7, "tensile_strength": 2e4, **section})
        return float(solve(given, np.array([False])).load_factor)

    def of_moment(moment: float) -> float:
        return moment * area * side / 2.0 / (weight * side / 2.0)

    n = weight / area
    assert lam(1.0, polygons=[SQUARE]) == pytest.approx(of_moment(n + 2e4), rel=1e-9)
    steps, end = 20, 4e4
    curved = of_moment((n + 2e4) * (end - n) / (end + 2e4))
    inside = lam(1.0, polygons=[SQUARE], compressive_strength=end, steps=steps)
    assert curved * (1 - 1.0 / steps**2) <= inside <= curved * (1 + 1e-9)
    mirror = [[1 - x, y] for x, y in [[0, 0], [1, 0], [1, 0.2], [0.4, 1], [0, 1]]]
    lean = [[1 - x, y] for x, y in mirror]
    hollow = {"holes": [[[0.4, 0.4], [0.6, 0.4], [0.6, 0.6], [0.4, 0.6]]], "compressive_strength": end}
    assert lam(1.0, polygons=[lean], **hollow) == pytest.approx(lam(-1.0, polygons=[mirror[::-1]], **hollow), rel=1e-9)
    assert lam(1.0, polygons=[lean], **hollow) != pytest.approx(lam(-1.0, polygons=[lean], **hollow), rel=1e-3)


@pytest.mark.parametrize("space", [False, True])
def test_a_section_lies_where_its_direction_says(space: bool) -> None:
    """On the half of its base at −x a block turns about that end, pushed there, and about the middle, pushed away."""
    half = {"polygons": [[[0, 0], [0.5, 0], [0.5, 1], [0, 1]]], "shear_strength": 1e9}
    found = []
    for way in (-1.0, 1.0):
        for direction in ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]):
            if space:
                document = scene(
                    [GROUND, box("a", [-1, -0.5, 0], [1, 0.5, 1])], loads={"live": [{"body": [way, 0, 0]}]}
                )
            else:
                document = grid_document(["a", "#"], live=[{"body": [way, 0.0]}])
                direction = direction[:2]
            document["materials"]["gravity"] = 1.0
            given = with_surface(document, "dry", section={**half, "direction": direction})
            found.append(solve(given, np.array([True])).load_factor)
    edge = 2.0 if space else 1.0
    assert found == pytest.approx([edge, 0.0, 0.0, edge], rel=1e-9, abs=1e-7)


# --- sets of six resultants --------------------------------------------------------------------------------


def test_sets_of_six_resultants() -> None:
    """Dissipation by a linear program, rows of undecided faces enclose both labels, slack has the sign of the rows."""
    rng, labels = np.random.default_rng(5), np.array([[True], [False]])
    shear = {"coefficients": [0.6, 0.3], "cohesion": [0.5, 0.2], "direction": [1, 0.7, 0], "cone": "product"}
    rows = [{"V1": 1, "M2": 0.5, "most": 2}, {"V1": -1, "M2": -0.5, "most": 2}]
    document = with_surface(
        scene([GROUND, box("a", [0, 0, 0], [2, 1, 1])]), "dry", friction=shear, bending={}, rows=rows
    )
    assembly = build_assembly(parse_scene(document))
    sets = yield_set(assembly, scaling_of(assembly))
    C, d = sets.dry.C[0], sets.dry.d[0]
    pattern = sets.hull().pattern
    finite = 0
    for _ in range(60):
        jump = rng.normal(loc=(3.0, 0, 0, 0, 0, 0), size=(1, 6)) * [1, 0.3, 0.3, 1, 1, 0.3]
        margin = float(sets.margin(jump, labels[0])[0])
        program = linprog(jump[0], A_ub=-C, b_ub=d, bounds=[(None, None)] * 6)
        assert (program.status == 0) == (margin > 0.0)
        if program.status == 0:
            finite += 1
            assert sets.dissipation(jump, labels[0])[0] == pytest.approx(-program.fun, rel=1e-8, abs=1e-9)
        forces = rng.normal(size=(1, 6)) * [3, 1, 1, 1, 1, 1]
        assert (sets.slack(forces, labels[0])[0] >= 0.0) == (np.min(C @ forces[0] + d) >= 0.0)
        for label in labels:
            if sets.slack(forces, label)[0] >= 0.0:
                y = np.append(forces[0], 0.0)  # the bound on shear is free where rows limit it
                spare = pattern.h_dry - np.bincount(pattern.row, pattern.dry * y[pattern.column], len(pattern.h_dry))
                assert spare[: pattern.linear].min() >= -1e-9
    assert finite > 10


@pytest.mark.parametrize(("second", "way", "number"), [(0.6, 0, 8), (0.3, 0, 4), (0.3, 2, 2)])
def test_symmetries_of_grooves(second: float, way: float, number: int) -> None:
    """Turns by 90° map grooves alike both ways alone, mirrors those along or across them; half a turn all."""
    friction = {"coefficients": [0.6, second], "direction": [1, way, 0], "cone": "product"}
    assert len(space_of(four_columns({"surface": {"friction": friction, "bending": {}}})).group) == number


# --- searches and proofs -----------------------------------------------------------------------------------

GROOVED = with_surface(
    SPATIAL,
    "dry",
    friction={"coefficients": [0.7, 0.2], "cohesion": [0.3, 0.0], "direction": [1, 0.3, 0], "cone": "product"},
    bending={},
)
SURFACES = {
    "plane": as_surfaces(PLANAR),
    "grooves and locks": GROOVED,
    "ellipse": with_surface(
        SPATIAL, "dry", friction={"coefficients": [0.7, 0.2], "direction": [1, 0.3, 0]}, bending={}
    ),
    "tee": with_surface(
        PLANAR,
        "inner",
        section={"polygons": [TEE], "tensile_strength": 2e3, "compressive_strength": 3e4, "shear_strength": 3e3},
    ),
}


OF_PAIRS = deepcopy(PLANAR)
OF_PAIRS["materials"]["faces"] = [
    {"between": ["c0r0", "c0r1"], "dry": {"surface": {"friction": {"coefficients": 0.4}, "bending": {}}}}
]
ROCK = with_surface(SURFACES["ellipse"], "inner", hoek_brown={"compressive_strength": 40.0, "m": 10, "points": [0.1]})
ROUTES = {**SURFACES, "pairs": OF_PAIRS, "rock": with_surface(ROCK, "dry", **ROCK["materials"]["inner"]["surface"])}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ROUTES)
def test_many_labellings_are_as_each_alone(name: str) -> None:
    assembly = build_assembly(ROUTES[name])
    labels = np.random.default_rng(4).random((4, len(assembly.interfaces))) < 0.4
    found = solve_many(assembly, labels)
    for k, own in enumerate(labels):
        alone = solve(assembly, own)
        assert str(found.status[k]) == str(alone.status)
        assert found.load_factor[k] == pytest.approx(alone.load_factor, rel=2e-6, abs=1e-9, nan_ok=True)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["grooves and locks", "ellipse", "tee"])
def test_proofs_and_certificates(name: str, tmp_path: Path) -> None:
    document, certificate = SURFACES[name], tmp_path / "proof.jld"
    settings = ExploreSettings(check_fields=0, pictures=False, seconds=20)
    whole = explore(document, settings=replace(settings, driver="enumeration"))
    found = explore(document, tmp_path / "out", settings=replace(settings, driver="exact", certificate=certificate))
    assert found.summary.proven
    assert found.summary.best == pytest.approx(whole.summary.best, rel=1e-8)
    assert verify(certificate).claim.bound == pytest.approx(found.summary.best, rel=1e-5)
    best = whole.results.iloc[0]
    assert solve(document, best["labelling"]).load_factor == pytest.approx(whole.summary.best, rel=1e-8)


@pytest.mark.parametrize("name", ["ellipse", "grooves and locks", "tee"])
def test_certificates_weigh_the_dissipation_of_rows(name: str) -> None:
    """A block that moves on the ground: whole numbers against floats, and both infinite for the same motions."""
    document = deepcopy(SURFACES[name])
    if name == "tee":
        document["grid"]["rows"] = ["a", "#"]
    else:
        document["elements"] = document["elements"][:2]
    assembly = build_assembly(document)
    faces, elements, q = assembly.interfaces, assembly.elements, assembly.freedoms
    scaling, rng, free = scaling_of(assembly), np.random.default_rng(2), int(assembly.elements.free[0])
    checker = Checker(parse_scene(document), assembly, certificate.Claim(document, 1.0))
    sets, balances = yield_set(assembly, scaling), checker.balances[0]
    sign = 1.0 if faces.b[0] == free else -1.0
    axes = np.array([faces.normal[0], faces.e1[0], faces.e2[0]][: assembly.dimension])
    arm, label, finite = faces.origin[0] - elements.centroid[free], np.array([name != "tee"]), 0
    for _ in range(40):
        move = rng.integers(-(2**20), 2**20, q)
        move[: assembly.dimension] += (sign * 2**22 * axes[0]).astype(np.int64)
        u = move / 2**20
        if q == 3:
            jump = np.append(
                sign * axes @ (u[:2] + u[2] * np.array([-arm[1], arm[0]])), sign * u[2] * faces.l1[0] / 2.0
            )
        else:
            turn = sign * axes @ u[3:]
            sizes = [faces.l2[0] / 2.0, faces.l1[0] / 2.0, faces.c_t[0]]
            jump = np.append(sign * axes @ (u[:3] + np.cross(u[3:], arm)), turn[[1, 2, 0]] * sizes)
        told = balances.weigh({free: move.tolist()}, 20, {0: bool(label[0])})
        assert (told.spent is not None) == (sets.margin(jump[None], label)[0] >= 0.0)
        if told.spent is not None:
            finite += 1
            expected = float(sets.dissipation(jump[None], label)[0]) * scaling.force - assembly.dead[free] @ u
            assert float(told.spent) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert finite > 5


# --- refusals ----------------------------------------------------------------------------------------------

FRICTION = {"coefficients": 0.6}
GROOVES = {"coefficients": [0.6, 0.3]}
BAD: dict[str, tuple[str, Document, str]] = {
    "zero outside": ("plane", {"vertices": [{"N": 1, "M": m, "V": v} for m in (-1, 1) for v in (-1, 1)] + [{"N": 2}]},
                     "surface.vertices: no force at all lies outside of it; expected zero inside"),
    "negative": ("plane", {"rows": [{"N": -1, "most": -2}]}, r"surface.rows\[0\].most: -2 is wrong; expected a number"),
    "unbounded": ("plane", {"friction": FRICTION}, "leaves a force or moment without limit"),
    "falling": ("plane", {"friction": {"coefficients": 0}, "rows": [{"M": 1, "most": 1}, {"M": -1, "most": 1}]},
                "materials.dry.surface"),
    "beside": ("plane", {"friction": FRICTION, "bending": {}}, ".cohesion: it stands beside a yield surface"),
    "one face": ("plane", {"friction": FRICTION, "bending": {}}, "single strengths beside it; expected all strengths"),
    "nothing": ("plane", {"reference_strength": 2.0}, "surface: it states no limit"),
    "unknown": ("plane", {"frictoin": FRICTION}, 'surface.frictoin: unknown key; expected "friction"'),
    "no such": ("plane", {"rows": [{"V1": 1, "most": 1}]}, r"rows\[0\].V1: a 2D scene has none; expected N, V, M"),
    "flat": ("plane", {"vertices": [{"N": -1}, {"M": 1}]}, "vertices: they are flat"),
    "two in the plane": ("plane", {"friction": GROOVES, "bending": {}}, "slides one way"),
    "cone in the plane": ("plane", {"cones": [{"shear": [1, 1]}], "bending": {}}, "it is for spatial scenes"),
    "apex": ("space", {"friction": {**GROOVES, "cohesion": [1, 0]}, "bending": {}}, "one apex"),
    "across": ("space", {"friction": {**GROOVES, "direction": [0, 0, 1]}, "bending": {}}, "it stands across"),
    "no torsion": ("space", {"cones": [{"shear": [1, 1], "friction": 1}], "bending": {}}, "and 0 limit torsion"),
    "rock in space": ("space", {"hoek_brown": {"compressive_strength": 1, "m": 5}}, "points: in space one cone"),
    "beyond the face": ("plane", {"section": {"polygons": [[[0, 0], [2, 0], [1, 1]]]}}, "section: it reaches beyond"),
    "many": ("space", {"symmetric": ["V1", "V2", "M1", "M2", "MT"],
                       "vertices": [{"N": 9, "V1": 1, "V2": 1, "M1": 1, "M2": 1, "MT": 1}, {"N": -1}]},
             "vertices: .* of 6 resultants; expected fewer"),
    "no area": ("plane", {"section": {"polygons": [[[0, 0], [1, 1], [1, 0], [0, 1]]]}}, "its polygons hold no area"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_a_wrong_surface_is_one_line(case: str) -> None:
    where, surface, message = BAD[case]
    document = with_surface({"plane": PLANAR, "space": SPATIAL}[where], "dry", **surface)
    if case == "beside":
        document["materials"]["dry"]["cohesion"] = 1.0
    if case == "one face":
        document["materials"]["faces"] = [{"between": ["c0r0", "c1r0"], "dry": {"cohesion": 1.0}}]
    with refused(match=message):
        solve(document)


REFUSING = {
    "fields": ("solve", "{scene}", "--cracks", "fields:0.05"),
    "moves": ("move", "{scene}", "-o", "{out}"),
    "experiment": ("experiment", "{scene}"),
    "design check": ("check-design", "{scene}"),
    "prescribed friction": ("solve", "{scene}", "--friction", "zero-dilation"),
}


def test_doors_of_a_surface(jld: Command, tmp_path: Path) -> None:
    """What knows rows takes a surface, with load cases too; what does not refuses it in one line that names it."""
    path, document = tmp_path / "scene.json", deepcopy(SURFACES["plane"])
    path.write_text(json.dumps(document), encoding="utf-8")
    for command in REFUSING.values():
        jld(*(part.format(scene=path, out=tmp_path / "out") for part in command)).refused('surface"')
    document["loads"] = {"cases": [{"name": str(k), "live": [{"body": [way, 0.0]}]} for k, way in enumerate((1, -1))]}
    path.write_text(json.dumps(document), encoding="utf-8")
    solved = json.loads(jld("solve", path, "--json").out)
    assert solved["load_factor"] == pytest.approx(solve(document).load_factor, rel=1e-12)
    assert solved["sensitivities"].keys() <= {"weight"}
    for command in ("check", "thrust"):
        assert jld(command, path).code == 0, command
    path.write_text(json.dumps(SURFACES["ellipse"]), encoding="utf-8")
    assert json.loads(jld("solve", path, "--json").done().out)["geometry_sensitivities"] is None
