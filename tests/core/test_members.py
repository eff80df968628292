"""Ties, tendons and pins: closed forms of statics, a second route to λ, and what refuses them. docs/method.md (1.9)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

from cases import dry_and_inner, grid_document, solved
from command import refused
from jld_core import Assembly, InputError, LimitAnalysis, LimitAnalysisResult, build_assembly, parse_scene, solve
from jld_core import assembly as assembly_of_core
from jld_core.mechanics import equilibrium_matrix, load_vectors, scaling_of, yield_set
from jld_core.refinement import refine
from jld_core.views import facts_of_assembly, facts_of_result

Document = dict[str, Any]


def bar(kind: str, one: str, at: list[float], other: str, there: list[float], **more: Any) -> Document:
    return {"kind": kind, "from": {"element": one, "at": at}, "to": {"element": other, "at": there}, **more}


def block(members: list[Document], friction: float = 5.0, live: Any = None, **more: Any) -> Document:
    """A block of weight 1, width 1 and height 3 on the ground."""
    return {
        "elements": [
            {"id": "b", "polygon": [[0, 0], [1, 0], [1, 3], [0, 3]], "weight": 1.0},
            {"id": "g", "polygon": [[-4, -1], [5, -1], [5, 0], [-4, 0]], "support": True},
        ],
        "materials": {"dry": {"friction_coefficient": friction}},
        "loads": {"live": live or [{"body": [1, 0]}]},
        "members": members,
        **more,
    }


def member(result: LimitAnalysisResult, place: int = 0) -> dict[str, Any]:
    return dict(result.to_json()["members"][place])


# --- closed forms -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("condense", ["off", "on"])
@pytest.mark.parametrize("across", [0.0, 0.3, 0.8])
def test_wall_tied_to_the_floor(across: float, condense: str) -> None:
    """Rocking about the right edge: λ W h/2 = W b/2 + T (b − x)."""
    tie = bar("tie", "b", [across, 1.0], "g", [across, -0.5], tension=0.4, name="strap")
    result = solved(block([tie]), condense=condense)
    assert result.load_factor == pytest.approx((0.5 + 0.4 * (1.0 - across)) / 1.5, rel=1e-8)
    found = member(result)
    assert (found["name"], found["kind"], found["elements"]) == ("strap", "tie", ["b", "g"])
    assert found["force"] == pytest.approx(0.4, rel=1e-6)
    # live power 1 turns the block by 1/1.5 about its edge
    assert found["elongation"] == pytest.approx((1.0 - across) / 1.5, rel=1e-6)


def test_tie_stays_slack_where_it_would_shorten() -> None:
    """Pushed the other way, the block turns about the edge that the tie stands at: T does nothing."""
    tie = bar("tie", "b", [0.0, 1.0], "g", [0.0, -0.5], tension=0.4)
    result = solved(block([tie], live=[{"body": [-1, 0]}]))
    assert result.load_factor == pytest.approx(0.5 / 1.5, rel=1e-8)
    assert -1e-9 <= member(result)["force"] <= 0.4


def test_strut_carries_its_compression() -> None:
    """A strut at 45° from the top corner: λ W h/2 = W b/2 + C h / √2 about the right edge."""
    strut = bar("tie", "b", [1.0, 3.0], "g", [4.0, 0.0], compression=0.1)
    result = solved(block([strut]))
    assert result.load_factor == pytest.approx((0.5 + 0.1 * 3.0 / np.sqrt(2.0)) / 1.5, rel=1e-8)
    assert member(result)["force"] == pytest.approx(-0.1, rel=1e-6)


def beam(count: int, members: Callable[[float, float], list[Document]], weight: float, span: float = 8.0) -> Document:
    """Beam of `count` dry blocks of height 1 over two smooth supports of width 0.2, with a load at its middle joint."""
    size, wide = span / count, 0.2
    blocks = [
        {"id": f"b{k}", "polygon": [[k * size, 0], [(k + 1) * size, 0], [(k + 1) * size, 1], [k * size, 1]]}
        for k in range(count)
    ]
    ends = [(0.0, wide), (span - wide, span)]
    supports = [
        {"id": f"s{k}", "polygon": [[a, -1], [b, -1], [b, 0], [a, 0]], "support": True} for k, (a, b) in enumerate(ends)
    ]
    half = count // 2
    smooth = [{"between": [f"b{count * k - k}", f"s{k}"], "dry": {"friction_coefficient": 0.0}} for k in (0, 1)]
    # friction at one support holds the beam as a whole, and lets its halves part
    smooth.pop()
    return {
        "elements": [*({**one, "weight": weight} for one in blocks), *supports],
        "materials": {"dry": {"friction_coefficient": 20.0}, "faces": smooth},
        "loads": {"live": [{"element": f"b{k}", "force": [0, -0.5], "at": [span / 2, 1.0]} for k in (half - 1, half)]},
        "members": members(span, float(count)),
    }


@pytest.mark.parametrize("count", [2, 4, 8])
@pytest.mark.parametrize(("prestress", "more"), [(3.0, {}), (6.0, {}), (3.0, {"tension": 5.0})])
def test_post_tensioned_beam(count: int, prestress: float, more: dict[str, float]) -> None:
    """The middle joint opens about its top: λ F L/2 + W (l/4 − s) = 2 P (h − y), L = l − 2 s the clear span.

    A stated force is constant; above it there is as much as the tendon carries, T instead of P.
    """
    span, wide, height, weight = 8.0, 0.2, 0.4, 0.1

    def tendon(span: float, count: float) -> list[Document]:
        last = f"b{int(count) - 1}"
        return [bar("tendon", "b0", [0.0, height], last, [span, height], prestress=prestress, **more)]

    result = solved(beam(count, tendon, weight))
    force = more.get("tension", prestress)
    clear = span - 2 * wide
    expected = (2.0 * force * (1.0 - height) - weight * count * (span / 4 - wide)) / (clear / 2)
    assert result.load_factor == pytest.approx(expected, rel=1e-7)
    assert member(result)["force"] == pytest.approx(force, rel=1e-6)


@pytest.mark.parametrize("rise", [1.0, 2.5])
def test_tied_two_pinned_arch(rise: float) -> None:
    """Two blocks that lean on each other, their feet on smooth supports: the tie takes the thrust H = F L/(4 f).

    The crown turns about its top, the feet about their inner edges, which are L apart and f below it.
    """
    foot, depth, half = 0.2, 0.3, 4.0
    left = [[0, 0], [foot, 0], [half, rise - depth], [half, rise]]
    right = [[2 * half - x, y] for x, y in reversed(left)]
    supports = [[[0, -1], [foot, -1], [foot, 0], [0, 0]], [[8 - foot, -1], [8, -1], [8, 0], [8 - foot, 0]]]
    document = {
        "elements": [
            {"id": "l", "polygon": left, "weight": 0.0},
            {"id": "r", "polygon": right, "weight": 0.0},
            *({"id": f"s{k}", "polygon": one, "support": True} for k, one in enumerate(supports)),
        ],
        "materials": {
            "dry": {"friction_coefficient": 20.0},
            "faces": [{"between": ["l", "s0"], "dry": {"friction_coefficient": 0.0}}],
        },
        "loads": {"live": [{"element": e, "force": [0, -0.5], "at": [half, rise]} for e in ("l", "r")]},
        "members": [bar("tie", "l", [foot / 2, 0.0], "r", [8 - foot / 2, 0.0], tension=2.0)],
    }
    result = solved(document)
    assert result.load_factor == pytest.approx(4.0 * 2.0 * rise / (8.0 - 2 * foot), rel=1e-7)


@pytest.mark.parametrize("tension", [0.0, 0.5])
def test_bolted_lap(tension: float) -> None:
    """A bolt across a joint: λ F = S + μ (W + T), since slip by associative friction stretches the bolt."""
    bolt = bar("pin", "b", [0.5, 0.0], "g", [0.5, 0.0], shear=0.3, tension=tension)
    push = [{"element": "b", "force": [2, 0], "at": [0.5, 0.0]}]
    result = solved(block([bolt], friction=0.2, live=push))
    assert result.load_factor == pytest.approx((0.3 + 0.2 * (1.0 + tension)) / 2.0, rel=1e-8)
    assert member(result)["shear"] == pytest.approx(0.3, rel=1e-6)


def test_bar_over_a_point_pulls_on_both_sides() -> None:
    """A bar from the ground over a point of the block to the ground: λ F = W + 2 T cos α against lifting."""
    sling = bar("tie", "g", [-1.0, 0.0], "g", [2.0, 0.0], tension=0.25, through=[{"element": "b", "at": [0.5, 2.0]}])
    lift = [{"element": "b", "force": [0, 1], "at": [0.5, 3.0]}]
    result = solved(block([sling], live=lift))
    assert result.load_factor == pytest.approx(1.0 + 2 * 0.25 * 2.0 / np.hypot(2.0, 1.5), rel=1e-8)
    assert member(result)["force"] == pytest.approx(0.25, rel=1e-6)


def test_prestress_over_a_point_turns_the_block() -> None:
    """Tendon from the ground over the top left corner, constant force P: a corner force of both its directions."""
    one, top, two = np.array([-2.0, 0.0]), np.array([0.0, 3.0]), np.array([3.0, 0.0])
    sling = bar("tendon", "g", [-2.0, 0.0], "g", [3.0, 0.0], prestress=0.2, through=[{"element": "b", "at": [0, 3]}])
    pull = 0.2 * ((one - top) / np.linalg.norm(one - top) + (two - top) / np.linalg.norm(two - top))
    result = solved(block([sling]))
    expected = (0.5 - pull[1] - 3.0 * pull[0]) / 1.5  # about the right edge (1, 0), the corner is at (−1, 3) from it
    assert result.load_factor == pytest.approx(expected, rel=1e-8)


def cube(members: list[Document], live: list[float], friction: float = 5.0) -> Document:
    """A block 1 × 1 × 3 of weight 1 on the ground, in space."""

    def box(low: list[float], high: list[float]) -> Document:
        x, y, z = zip(low, high, strict=True)
        corners = [[x[i], y[j], z[k]] for k in (0, 1) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        faces = [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
        return {"vertices": corners, "faces": faces}

    return {
        "elements": [
            {"id": "b", **box([0, 0, 0], [1, 1, 3]), "weight": 1.0},
            {"id": "g", **box([-3, -3, -1], [4, 4, 0]), "support": True},
        ],
        "materials": {"dry": {"friction_coefficient": friction}},
        "loads": {"live": [{"element": "b", "force": live, "at": [0.5, 0.5, 0.0 if friction < 1 else 1.5]}]},
        "members": members,
    }


def test_block_in_space_tied_to_the_floor() -> None:
    """As in the plane, and λ is that of the plane if tie and push lie in one."""
    tie = bar("tie", "b", [0.0, 0.5, 1.0], "g", [0.0, 0.5, -0.5], tension=0.4)
    result = solved(cube([tie], [1, 0, 0]))
    assert result.load_factor == pytest.approx(0.9 / 1.5, rel=1e-6)
    assert member(result)["force"] == pytest.approx(0.4, rel=1e-5)


@pytest.mark.parametrize("angle", [0.0, 30.0, 75.0])
def test_bolt_in_space_holds_in_every_direction(angle: float) -> None:
    """λ F = S + μ W whatever the direction of the push."""
    along = [2 * np.cos(np.radians(angle)), 2 * np.sin(np.radians(angle)), 0.0]
    bolt = bar("pin", "b", [0.5, 0.5, 0.2], "g", [0.5, 0.5, -0.2], shear=0.3)
    result = solved(cube([bolt], along, friction=0.2))
    assert result.load_factor == pytest.approx((0.3 + 0.2) / 2.0, rel=1e-6)
    assert member(result)["shear"] == pytest.approx(0.3, rel=1e-5)


# --- a second route, and invariance ---------------------------------------------------------------------------


def wall(members: list[Document], **more: Any) -> Document:
    return {
        "grid": {"cell": [1, 1], "thickness": 1.0, "rows": ["aabb", "ccdd", "eeff", "####"]},
        "materials": dry_and_inner(1000, 0.6, 1e4, 1e4),
        "loads": {"live": [{"body": [1, 0]}]},
        "members": members,
        **more,
    }


def three() -> list[Document]:
    return [
        bar("tie", "c0r0", [0.2, 3.5], "c1r3", [1.5, 0.0], tension=8e3),
        bar("tie", "c0r1", [0.5, 2.5], "c3r1", [3.5, 2.5], tension=8e3, compression=4e3),
        bar("tendon", "c0r2", [0.0, 1.5], "c3r2", [4.0, 1.2], prestress=3e3, tension=9e3),
        bar("tendon", "c2r0", [2.5, 3.5], "c2r2", [2.5, 1.5], prestress=2e3),
        bar("pin", "c2r1", [2.5, 2.0], "c2r2", [2.5, 2.0], shear=3e3, tension=100.0),
    ]


def by_hand(assembly: Assembly, labels: np.ndarray) -> float:
    """λ of a linear program with columns of members that are written down here, by HiGHS."""
    plain = assembly_of_core.faces_of(assembly)
    scaling = scaling_of(plain)
    matrix = equilibrium_matrix(plain).toarray() * scaling.face.ravel()
    facets = yield_set(plain, scaling).facets(labels)
    assert facets is not None
    rows, constants = facets
    held = yield_set(plain, scaling).active(labels).ravel()
    dead, live = load_vectors(plain)
    free = {int(e): k for k, e in enumerate(plain.elements.free)}
    columns, bounds = [], []

    def force(column: np.ndarray, element: int, at: np.ndarray, vector: np.ndarray) -> None:
        if element in free:
            arm = at - plain.elements.centroid[element]
            moment = arm[0] * vector[1] - arm[1] * vector[0]
            column[3 * free[element] : 3 * free[element] + 3] += [*vector, moment]

    for entry in three():
        (one, p), (other, r) = [(entry[key]["element"], np.array(entry[key]["at"])) for key in ("from", "to")]
        a, b = plain.elements.index[one], plain.elements.index[other]
        along = np.array([0.0, -1.0]) if entry["kind"] == "pin" else (r - p) / np.linalg.norm(r - p)
        low, high = entry.get("prestress", -entry.get("compression", 0.0)), entry.get("tension", entry.get("prestress"))
        pulls = [(along, low, high)]
        if entry["kind"] == "pin":
            pulls.append((np.array([1.0, 0.0]), -entry["shear"], entry["shear"]))
        for way, least, most in pulls:  # tension pulls the ends together
            column = np.zeros(len(dead))
            force(column, a, p, way)
            force(column, b, r, -way)
            columns.append(column)
            bounds.append((least, most))
    prestress = np.zeros(len(dead))
    for column, entry in zip(columns, three(), strict=False):
        prestress += entry.get("prestress", 0.0) * column
    count, extra = len(rows), len(columns)
    cap = np.zeros((4 * count, 3 * count + extra + 1))
    for k in range(count):
        cap[4 * k : 4 * k + 4, 3 * k : 3 * k + 3] = -rows[k]
    ranges = [(None, None) if on else (0.0, 0.0) for on in held]
    found = linprog(
        np.append(np.zeros(3 * count + extra), -1.0),
        A_ub=cap,
        b_ub=constants.ravel(),
        A_eq=np.column_stack([matrix, *columns, live]),
        b_eq=prestress - dead,
        bounds=[*ranges, *bounds, (None, None)],
        method="highs",
    )
    assert found.status == 0
    return float(found.x[-1])


def test_load_factor_is_that_of_a_program_written_by_hand() -> None:
    """Five members in a wall of random layouts; batch solver, Clarabel and rigid blocks agree with HiGHS."""
    assembly = build_assembly(parse_scene(wall(three())))
    rng = np.random.default_rng(4)
    labels = rng.random((3, len(assembly.interfaces))) < 0.6
    labels[:, assembly.faces :] = False
    analysis = LimitAnalysis(assembly)
    together = analysis.batch.solve(labels)
    scale = analysis.template.scaling.load
    for k, row in enumerate(labels):
        expected = by_hand(assembly, row[: assembly.faces])
        for condense in ("off", "on"):
            result = solve(assembly, row, solver="clarabel", condense=condense)
            assert result.load_factor == pytest.approx(expected, rel=1e-7)
        low, high = together.low[k] * scale, together.high[k] * scale
        assert low <= expected * (1 + 1e-9) <= high * (1 + 2e-9)
        assert high - low <= 1e-5


def test_load_factor_does_not_depend_on_units_or_order() -> None:
    one = solved(wall(three()))
    turned = [{**m, "from": m["to"], "to": m["from"]} for m in reversed(three())]
    assert solved(wall(turned)).load_factor == pytest.approx(one.load_factor, rel=1e-9)
    forces = ("tension", "compression", "prestress", "shear")
    texts = [{key: f"{value / 1e3} kN" if key in forces else value for key, value in m.items()} for m in three()]
    assert solved(wall(texts)).load_factor == pytest.approx(one.load_factor, rel=1e-9)


def test_prestress_acts_in_every_load_case_and_low_values_count() -> None:
    """λ of each case is that of its own scene; a low tension lowers λ of the robust structure."""
    from jld_core.build import build_robust

    tie = bar("tie", "b", [0.0, 1.0], "g", [0.0, -0.5], tension={"nominal": 0.4, "low": 0.1}, prestress=0.1)
    tie["tension"]["low"] = 0.2
    loads = {"cases": [{"name": k, "live": [{"body": [x, 0]}]} for k, x in (("right", 1), ("left", -1))]}
    assembly = build_assembly(parse_scene({**block([tie]), "loads": loads}))
    result = solve(assembly)
    assert result.cases["right"].load_factor == pytest.approx(0.9 / 1.5, rel=1e-8)
    assert result.cases["left"].load_factor == pytest.approx(0.5 / 1.5, rel=1e-8)  # P stands at the edge
    robust = solve(build_robust(parse_scene(block([tie]))))
    assert robust.load_factor == pytest.approx((0.5 + 0.2) / 1.5, rel=1e-8)


@pytest.mark.parametrize("prestress", [50.0, 100.0])
def test_rigid_blocks_bear_the_prestress_once(prestress: float) -> None:
    """Blocks of strong cells are solved as rigid ones: they fell under twice the prestress, proven."""
    document = grid_document(["aa", "bb", "##"], tension=1e9, shear=1e9)
    ends = {"from": {"element": "c0r0", "at": [0.05, 0.25]}, "to": {"element": "c1r1", "at": [0.15, 0.15]}}
    document["members"] = [{"kind": "tendon", **ends, "prestress": prestress}]
    found = [solved(document, condense=condense).load_factor for condense in ("auto", "on", "off")]
    assert found == pytest.approx([found[2]] * 3, rel=1e-6)


def test_members_have_no_label() -> None:
    """Labels, tables and JSON are of faces; a labelling may be given without or with what stands for members."""
    assembly = build_assembly(parse_scene(wall(three())))
    count = assembly.faces
    assert len(assembly.interfaces) == count + 4  # a constant force has no unknown
    short = solve(assembly, "d" * count)
    assert short.load_factor == solve(assembly, np.ones(len(assembly.interfaces), dtype=bool)).load_factor
    told = short.to_json()
    assert told["interfaces"] == len(told["faces"]) == len(told["forces"]) == len(short.to_frame()) == count
    facts = {**facts_of_assembly(assembly), **facts_of_result(short)}
    assert facts["members"] == "5: 2 ties, 2 tendons, 1 pins"
    assert facts["interfaces"].startswith(f"{count}: ")
    assert facts["tension"].startswith("tie 1 ")
    assert [one["name"] for one in told["members"]] == ["tie 1", "tie 2", "tendon 3", "tendon 4", "pin 5"]
    with pytest.raises(InputError, match=f"expected {count} labels"):
        solve(assembly, "d" * (count + 1))


@pytest.mark.parametrize(("contact", "friction"), [("concave", "associative"), ("convex", "zero-dilation")])
def test_other_models_have_members(contact: str, friction: str) -> None:
    tie = bar("tie", "b", [0.0, 0.5, 1.0], "g", [0.0, 0.5, -0.5], tension=0.4)
    result = solve(build_assembly(parse_scene(cube([tie], [1, 0, 0]))), contact=contact, friction=friction)
    assert result.load_factor == pytest.approx(0.9 / 1.5, rel=1e-5)
    planar = bar("tie", "b", [0.0, 1.0], "g", [0.0, -0.5], tension=0.4)
    if contact == "convex":
        assert solve(build_assembly(parse_scene(block([planar]))), friction=friction).load_factor == pytest.approx(0.6)


# --- bad input -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        (bar("tie", "b", [0, 1], "b", [1, 2], tension=1.0), "members.0.: all its points belong to element 'b'"),
        (bar("tie", "b", [0, 1], "x", [1, 2], tension=1.0), "members.0..to.element: no element is named 'x'"),
        (bar("tie", "b", [0, 4], "g", [0, 0], tension=1.0), "members.0..from.at: .0, 4. lies outside element 'b'"),
        (bar("tie", "b", [0, 0], "g", [0, 0], tension=1.0), '"from" and "to" are the same point'),
        (bar("tie", "g", [0, 0], "g", [1, 0], tension=1.0), "all its points belong to element 'g'"),
        (bar("tie", "b", [0, 1, 0], "g", [0, 0], tension=1.0), "from.at: it has 3 numbers"),
        (bar("tie", "b", [0, 1], "g", [0, 0], tension=-1.0), "tension: -1.0 is wrong; expected a number of at least 0"),
        (bar("tie", "b", [0, 1], "g", [0, 0], tension="1 m"), "tension: 'm' is no unit of this quantity"),
        (bar("tie", "b", [0, 1], "g", [0, 0]), "tension: a tie without capacity"),
        (bar("tie", "b", [0, 1], "g", [0, 0], tension=1.0, shear=1.0), "shear: a tie carries no shear"),
        (bar("tendon", "b", [0, 1], "g", [0, 0], tension=1.0), "prestress: a tendon without prestress"),
        (bar("tendon", "b", [0, 1], "g", [0, 0], tension=1.0, prestress=2.0), "prestress: 2 exceeds the tension of 1"),
        (bar("tie", "b", [0, 1], "g", [0, 0], prestress=1.0, compression=2.0), "2 is given together with a prestress"),
        (bar("pin", "b", [0, 0], "g", [0, 0], tension=1.0), "shear: a pin without shear capacity"),
        (bar("rope", "b", [0, 1], "g", [0, 0], tension=1.0), 'kind: "rope" is wrong'),
        (bar("tie", "b", [0, 1], "g", [0, 0], tension=1.0, force=1.0), "force: unknown key"),
    ],
)
def test_bad_member_is_one_line(entry: Document, words: str) -> None:
    with refused(match=words):
        build_assembly(parse_scene(block([entry])))


def test_names_of_members_differ() -> None:
    same = bar("tie", "b", [0, 1], "g", [0, 0], tension=1.0, name="one")
    with pytest.raises(InputError, match=r"members\[1\].name: 'one' is used twice"):
        parse_scene(block([same, same]))


# Members at common corners of cells are shared by them: a layout and its mirror image have the same λ.


WIDTH = 4


def beam_of_pieces(member: dict[str, Any], tension: float, flip: bool) -> dict[str, Any]:
    """Four dry blocks on two supports, held together by a tendon and one more member; `flip` mirrors everything."""

    def anchor(column: int, row: int, x: float, y: float) -> dict[str, Any]:
        column, x = (WIDTH - 1 - column, WIDTH - x) if flip else (column, x)
        return {"element": f"c{column}r{row}", "at": [x, y]}

    tendon = {"kind": "tendon", "from": anchor(0, 0, 0.1, 1.3), "to": anchor(3, 0, 3.85, 1.3), "prestress": 1e4}
    places = {key: anchor(*member[key]) for key in ("from", "to")}
    push = {**anchor(1, 0, 1.4, 2.0), "force": [-1e3 if flip else 1e3, -3e3]}
    inner = {"tensile_strength": tension, "shear_strength": 1.5 * tension, "friction_coefficient": 0.5}
    return {
        "grid": {"cell": [1.0, 1.0], "thickness": 1.0, "rows": ["dcba" if flip else "abcd", "#..#"]},
        "materials": {"density": 2000, "dry": {"friction_coefficient": 0.6}, "inner": inner},
        "loads": {"live": [push]},
        "members": [{**member, **places}, tendon],
        "cracks": {"kind": "cells", "cell": 0.5},
    }


@pytest.mark.sampled(3)
@pytest.mark.parametrize("tension", [2e3, 5e3])
@pytest.mark.parametrize(
    "member",
    [
        {"kind": "tendon", "from": (0, 0, 0.5, 1.5), "to": (2, 0, 2.5, 1.5), "prestress": 4e4},
        {
            "kind": "tendon",
            "from": (0, 0, 0.5, 1.5),
            "to": (3, 0, 3.6, 1.6),
            "prestress": 4e4,
            "tension": {"nominal": 5e4, "low": 4.5e4},
        },
        {"kind": "pin", "from": (1, 0, 2.0, 1.5), "to": (2, 0, 2.0, 1.5), "shear": 4e3, "prestress": 3e4},
    ],
)
def test_mirror_images_with_members_at_corners_of_cells_are_alike(member: dict[str, Any], tension: float) -> None:
    one, other = (solve(beam_of_pieces(member, tension, flip)) for flip in (False, True))
    assert one.status == other.status == "collapse"
    assert one.load_factor == pytest.approx(other.load_factor, rel=1e-8)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("at", "names", "shear"),
    [
        ([1.0, 0.5, 0.5], {f"pin 1 ({k} of 4)" for k in (1, 2, 3, 4)}, 250.0),
        ([1.0, 0.5, 0.2], {"pin 1 (1 of 2)", "pin 1 (2 of 2)"}, 500.0),
        ([1.0, 0.3, 0.2], {"pin 1"}, 1e3),
    ],
)
def test_a_pin_without_length_is_shared_along_its_face(at: list[float], names: set[str], shear: float) -> None:
    """Two cubes beside each other, each cut in eight; pieces that touch in an edge or corner alone share nothing."""
    elements = []
    for k, name in enumerate(("a", "b", "s")):
        vertices = [[x + k % 2, y, z - k // 2] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
        faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
        elements.append({"id": name, "vertices": vertices, "faces": faces, "support": name == "s"})
    pin = {"kind": "pin", "from": {"element": "a", "at": at}, "to": {"element": "b", "at": at}, "shear": 1e3}
    scene = parse_scene(
        {
            "elements": elements,
            "materials": dry_and_inner(2000, 0.6, 1e5, 1e5),
            "loads": {"live": [{"body": [1, 0, 0]}]},
            "members": [pin],
        }
    )
    members = build_assembly(refine(scene, (0.5, 0.5, 0.5)).scene).members
    assert set(members.names) == names
    assert members.shear == pytest.approx([shear] * len(names))
    assert np.abs(members.axis) == pytest.approx(np.array([[1.0, 0.0, 0.0]] * len(names)))


@pytest.mark.parametrize("back", [False, True])
def test_the_axis_of_a_pin_where_two_faces_meet_is_asked_for(back: bool) -> None:
    """A block in the corner of an L: the order of the two faces would choose the axis."""
    angle = [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]
    elements = [
        {"id": "l", "polygon": angle},
        {"id": "b", "polygon": [[1, 1], [2, 1], [2, 2], [1, 2]]},
        {"id": "s", "polygon": [[0, -1], [2, -1], [2, 0], [0, 0]], "support": True},
    ]
    ends = {key: {"element": name, "at": [1, 1]} for key, name in (("from", "l"), ("to", "b"))}
    scene = {
        "elements": elements[::-1] if back else elements,
        "materials": {"density": 2000, "dry": {"friction_coefficient": 0.6}},
        "loads": {"live": [{"body": [1, 0]}]},
        "members": [{"kind": "pin", **ends, "shear": 1e3}],
    }
    with pytest.raises(InputError, match="meet at an angle"):
        build_assembly(parse_scene(scene))


def test_shares_of_an_uncertain_member_are_asked_for() -> None:
    """A file of shares would hold values that vary each by itself; λ by cells is that of the mean."""
    member = {"kind": "tendon", "from": (0, 0, 0.5, 1.5), "to": (2, 0, 2.5, 1.5), "prestress": 4e4}
    document = beam_of_pieces({**member, "tension": {"mean": 6e4, "cov": 0.1, "kind": "lognormal"}}, 2e3, False)
    with pytest.raises(InputError, match="uncertain"):
        refine(parse_scene(document), (0.5, 0.5))
    mean = solve(beam_of_pieces({**member, "tension": 6e4}, 2e3, False))
    assert solve(document).load_factor == pytest.approx(mean.load_factor, rel=1e-9)
