"""Bond of dry joints, a tension cut-off with cohesion: closed forms, a second route to λ, arches that were tested."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from jld_core import Assembly, InputError, LimitAnalysisResult, Status, build_assembly, parse_scene, solve
from jld_core.mechanics import equilibrium_matrix, load_vectors, scaling_of, yield_set
from jld_core.views.quantities import utilisation
from jld_explore import explore
from jld_explore.verification import verify

Document = dict[str, Any]


def solved(document: Document, **options: Any) -> LimitAnalysisResult:
    result = solve(build_assembly(parse_scene(document)), **options)
    assert result.status is Status.COLLAPSE
    assert result.gap <= 1e-6
    return result


def cantilever(count: int, live: list[Document], weight: float = 0.0, **dry: float) -> Document:
    """`count` blocks of 1 × 2 that stick out of a wall at x = 0, bonded by vertical joints."""
    blocks = [
        {"id": f"b{k}", "polygon": [[k, 0], [k + 1, 0], [k + 1, 2], [k, 2]], "weight": weight} for k in range(count)
    ]
    wall = {"id": "w", "polygon": [[-1, -1], [0, -1], [0, 3], [-1, 3]], "support": True}
    return {
        "elements": [*blocks, wall],
        "thickness": 0.5,
        "materials": {"dry": {"friction_coefficient": 0.5, "cohesion": 8.0, "tensile_strength": 6.0, **dry}},
        "loads": {"live": live},
    }


def test_bonded_joint_pulls_as_much_as_its_strength() -> None:
    """λ F = σt A; N of the result is the tension."""
    result = solved(cantilever(2, [{"element": "b1", "force": [2.0, 0.0]}]))
    assert result.load_factor == pytest.approx(6.0 * 1.0 / 2.0, rel=1e-8)
    assert result.forces is not None
    assert result.forces[:, 0] == pytest.approx(-6.0, rel=1e-6)
    assert utilisation(result).max() == pytest.approx(1.0, rel=1e-5)


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("weight", [0.0, 0.4])
def test_bonded_cantilever(count: int, weight: float) -> None:
    """Pure bending at the root turns about its lower edge: λ F L + W L/2 = σt b h²/2 with b h² / 2 = 1."""
    result = solved(cantilever(count, [{"element": f"b{count - 1}", "force": [0, -1], "at": [count, 1.0]}], weight))
    expected = (6.0 * 0.5 * 2.0**2 / 2.0 - count * weight * count / 2.0) / count
    assert result.load_factor == pytest.approx(min(expected, 8.0 - count * weight), rel=1e-8)


def test_bonded_joint_that_crushes() -> None:
    """Stress blocks at σt and σc: N' = σt A, M = (l/2) N' (1 − N'/(σc + σt) A) = (l/2) A σt σc/(σc + σt)."""
    pull = [{"element": "b0", "moment": -1.0}]
    result = solved(cantilever(1, pull, compressive_strength=18.0))
    assert result.load_factor == pytest.approx(1.0 * 6.0 * 18.0 / 24.0, rel=1e-6)


@pytest.mark.parametrize("pull", [0.0, 2.0, 5.9])
def test_shear_of_a_bonded_joint_under_tension(pull: float) -> None:
    """|V| = c A + μ N with N < 0."""
    document = cantilever(1, [{"element": "b0", "force": [0, -1], "at": [0.0, 1.0]}])
    document["loads"]["dead"] = [{"element": "b0", "force": [pull, 0.0]}]
    result = solved(document)
    assert result.load_factor == pytest.approx(8.0 - 0.5 * pull, rel=1e-7)


def test_bonded_cantilever_in_space() -> None:
    """As in the plane, about the lower edge of the root."""
    x, y, z = (0, 1), (0, 0.5), (0, 2)

    def box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Document:
        corners = [[x[i], y[j], z[k]] for k in (0, 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        faces = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
        return {"vertices": corners, "faces": faces}

    document = {
        "elements": [
            {"id": "b", **box(x, y, z), "weight": 0.0},
            {"id": "w", **box((-1, 0), (-1, 2), (-1, 3)), "support": True},
        ],
        "materials": {"dry": {"friction_coefficient": 0.5, "cohesion": 8.0, "tensile_strength": 6.0}},
        "loads": {"live": [{"element": "b", "force": [0, 0, -1], "at": [1, 0.25, 1]}]},
    }
    assert solved(document).load_factor == pytest.approx(6.0, rel=1e-6)


def wall(**more: Any) -> Document:
    return {
        "name": "wall",
        "grid": {"cell": [1, 1], "thickness": 1.0, "rows": ["aab", "cdd", "###"]},
        "materials": {
            "density": 1000,
            "dry": {"friction_coefficient": 0.5, "cohesion": 2e3, "tensile_strength": 3e3},
            "inner": {"tensile_strength": 9e3, "shear_strength": 6e3},
            "faces": [{"between": ["c0r0", "c0r1"], "dry": {"tensile_strength": 0.0}}],
        },
        "loads": {"live": [{"body": [1, 0]}]},
        **more,
    }


def by_hand(assembly: Assembly, plain: Assembly, labels: np.ndarray) -> float:
    """λ by HiGHS, with |m| ≤ N + σt A and |V| ≤ c A + μ N of bonded dry faces written down here."""
    scaling = scaling_of(plain)
    facets = yield_set(plain, scaling).facets(labels)
    assert facets is not None
    assert assembly.members.bond is not None
    rows, constants = facets
    constants[:, :2] += np.where(labels, assembly.members.bond, 0.0)[:, None] / scaling.force
    dead, live = load_vectors(plain)
    matrix = equilibrium_matrix(plain).toarray() * scaling.face.ravel() / scaling.force
    count = len(labels)
    cap = np.zeros((4 * count, 3 * count + 1))
    for k in range(count):
        cap[4 * k : 4 * k + 4, 3 * k : 3 * k + 3] = -rows[k]
    found = linprog(
        np.append(np.zeros(3 * count), -1.0),
        A_ub=cap,
        b_ub=constants.ravel(),
        A_eq=np.column_stack([matrix, live / scaling.force]),
        b_eq=-dead / scaling.force,
        bounds=(None, None),
        method="highs",
    )
    assert found.status == 0
    return float(found.x[-1])


def test_load_factor_is_that_of_a_program_written_by_hand() -> None:
    """Layouts drawn at random, dry faces with and without bond beside inner ones."""
    document = wall()
    without = wall()
    without["materials"] = {**without["materials"], "dry": {**without["materials"]["dry"], "tensile_strength": 0.0}}
    assembly, plain = build_assembly(parse_scene(document)), build_assembly(parse_scene(without))
    rng = np.random.default_rng(2)
    for row in rng.random((2, len(assembly.interfaces))) < 0.6:
        expected = by_hand(assembly, plain, row)
        for options in ({"solver": "clarabel"}, {"solver": "highs"}, {"condense": "on"}):
            assert solve(assembly, row, **options).load_factor == pytest.approx(expected, rel=1e-7)
    assert assembly.total_dead == plain.total_dead


@pytest.mark.usefixtures("without_pictures", "without_field_check")
def test_proof_with_bond_is_that_of_enumeration_and_is_verified(tmp_path: Any) -> None:
    document = wall(search={"block_cells": [1, 2]})
    document["grid"] = {**document["grid"], "rows": ["ab", "cd", "ef", "##"]}
    document["materials"]["dry"]["cohesion"] = 2e4
    document["materials"]["inner"] = {"tensile_strength": 9e3, "shear_strength": 3e4}
    scene = parse_scene(document)
    every = explore(scene, out=tmp_path / "every", driver="enumeration")
    proof = explore(scene, out=tmp_path / "exact", driver="exact", certificate=tmp_path / "proof")
    assert proof.summary.proven
    assert proof.summary.best == pytest.approx(every.summary.best, rel=1e-6)
    assert float(verify(tmp_path / "proof").claim.bound) >= float(every.summary.best or 0.0)
    document["materials"]["dry"]["tensile_strength"] = 0.0
    less = explore(parse_scene(document), out=tmp_path / "weak", driver="enumeration")
    assert float(less.summary.best or 0.0) < 0.99 * float(every.summary.best or 0.0)


def test_without_dilation_bond_holds() -> None:
    """The cantilever turns without sliding: λ is that of associative friction."""
    push = [{"element": "b0", "force": [0, -1], "at": [1, 1.0]}]
    assert solved(cantilever(1, push), friction="zero-dilation").load_factor == pytest.approx(6.0, rel=1e-5)


def thin_arch(bond: float) -> Document:
    """Arch "US" of Oliveira: intrados span 1.467 m, rise 0.593 m, t 0.05 m, width 0.45 m, 59 bricks, 18 kN/m³.

    A vertical force acts on the extrados at the middle of brick 19, near a quarter of the span. Friction 20 stands for
    joints that do not slide.
    """
    span, rise, depth, count = 1.467, 0.593, 0.05, 59
    radius = (span**2 / 4 + rise**2) / (2 * rise)
    centre, half = np.array([0.0, rise - radius]), np.arcsin(span / 2 / radius)
    turn = np.linspace(-half, half, count + 1)
    turn = np.concatenate([[2 * turn[0] - turn[1]], turn, [2 * turn[-1] - turn[-2]]])
    out = np.column_stack([np.sin(turn), np.cos(turn)])
    inside, outside = centre + radius * out, centre + (radius + depth) * out
    blocks = [
        {"id": f"v{k - 1}", "polygon": [one.tolist() for one in (inside[k], inside[k + 1], outside[k + 1], outside[k])]}
        for k in range(count + 2)
    ]
    for end in (blocks[0], blocks[-1]):
        end["support"] = True
    at = 0.5 * (turn[19] + turn[20])
    place = centre + (radius + depth) * np.array([np.sin(at), np.cos(at)])
    return {
        "elements": blocks,
        "thickness": 0.45,
        "units": {"length": "m", "force": "kN"},
        "materials": {
            "density": 18,
            "gravity": 1.0,
            "dry": {"friction_coefficient": 20, "cohesion": 20 * bond, "tensile_strength": bond},
        },
        "loads": {"live": [{"element": "v18", "force": [0, -1], "at": place.tolist()}]},
    }


def test_bonded_arch_lies_within_the_scatter_of_its_tests() -> None:
    """Two arches failed at 1.43 and 1.92 kN, 70 times what they carry without tension, .020993168300677757.

    The value and the tests are those of claudiopagani/structural-checks-ts, benchmarks/masonry-arches. The bond is
    stated here, not measured there: 0.15 MPa; from 0.13 to 0.16 MPa λ lies within the scatter.
    """
    assert solved(thin_arch(0.0)).load_factor == pytest.approx(0.020993168300677757, rel=1e-8)
    assert 1.43 < solved(thin_arch(150.0)).load_factor < 1.92


@pytest.mark.parametrize(
    ("dry", "inner", "words"),
    [
        ({"tensile_strength": -1.0}, None, "tensile_strength: -1.0 is wrong"),
        ({"tensile_strength": 17.0}, None, "17 is beyond the apex of its friction"),
        ({"tensile_strength": {"nominal": 2.0, "low": 1.0}}, None, "tensile_strength: .* is wrong"),
        ({}, {"tensile_strength": 5.0, "shear_strength": 9.0}, "6 is above the tensile strength of the same face"),
    ],
)
def test_bad_bond_is_one_line(dry: Document, inner: Document | None, words: str) -> None:
    document = cantilever(2, [{"element": "b1", "force": [1, 0]}], **dry)
    if inner is not None:
        document["materials"]["inner"] = inner
    with pytest.raises(InputError, match=words) as error:
        build_assembly(parse_scene(document))
    assert "\n" not in str(error.value)


def test_models_without_tension_refuse_bond() -> None:
    from jld_practice.laying import assembly_order

    assembly = build_assembly(parse_scene(wall()))
    with pytest.raises(InputError, match=r"materials\.dry\.tensile_strength: an assembly sequence does not model it"):
        assembly_order(assembly, assembly.labels)
