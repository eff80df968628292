"""Yield criteria of plug-ins, stated as rows: equal to the standard one where they state it, closed forms, proofs."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from cases import box, four_columns, grid_document, space_of
from cases import scene_in_space as scene
from command import Command, refused
from jld_core import InputError, Status, build_assembly, parse_scene, plugins, solve, solve_many
from jld_core.mechanics import FaceGeometry, FaceRows, Gauge, Parameter, scaling_of, yield_set
from jld_explore import explore, search_space

SOURCES = Path(__file__).parents[1] / "plugin" / "src"
EXAMPLES = {"ribbed": "Ribbed", "hoek_brown": "HoekBrown", "orthotropic": "Orthotropic"}
STRENGTHS = {"tensile_strength": 2e3, "shear_strength": 3e3}


class Stated:
    """Criterion whose rows a test states."""

    label = "inner"
    parameters = (Parameter("shift", default=0.0),)
    gauges: tuple[Gauge, ...] = ()
    table: Any = ()

    def rows(self, faces: FaceGeometry, values: dict[str, float]) -> FaceRows:
        table = np.array(self.table, dtype=float)
        return FaceRows(table[:, :3], table[:, 3] + values["shift"], self.gauges)


@pytest.fixture(autouse=True)
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The example package and this module, as if they were installed."""
    folder = tmp_path / "site"
    info = folder / "jld_example_of_criteria-1.0.dist-info"
    info.mkdir(parents=True)
    points = [f"{name} = jld_plugin_example.criteria:{kind}" for name, kind in EXAMPLES.items()]
    points.append(f"stated = {__name__}:Stated")
    (info / "entry_points.txt").write_text("[jld.criteria]\n" + "\n".join(points) + "\n", encoding="utf-8")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: jld-example-of-criteria\nVersion: 1.0\n", "utf-8")
    for path in (folder, SOURCES):
        monkeypatch.syspath_prepend(str(path))
    forget()
    yield
    monkeypatch.undo()
    forget()


def forget() -> None:
    """Drop what was found on the path."""
    plugins.entry_points.cache_clear()
    plugins.load.cache_clear()


def with_criterion(document: dict[str, Any], label: str, name: str, **parameters: float) -> dict[str, Any]:
    changed: dict[str, Any] = json.loads(json.dumps(document))
    changed["materials"][label] = {"criterion": name, "parameters": parameters}
    return changed


PLANAR = grid_document(["abcd", "ab.d", "#..#"], tension=2e3, shear=3e3)
SPATIAL = scene(
    [box("s", [0, 0, -1], [2, 1, 0], support=True), box("a", [0, 0, 0], [1, 1, 1]), box("b", [1, 0, 0], [2, 1, 1.5])]
)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(8))
def test_rows_of_no_symmetry_have_the_dissipation_of_a_linear_program(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """max −F·J over C F + d ≥ 0, infeasible dual where the margin is negative; rows of undecided faces enclose F."""
    rng = np.random.default_rng(seed)
    table = rng.normal(size=(8, 4))
    table[:, 0], table[:, 3] = abs(table[:, 0]), 1e3 * rng.random(8)
    table[:4, 1:3] = ((1, 1), (1, -1), (-1, 1), (-1, -1))
    monkeypatch.setattr(plugins.load("jld.criteria", "stated"), "table", table)
    document = grid_document(["a", "#"])
    assembly = build_assembly(parse_scene(with_criterion(document, "inner", "stated")))
    scaling = scaling_of(assembly)
    rows, unit = yield_set(assembly, scaling), float(assembly.interfaces.area[0] / scaling.force)
    inner, pattern = np.array([False]), rows.hull().pattern
    for _ in range(20):
        jump = rng.normal(loc=(2.0, 0.0, 0.0), size=(1, 3))
        margin = float(rows.margin(jump, inner)[0])
        found = linprog(jump[0], A_ub=-table[:, :3], b_ub=unit * table[:, 3], bounds=[(None, None)] * 3)
        if abs(margin) > 1e-9:
            assert (found.status == 0) == (margin > 0.0)
        if found.status == 0:
            assert rows.dissipation(jump, inner)[0] == pytest.approx(-found.fun, rel=1e-8, abs=1e-10)
            spare = pattern.h_dry.copy()
            np.subtract.at(spare, pattern.row, pattern.dry * found.x[pattern.column])
            assert spare.min() >= -1e-9


@pytest.mark.parametrize(("second", "number"), [(0.6, 8), (0.3, 4)])
def test_turns_map_joints_that_slide_alike_along_both_axes_alone(second: float, number: int) -> None:
    dry = {"criterion": "orthotropic", "parameters": {"first": 0.6, "second": second}}
    assert len(space_of(four_columns(dry)).group) == number


@pytest.mark.parametrize("seed", range(6))
def test_a_criterion_equal_to_the_standard_one_gives_the_same_load_factor(seed: int) -> None:
    rng = np.random.default_rng(seed)
    strengths = {"tensile_strength": 10 ** rng.uniform(2, 5), "shear_strength": 10 ** rng.uniform(2, 5)}
    plane = seed % 2 == 0
    document = json.loads(json.dumps(PLANAR if plane else SPATIAL))
    factor = 1.0 if plane else 1e-4
    document["materials"]["inner"] = {key: factor * value for key, value in strengths.items()}
    other = with_criterion(document, "inner", "ribbed", **document["materials"]["inner"])
    labels = rng.random(len(build_assembly(parse_scene(document)).interfaces)) < 0.5
    one, two = (solve(build_assembly(parse_scene(each)), labels) for each in (document, other))
    assert one.status is two.status
    assert two.load_factor == pytest.approx(one.load_factor, rel=1e-9, nan_ok=True)


# --- closed forms --------------------------------------------------------------------------------------


def test_a_block_on_an_orthotropic_joint_slides_at_its_ellipse() -> None:
    """λ(φ) = 1/√((cos φ/μ1)² + (sin φ/μ2)²) of a flat block under its weight and a horizontal body load."""
    first, second = 0.6, 0.35
    for angle in np.arange(24) * 2.0 * np.pi / 24:
        way = np.array([np.cos(angle), np.sin(angle), 0.0])
        document = scene(
            [box("s", [-3, -3, -1], [3, 3, 0], support=True), box("a", [-1, -1, 0], [1, 1, 0.01])],
            loads={"live": [{"body": way.tolist()}]},
        )
        assembly = build_assembly(
            parse_scene(with_criterion(document, "dry", "orthotropic", first=first, second=second))
        )
        axes = np.array([assembly.interfaces.e1[0], assembly.interfaces.e2[0]])
        along = axes @ way
        expected = 1.0 / np.hypot(along[0] / first, along[1] / second)
        result = solve(assembly, np.array([True]))
        assert result.load_factor == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_ribbed_cantilever_bends_at_the_side_that_it_is_pulled_at(way: float) -> None:
    """M = σt A l/6, times the ratio where the ribs are pulled: λ = M/(W h/2) of a block glued to the ground."""
    ratio, side = 2.5, 0.1
    document = grid_document(["a", "#"], tension=2e3, shear=1e6)
    document["loads"] = {"live": [{"body": [way, 0.0]}]}
    assembly = build_assembly(parse_scene(with_criterion(document, "inner", "ribbed", **STRENGTHS | {"ratio": ratio})))
    weight = float(np.linalg.norm(assembly.elements.weight[assembly.elements.free]))
    area = float(assembly.interfaces.area[0])
    result = solve(assembly, np.array([False]))
    flat = (STRENGTHS["tensile_strength"] * area + weight) * side / 6.0 / (weight * side / 2.0)
    sizes = sorted((flat, ratio * flat))
    found = [size for size in sizes if result.load_factor == pytest.approx(min(size, _sliding(weight, area)), rel=1e-9)]
    assert len(found) == 1


def _sliding(weight: float, area: float) -> float:
    return STRENGTHS["shear_strength"] * area / weight


# --- searches, proofs ----------------------------------------------------------------------------------


@pytest.mark.usefixtures("without_pictures", "without_field_check")
@pytest.mark.parametrize(
    ("name", "parameters"),
    [("ribbed", {**STRENGTHS, "ratio": 3.0}), ("hoek_brown", {"uniaxial_strength": 4e3, "m": 8.0})],
)
def test_a_proof_equals_the_best_of_all_labellings(name: str, parameters: dict[str, float]) -> None:
    """An asymmetric section on a symmetric arch: classes that symmetry would merge are kept apart."""
    document = with_criterion(grid_document(["abcd", "#..#"]), "inner", name, **parameters)
    document["loads"] = {"live": [{"element": f"c{k}r0", "force": [0.0, -1.0]} for k in (1, 2)]}
    parsed = parse_scene(document)
    assembly = build_assembly(parsed)
    space = search_space(parsed, assembly)
    free = np.flatnonzero(space.candidates)
    labellings = np.tile(space.fixed, (2 ** len(free), 1))
    labellings[:, free] = list(itertools.product([False, True], repeat=len(free)))
    found = solve_many(assembly, labellings).load_factor
    best = float(np.nanmax(np.where(np.isfinite(found), found, -np.inf)))
    for driver in ("enumeration", "exact"):
        done = explore(parsed, driver=driver, seconds=20)
        assert done.summary.proven
        assert done.summary.best == pytest.approx(best, rel=1e-8)


def test_load_cases_and_faces_of_their_own() -> None:
    """A criterion of one face equals the one of all faces where the others have the standard strengths."""
    strengths = {"tensile_strength": 2e4, "shear_strength": 3e4}
    document = grid_document(["ab", "#."], tension=2e4, shear=3e4)
    document["loads"] = {"cases": [{"name": str(k), "live": [{"body": [way, 0.0]}]} for k, way in enumerate((1, -1))]}
    labels = np.array([False, False])
    whole = with_criterion(document, "inner", "ribbed", **strengths)
    one = json.loads(json.dumps(document))
    stated = {"criterion": "ribbed", "parameters": strengths}
    one["materials"]["faces"] = [{"between": ["c0r0", "c0r1"], "inner": stated}]
    results = [solve(build_assembly(parse_scene(each)), labels) for each in (document, whole, one)]
    for result in results:
        assert result.status is Status.COLLAPSE
        assert result.load_factor == pytest.approx(results[0].load_factor, rel=1e-9)


@pytest.mark.parametrize("face", [False, True], ids=["material", "face"])
def test_parameters_take_texts_with_units(face: bool) -> None:
    """A stress of a criterion is one in any units of the scene, by the unit that its parameter names."""
    document = grid_document(["ab", "#."], tension=2e4, shear=3e4)
    document["units"] = {"length": "cm", "force": "kN"}
    stated: dict[str, Any] = {"criterion": "hoek_brown", "parameters": {"uniaxial_strength": "4 MPa", "m": 8.0}}
    document["materials"] |= {"faces": [{"between": ["c0r0", "c0r1"], "inner": stated}]} if face else {"inner": stated}
    parsed = parse_scene(document).materials
    found = parsed.faces[0].inner if face else parsed.inner
    assert found is not None
    assert found.parameters == {"uniaxial_strength": pytest.approx(0.4), "m": 8.0}
    stated["parameters"]["uniaxial_strength"] = 4e6
    warnings = [one for one in build_assembly(parse_scene(document)).warnings if "parameters" in one]
    where = "materials.faces[0].inner" if face else "materials.inner"
    told = f"{where}.parameters.uniaxial_strength is 4e+06, which is 4e+13 Pa in cm and kN; usual is"
    assert [one.startswith(told) for one in warnings] == [True]
    stated["parameters"]["m"] = "8 kN"
    with pytest.raises(InputError, match=r"parameters.m: it is .*; expected a number from"):
        build_assembly(parse_scene(document))
    stated["parameters"] = {"uniaxial_strength": "4 kN", "m": 8.0}
    with pytest.raises(InputError, match=r"uniaxial_strength: .*'kN' is no unit of this quantity"):
        parse_scene(document)


# --- refusals ------------------------------------------------------------------------------------------


BAD: dict[str, tuple[Any, str]] = {
    "unknown": (
        {"criterion": "ribed"},
        r"materials.inner.criterion: no installed package adds \"ribed\"; .*\"ribbed\"",
    ),
    "other label": ({"criterion": "orthotropic"}, r'"orthotropic" is for dry faces; expected "materials.dry"'),
    "missing": ({"criterion": "ribbed"}, 'parameters.tensile_strength: missing, and "ribbed" needs it'),
    "no such": (
        {"criterion": "ribbed", "parameters": {**STRENGTHS, "shear_stregth": 1.0}},
        'parameters.shear_stregth: "ribbed" has no such parameter; expected "shear_strength"',
    ),
    "bounds": ({"criterion": "ribbed", "parameters": {**STRENGTHS, "ratio": 50.0}}, "ratio: it is 50; expected"),
    "beside": ({"criterion": "ribbed", "shear_strength": 1.0}, "shear_strength: it is no part of the criterion"),
    "alone": ({"parameters": {"a": 1.0}, **STRENGTHS}, 'parameters: they belong to a "criterion"'),
}


@pytest.mark.parametrize("case", BAD)
def test_a_wrong_statement_is_one_line(case: str) -> None:
    material, message = BAD[case]
    document = grid_document(["a", "#"])
    document["materials"]["inner"] = material
    with refused(match=message):
        build_assembly(parse_scene(document))


BEND = [(1.0, 0.0, -3.0, 1e3), (1.0, 0.0, 3.0, 1e3)]
SHEAR = [(0.0, -1.0, 0.0, 1e3), (0.0, 1.0, 0.0, 1e3)]
ROUND = (Gauge(np.eye(2), 1.0, 10.0),)
UNUSABLE: dict[str, tuple[Any, tuple[Gauge, ...], str, float]] = {
    "zero outside": ([*BEND, (1.0, 1.0, 0.0, -5.0)], (), 'row 2 of "stated" is -5 without force', 0.0),
    "shifted": ([*BEND, *SHEAR], (), "zero inside the yield set", -2e3),
    "unlimited shear": (BEND, (), "leaves a force or moment without limit", 0.0),
    "unbounded below": ([(-1.0, 0.0, -3.0, 1e3), (-1.0, 0.0, 3.0, 1e3), *SHEAR], (), "lets N fall without limit", 0.0),
    "another shape": ([[1.0, 2.0]], (), 'the rows of "stated" are unusable: ', 0.0),
    "not finite": ([*BEND, (0.0, np.nan, 0.0, 1.0)], (), "no finite numbers", 0.0),
    "gauges in the plane": ([*BEND, *SHEAR], ROUND, "gauges in the plane", 0.0),
}


@pytest.mark.parametrize("case", UNUSABLE)
def test_unusable_rows_are_one_line(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    table, gauges, message, shift = UNUSABLE[case]
    criterion = plugins.load("jld.criteria", "stated")
    monkeypatch.setattr(criterion, "table", table)
    monkeypatch.setattr(criterion, "gauges", gauges)
    document = with_criterion(grid_document(["a", "#"]), "inner", "stated", shift=shift)
    with refused(match=message):
        solve(build_assembly(parse_scene(document)))


PYRAMID = [(1.0, x, y, 10.0) for x, y in ((3, 0), (-3, 0), (0, 3), (0, -3))]
IN_SPACE: dict[str, tuple[tuple[Gauge, ...], str]] = {
    "no gauge": ((), "0 gauges"),
    "shear alone": ((Gauge(np.eye(2), 0.0, 1.0),), '1 gauges of "stated" limit shear and 0 limit torsion'),
    "singular": ((Gauge(np.diag([1.0, 0.0]), 1.0, 1.0),), "singular"),
    "beyond the apex": ((Gauge(np.eye(2), 1.0, 1.0, 0.5),), "where c . μN is negative"),
    "negative": ((Gauge(np.eye(2), 1.0, -1.0),), "a number of a gauge"),
}


@pytest.mark.parametrize("case", IN_SPACE)
def test_unusable_gauges_are_one_line(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    gauges, message = IN_SPACE[case]
    criterion = plugins.load("jld.criteria", "stated")
    monkeypatch.setattr(criterion, "table", PYRAMID)
    monkeypatch.setattr(criterion, "gauges", gauges)
    with pytest.raises(InputError, match=message):
        solve(build_assembly(parse_scene(with_criterion(SPATIAL, "inner", "stated"))))


def test_shear_and_torsion_with_a_gauge_each(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both limits of a glued block: it slides as under one gauge, and turns about its axis at MT = k⁻¹ c A c_T."""
    criterion = plugins.load("jld.criteria", "stated")
    monkeypatch.setattr(criterion, "table", [(*row[:3], 1e6) for row in PYRAMID])
    monkeypatch.setattr(criterion, "gauges", (Gauge(np.eye(2), 0.0, 2.0), Gauge(None, 0.5, 3.0)))
    for live, limit in (({"force": [1.0, 0.0, 0.0]}, "shear"), ({"moment": [0.0, 0.0, 1.0]}, "torsion")):
        document = scene(
            [box("s", [0, 0, -1], [1, 1, 0], support=True), box("a", [0, 0, 0], [1, 1, 1])],
            loads={"live": [{"element": "a", **live}]},
        )
        assembly = build_assembly(parse_scene(with_criterion(document, "inner", "stated")))
        expected = 2.0 if limit == "shear" else 3.0 / 0.5 * float(assembly.interfaces.c_t[0])
        result = solve(assembly, np.array([False]))
        assert result.load_factor == pytest.approx(expected, rel=1e-8)


COMMANDS: dict[str, tuple[str, ...]] = {
    "fields": ("solve", "{scene}", "--cracks", "fields:0.05"),
    "moves": ("move", "{scene}", "-o", "{out}"),
    "experiment": ("experiment", "{scene}"),
    "search by experiment": ("explore", "{scene}", "--out", "{out}", "--objective", "experiment"),
    "3dec": ("export", "{scene}", "--format", "3dec", "-o", "{out}"),
    "compas_dem": ("export", "{scene}", "--format", "compas_dem", "-o", "{out}"),
    "design check": ("check-design", "{scene}"),
}


@pytest.mark.parametrize("case", COMMANDS)
def test_what_does_not_know_a_criterion_refuses_it(case: str, jld: Command, tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    document = with_criterion(grid_document(["ab", "##"]), "inner", "ribbed", **STRENGTHS)
    path.write_text(json.dumps(document), encoding="utf-8")
    jld(*(part.format(scene=path, out=tmp_path / "out") for part in COMMANDS[case])).refused('ribbed"')


def test_what_knows_it_takes_it(jld: Command, tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    document = with_criterion(grid_document(["ab", "##"]), "inner", "ribbed", **STRENGTHS)
    path.write_text(json.dumps(document), encoding="utf-8")
    solved = jld("solve", path, "--json").done()
    assert {"friction_coefficient", "weight"} >= set(json.loads(solved.out)["sensitivities"])
    for command in ("check", "thrust", "assembly"):
        assert jld(command, path).code == 0, command
