"""Certificates: what the check states by itself, that it accepts what holds, and that it refuses what does not."""

from __future__ import annotations

import ast
import hashlib
import io
import itertools
import json
import math
import random
import runpy
import subprocess
import sys
from collections.abc import Callable
from contextlib import redirect_stdout, suppress
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.claims import run as run_claim
from pysat.solvers import Solver

from cases import box, dry_and_inner, grid_document
from cases import scene_in_space as spatial_document
from command import SCENES as SCENE_FILES
from command import Command, Outcome, refused
from jld_core import InputError, LimitAnalysis, build_assembly, parse_scene
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.drivers import DRIVERS as KINDS
from jld_explore.space import feasible
from jld_explore.verification import Checker, verify
from jld_explore.verification import certificate as proof_file
from proofs import refutation_of

ROOM = Path(__file__).parents[2] / "src" / "jld_explore" / "verification"

SPATIAL = spatial_document(
    [
        box("ground", [0, 0, -1], [2, 1, 0], support=True),
        *(box(f"{i}{k}", [i, 0, k], [i + 1, 1, k + 1]) for i, k in itertools.product(range(2), range(2))),
    ],
    materials={"inner": {"tensile_strength": 0.3, "shear_strength": 0.4}},
)

CASES = [{"name": "left", "live": [{"body": [1, 0]}], "required": 1.5}, {"name": "right", "live": [{"body": [-1, 0]}]}]

SCENES: dict[str, dict[str, Any]] = {
    "weak": grid_document(["aaaa", "aaaa", "####"], tension=2e3, shear=2e3, block_cells=[1, 2]),
    "counts": grid_document(["aaa", "aaa", "###"], block_cells=[1, 4], dry_faces=[4, 6], tension=2e3, shear=2e3),
    "equal blocks": grid_document(["aaaa", "aaaa", "####"], block_cells=[2, 2], block_weight=[None, 30.0]),
    "extent": grid_document(["aaa", "aaa", "###"], block_extent=[None, 0.2], tension=5e3, shear=8e3),
    "kept": grid_document(
        ["aaa", "aaa", "###"], block_cells=[1, 3], keep={"dry": [["c0r0", "c1r0"]], "inner": [["c1r1", "c2r1"]]}
    ),
    "rough": grid_document(
        ["aaa", "aaa", "###"],
        inner_friction=0.9,
        cohesion=5e2,
        tension=2e3,
        shear=3e3,
        friction=0.5,
        block_mass=[0, 50],
    ),
    "crushing": grid_document(["aaa", "###"], crush_dry=1e5, crush_inner=1e5, tension=2e3, shear=2e3),
    "slits": grid_document(["aa", "aa", "##"], segmentation=False, candidates="all+supports", tension=2e3, shear=2e3),
    # a block of one cell on a support has an inner face, and is too small all the same
    "bonded": grid_document(["aa", "aa", "##"], candidates="all+supports", block_cells=[2, 3], tension=2e3, shear=2e3),
    "bonded slits": grid_document(
        ["aa", "aa", "##"], segmentation=False, candidates="all+supports", block_cells=[2, 3], tension=2e3, shear=2e3
    ),
    "cases": {**grid_document(["aaa", "aaa", "###"], block_cells=[1, 2]), "loads": {"cases": CASES}},
    "space": {**SPATIAL, "search": {"block_cells": [1, 2]}},
}


TALL = grid_document(["aaa", "aaa", "aaa", "aaa", "aaa", "###"], block_cells=[1, 2], tension=5e3, shear=5e3)
"""A wall that turns over before it slides: no mechanism bounds all of its layouts."""


def certificate(document: dict[str, Any], folder: Path) -> tuple[Path, float | None]:
    """A certificate of a scene, and the best that enumeration finds."""
    scene = parse_scene(document)
    every = explore(scene, folder / "every", ExploreSettings(pictures=False, driver="enumeration"))
    path = folder / "proof.jld"
    explore(scene, folder / "exact", ExploreSettings(pictures=False, driver="exact", certificate=path))
    return path, every.summary.best


def checker_of(document: dict[str, Any]) -> Checker:
    """The checker of a certificate that claims a λ of 1e9."""
    scene = parse_scene(document)
    return Checker(scene, build_assembly(scene), proof_file.Claim(document, 1e9))


# --- what is stated once more ------------------------------------------------------------------------------


def test_a_sliding_block_balances_exactly() -> None:
    weigh = checker_of(grid_document(["a", "#"], friction=0.75)).balances[0].weigh
    labels = {0: True}
    slides = weigh({0: (4, 3, 0)}, 2, labels)
    assert slides.spent == Fraction(3, 4) * slides.work  # λ = μ, whatever the weight
    assert slides.proves(Fraction(3, 4))
    assert not slides.proves(Fraction(3, 4) - Fraction(1, 2**60))
    assert weigh({0: (4, 2, 0)}, 2, labels).spent is None  # friction asks for 3/4 of dilation
    assert not weigh({0: (-4, 3, 0)}, 2, labels).proves(Fraction(10**9))  # negative work bounds nothing


def test_dissipation_of_an_inner_face_follows_from_its_strengths() -> None:
    document = grid_document(["a", "#"], tension=2e4, shear=3e4)
    document["labels"] = {"inner": [["c0r0", "c0r1"]]}
    assembly = build_assembly(parse_scene(document))
    area = Fraction(float(assembly.interfaces.area[0]))
    found = checker_of(document).balances[0].weigh({0: (1, 2, 0)}, 0, {0: False})
    lifted = -2 * Fraction(float(assembly.dead[0, 1]))
    assert found.spent == 2 * 20000 * area + 30000 * area + lifted


@pytest.mark.parametrize("name", ["weak", "rough", "crushing", "space"])
def test_balances_are_those_of_the_search_to_rounding(name: str) -> None:
    assembly = build_assembly(parse_scene(SCENES[name]))
    analysis, balances = LimitAnalysis(assembly), checker_of(SCENES[name]).balances[0]
    sets, template, rng = analysis.template.yield_set, analysis.template, np.random.default_rng(3)
    opening = analysis.repair.opening()
    every, free = np.ones(len(assembly.interfaces), dtype=bool), assembly.elements.free
    for share in (0.0, 0.3, 3.0):
        noise = rng.standard_normal(len(opening.velocity)) * abs(opening.velocity).max() * 0.05
        scene_units = (share * opening.velocity + noise).reshape(len(free), -1) / template.scaling.row
        whole = np.round(scene_units / abs(scene_units).max() * 2**40)
        velocity = (whole * 2.0**-40 * template.scaling.row).ravel()
        jumps = analysis.prover.motion(velocity, every, normalise=False).jumps
        dry, inner = (
            np.where(sets.margin(jumps, label) >= 0.0, sets.dissipation(jumps, label), np.inf)
            for label in (every, ~every)
        )
        known = rng.random((2, len(every))) < 0.5
        own = np.where(known[0], np.where(known[1], dry, inner), np.maximum(dry, inner))
        expected = float(own.sum()) - float(template.dead @ velocity)
        labels = {int(f): bool(known[1, f]) for f in np.flatnonzero(known[0])}
        moves = {int(e): tuple(int(v) for v in row) for e, row in zip(free, whole, strict=True)}
        found = balances.weigh(moves, 40, labels)
        assert (found.spent is None) == (not np.isfinite(expected))
        if found.spent is not None:
            size = float(own.sum()) + abs(float(template.dead @ velocity))
            assert float(found.spent) == pytest.approx(expected, abs=1e-12 * max(size, 1.0))


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    "name", ["weak", "counts", "equal blocks", "extent", "kept", "slits", "bonded", "bonded slits"]
)
def test_no_rule_rules_out_a_labelling_of_the_space(name: str) -> None:
    """Whatever numbers a certificate gives: a clause that is accepted holds for every labelling there is."""
    scene = parse_scene(SCENES[name])
    assembly = build_assembly(scene)
    space, rules = search_space(scene, assembly), checker_of(SCENES[name]).labellings
    faces, rng = len(assembly.interfaces), random.Random(7)
    spots = np.flatnonzero(space.candidates)
    assert sorted(rules.fixed) == np.flatnonzero(~space.candidates).tolist()
    assert all(space.fixed[face] == dry for face, dry in rules.fixed.items())
    rows = np.repeat(space.fixed[None], min(2 ** len(spots), 4096), axis=0)
    bits = np.array([rng.getrandbits(len(spots)) if len(spots) > 12 else k for k in range(len(rows))])
    rows[:, spots] = (bits[:, None] >> np.arange(len(spots))) & 1
    kept = rows[feasible(space, rows)]
    assert len(kept)
    accepted = 0
    makers: list[Callable[[list[int]], list[int] | None]] = [
        lambda n: rules.slit(n[0], n[1:]),
        rules.too_large,
        rules.too_small,
    ]
    for _ in range(1500):
        numbers = rng.sample(range(faces), rng.randint(1, min(5, faces)))
        for make in makers:
            clause = make(numbers)
            if clause is not None:
                accepted += 1
                holds = np.zeros(len(kept), dtype=bool)
                for literal in clause:
                    holds |= kept[:, abs(literal) - 1] == (literal < 0)
                assert holds.all(), (make, numbers)
    assert accepted > 20 or name == "slits"
    with Solver("cadical195", bootstrap_with=rules.beginning) as solver:
        for labels in kept[:40]:
            assert solver.solve(assumptions=[-(f + 1) if dry else f + 1 for f, dry in enumerate(labels)])


def test_counts_are_stated_as_they_are_counted() -> None:
    scene = parse_scene(SCENES["counts"])
    assembly = build_assembly(scene)
    rules, faces = checker_of(SCENES["counts"]).labellings, len(assembly.interfaces)
    free = assembly.free_faces
    with Solver("cadical195", bootstrap_with=rules.beginning) as solver:
        for row in itertools.product([True, False], repeat=int(free.sum())):
            labels = np.ones(faces, dtype=bool)
            labels[free] = row
            may = solver.solve(assumptions=[-(f + 1) if dry else f + 1 for f, dry in enumerate(labels.tolist())])
            assert may == (4 <= sum(row) <= 6)


def test_refutations_are_checked_step_by_step() -> None:
    rng, found, checker = random.Random(5), 0, checker_of(SCENES["weak"])

    def follows(literals: Any, by: Any, known: Any) -> bool:
        checker.clauses = dict(known)
        return checker.clause(proof_file.Lemma(tuple(literals), tuple(by))) is not None

    for _ in range(150):
        count = rng.randint(3, 12)
        clauses = [
            [rng.choice([-1, 1]) * v for v in rng.sample(range(1, count + 1), rng.randint(1, 3))]
            for _ in range(int(count * rng.uniform(2, 6)))
        ]
        with Solver("glucose4", bootstrap_with=clauses) as solver:
            satisfiable = solver.solve()
        proof = refutation_of(clauses)
        assert satisfiable == (proof is None)
        if proof is None:
            continue
        found += 1
        known = {place: clauses[place] for place in proof.needed}
        for place, (literals, by) in enumerate(proof.lemmas):
            assert follows(literals, by, known)
            assert not follows(literals, by[:-1], known) or any(-v in literals for v in literals)
            known[len(clauses) + place] = list(literals)
        assert proof.lemmas[-1][0] == ()
        # a lemma that does not follow is refused, whatever it names
        with Solver("glucose4", bootstrap_with=clauses[:2]) as solver:
            if solver.solve():
                assert not follows((), range(2), dict(enumerate(clauses[:2])))
    assert found > 50


def test_verification_imports_nothing_that_searches_or_solves() -> None:
    outside = {"__future__", "collections", "dataclasses", "fractions", "pathlib", "typing"}
    allowed = (
        "jld_core.arrays",
        "jld_core.assembly",
        "jld_core.build",
        "jld_core.build.assemble",
        "jld_core.build.elements",
        "jld_core.lazy_exports",
        "jld_core.errors",
        "jld_core.scene",
        "jld_core.scene.reading",
        "jld_core.scene.schema",
    )
    allowed += (
        "jld_core.strengths",
        "jld_core.mechanics",
        "jld_core.mechanics.criteria",
        "jld_core.files",
        "jld_core.scene.standard",
        "jld_core.scene.uncertain",
        "jld_core.tolerances",
        "jld_core",
        "jld_explore.verification",
    )
    for path in ROOM.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                module = str(node.module)
                own = module.startswith("jld")
                assert not own or module.startswith(allowed[-1]) or module in allowed, f"{path.name}: {module}"
                assert module != "jld_core" or [name.name for name in node.names] == ["tolerances"]
                assert own or module.split(".")[0] in outside
                if module.startswith("jld_core.mechanics"):  # what criteria state of a face, and no more
                    assert {name.name for name in node.names} <= {"Gauge", "stated_rows"}
            elif isinstance(node, ast.Import):
                assert {name.name for name in node.names} <= {"hashlib", "json", "math", "numpy", "os", "time"}


# --- certificates that do not hold -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def proof(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """The lines of a certificate without its digest."""
    folder = tmp_path_factory.mktemp("proof")
    path = folder / "proof.jld"
    explore(parse_scene(TALL), folder / "out", ExploreSettings(pictures=False, driver="exact", certificate=path))
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()[:-1]]


def rewritten(lines: list[dict[str, Any]], path: Path) -> Path:
    """The file of these lines, with the digest that they have."""
    text = "".join(json.dumps(line) + "\n" for line in lines)
    digest = hashlib.sha256(text.encode()).hexdigest()
    path.write_text(text + json.dumps({"sha256": digest}) + "\n", encoding="utf-8")
    return path


def first(lines: list[dict[str, Any]], key: str) -> int:
    return next(k for k, line in enumerate(lines) if key in line and (key != "moves" or line["dry"] or line["inner"]))


def lower(lines: list[dict[str, Any]]) -> None:
    lines[0]["bound"] *= 0.999


def flip(lines: list[dict[str, Any]]) -> None:
    velocity = next(iter(lines[first(lines, "moves")]["moves"].values()))
    velocity[0] = -velocity[0]


def drop(lines: list[dict[str, Any]]) -> None:
    del lines[first(lines, "moves")]


def free(lines: list[dict[str, Any]]) -> None:
    line = lines[first(lines, "moves")]
    line["dry"], line["inner"] = [], []


def shorten(lines: list[dict[str, Any]]) -> None:
    lines[first(lines, "large")]["large"].pop()


def borrow(lines: list[dict[str, Any]]) -> None:
    lines[0]["scene"]["materials"]["inner"]["tensile_strength"] = 4e4


def cut(lines: list[dict[str, Any]]) -> None:
    lines[-1]["by"] = lines[-1]["by"][1:]


def stop(lines: list[dict[str, Any]]) -> None:
    del lines[-1]


def support(lines: list[dict[str, Any]]) -> None:
    line = lines[first(lines, "moves")]
    line["moves"]["16"] = next(iter(line["moves"].values()))


def excuse(lines: list[dict[str, Any]]) -> None:
    lines[0]["scene"]["search"]["except"] = ["c0r0"]


def widen(lines: list[dict[str, Any]]) -> None:
    lines[0]["scene"]["search"]["block_cells"] = [1, 3]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "harm", [lower, flip, drop, free, shorten, borrow, cut, stop, support, widen, excuse], ids=lambda f: f.__name__
)
def test_changed_certificates_are_refused(
    harm: Callable[[list[dict[str, Any]]], None], proof: list[dict[str, Any]], tmp_path: Path
) -> None:
    assert verify(rewritten(proof, tmp_path / "whole.jld")).mechanisms
    lines = json.loads(json.dumps(proof))
    harm(lines)
    with refused():
        verify(rewritten(lines, tmp_path / "harmed.jld"))


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("bound", float("nan"), "no finite number"),
        ("bound", float("inf"), "no finite number"),
        ("bound", float("-inf"), "no finite number"),
        ("bound", 10**400, "no finite number"),
        ("bound", True, "no finite number"),
        ("bound", "1", "no finite number"),
        ("load_factor", float("nan"), "no finite number"),
        ("load_factor", 1e9, "above its own bound"),
        ("load_factor", None, "one is null"),
        ("labelling", "dx", "letters d and i"),
        ("labelling", "d", "has 1 letters"),
        ("labelling", 5, "letters d and i"),
        ("made_by", 5, "no text"),
        ("jld certificate", 2, "version 2"),
        ("jld certificate", 1.0, "version 1.0"),
        ("more", 1, "'more'"),
    ],
)
def test_a_claim_that_is_none_is_refused(
    key: str, value: object, words: str, proof: list[dict[str, Any]], tmp_path: Path
) -> None:
    lines = [{**proof[0], key: value}, *proof[1:]]
    with refused(words):
        verify(rewritten(lines, tmp_path / "claim.jld"))


def test_a_bound_in_whole_numbers_is_a_bound(proof: list[dict[str, Any]], tmp_path: Path) -> None:
    lines = [{**proof[0], "bound": math.ceil(proof[0]["bound"])}, *proof[1:]]
    assert verify(rewritten(lines, tmp_path / "whole.jld")).claim.bound == lines[0]["bound"]


def test_a_labelling_with_a_label_that_is_fixed_is_refused(proof: list[dict[str, Any]], tmp_path: Path) -> None:
    labelling = "".join("i" for _ in proof[0]["labelling"])
    with pytest.raises(InputError, match=r"letter .* is 'i'"):
        verify(rewritten([{**proof[0], "labelling": labelling}, *proof[1:]], tmp_path / "fixed.jld"))


@pytest.mark.parametrize("place", ["file/proof.jld", "out", "out/summary.json", "x" * 250])
def test_a_file_that_cannot_be_written_is_refused_before_the_search(place: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    settings = ExploreSettings(pictures=False, driver="exact", certificate=tmp_path / place)
    with pytest.raises(InputError, match="certificate: "):
        explore(parse_scene(SCENES["weak"]), tmp_path / "out", settings)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_refusals_are_one_line(proof: list[dict[str, Any]], tmp_path: Path, jld: Command) -> None:
    whole = rewritten(proof, tmp_path / "whole.jld")
    text = whole.read_text(encoding="utf-8")
    (tmp_path / "byte.jld").write_text(text.replace('"load_factor":', '"load_factor": ', 1), encoding="utf-8")
    (tmp_path / "half.jld").write_text(text[: len(text) // 2], encoding="utf-8")
    (tmp_path / "scene.json").write_text(json.dumps(SCENES["kept"]), encoding="utf-8")
    (tmp_path / "own.json").write_text(json.dumps(TALL), encoding="utf-8")
    good = jld("verify", whole, "--scene", tmp_path / "own.json", "--json")
    assert json.loads(good.out)["bound"] == proof[0]["bound"]
    for arguments, words in (
        ([tmp_path / "byte.jld"], "digest"),
        ([tmp_path / "half.jld"], "not whole"),
        ([tmp_path / "scene.json"], "no certificate"),
        ([tmp_path / "none.jld"], "No such file"),
        ([whole, "--scene", tmp_path / "scene.json"], "another scene"),
    ):
        jld("verify", *arguments).refused(words)


@pytest.mark.parametrize(
    ("document", "options", "words"),
    [
        (SCENES["weak"], {"driver": "genetic"}, "no proof to write"),
        (SCENES["weak"], {"driver": "exact", "options": {"aim": "front"}}, "whole front"),
        (grid_document(["aaa", "###"], **{"except": ["c0r0"]}), {"driver": "exact"}, "search.except"),
        (grid_document(["aaa", "###"]), {"driver": "exact", "robust": True}, "robust"),
        ({**SPATIAL, "materials": {**SPATIAL["materials"], "dry": {"friction_angle": 30, "compressive_strength": 9.0}}},
         {"driver": "exact"}, "crushing in space"),
    ],
)  # fmt: skip
def test_searches_without_a_certificate_are_refused_before_they_begin(
    document: dict[str, Any], options: dict[str, Any], words: str, tmp_path: Path
) -> None:
    settings = ExploreSettings(pictures=False, certificate=tmp_path / "proof.jld", **options)
    with pytest.raises(InputError, match=words):
        explore(parse_scene(document), tmp_path / "out", settings)
    assert not (tmp_path / "proof.jld").exists()


def test_a_limit_that_decides_has_no_certificate_and_one_that_does_not_has(tmp_path: Path) -> None:
    """Clauses do not express limits on shapes and blocks: the proof has to hold without them."""
    rows = ["aaa", "aaa", "###"]
    best = explore(
        parse_scene(grid_document(rows, tension=2e3, shear=2e3)), driver="exact", pictures=False
    ).summary.best
    for number, limits in enumerate(({"block_aspect": [None, 9]}, {"blocks": [1, 6]}, {"shapes": [1, 6]})):
        path = tmp_path / f"{number}.jld"
        scene = parse_scene(grid_document(rows, tension=2e3, shear=2e3, **limits))
        done = explore(scene, driver="exact", certificate=path, pictures=False)
        assert verify(path, scene).claim.bound >= done.summary.best == pytest.approx(best, rel=1e-6)
    scene = parse_scene(grid_document(rows, tension=2e3, shear=2e3, blocks=[6, 6]))
    if explore(scene, driver="exact", pictures=False).summary.best < 0.99 * best:
        with pytest.raises(InputError, match="which a limit that it cannot express excludes"):
            explore(scene, driver="exact", certificate=tmp_path / "decides.jld", pictures=False)


def test_a_claim_alone_proves_nothing() -> None:
    with pytest.raises(InputError, match="leave labellings"):
        checker_of(SCENES["weak"]).check([])


# The checker written from docs/certificate.md alone agrees with `jld verify` and shares no code with it.


TOOL = Path(__file__).parents[2] / "tools" / "check_certificate.py"

VOUSSOIRS: dict[str, Any] = {
    "elements": [
        {"id": "left", "polygon": [[-1, 0], [0, 0], [0.3, 1], [-1, 1]], "support": True},
        *(
            {"id": f"v{k}", "polygon": [[k, 0], [k + 1, 0], [k + 1 - t, 1], [k - s, 1]]}
            for k, (s, t) in enumerate([(-0.3, -0.1), (-0.1, 0.1), (0.1, 0.3)])
        ),
        {"id": "right", "polygon": [[3, 0], [4, 0], [4, 1], [2.7, 1]], "support": True},
    ],
    "thickness": 0.5,
    "materials": {
        "density": 2000,
        "dry": {"friction_angle": 35, "compressive_strength": 2e6},
        "inner": {"tensile_strength": 1e5, "shear_strength": 2e5, "compressive_strength": 5e6},
    },
    "loads": {"live": [{"element": "v1", "force": [0.2, -1], "at": [1.4, 1], "moment": 0.1}]},
    "search": {"block_cells": [1, 2]},
}
"""A flat arch of voussoirs that are no rectangles, crushing."""

KNOWN: dict[str, Any] = {
    **{name: SCENES[name] for name in ("weak", "crushing", "slits", "bonded", "bonded slits", "cases")},
    **{
        name: grid_document(["aaa", "aaa", "###"], tension=1e5, shear=1e5, **{f"block_{name}": limits})
        for name, limits in {"extent": [None, 0.15], "weight": [20.0, 30.0], "mass": [2.0, 3.0]}.items()
    },
    "tall": TALL,
    "voussoirs": VOUSSOIRS,
    "rough, small": grid_document(
        ["aa", "aa", "##"], inner_friction=0.9, cohesion=5e2, tension=2e3, shear=3e3, friction=0.5
    ),
    "weights without gravity": {
        **VOUSSOIRS,
        "elements": [
            one if one.get("support") else {**one, "weight": 10.0 + k} for k, one in enumerate(VOUSSOIRS["elements"])
        ],
        "materials": {**VOUSSOIRS["materials"], "gravity": 0},
    },
    "sawing": grid_document(
        ["aaa", "aaa", "###"], tension=2e3, shear=2e3, block_cells=[1, 2], sawn_length=[None, 9.0], saw_cuts=[1, 40]
    ),
    "beam": json.loads((SCENE_FILES / "flat_beam_arch.json").read_text(encoding="utf-8")),
}


def written(document: dict[str, Any], folder: Path) -> Path:
    path = folder / "proof.jld"
    explore(parse_scene(document), folder / "out", ExploreSettings(pictures=False, driver="exact", certificate=path))
    return path


def checked(path: Path) -> Outcome:
    """Run the checker in this process; what it raises refuses as well."""
    out = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out):
        patch.setattr(sys, "argv", [str(TOOL), str(path)])
        try:
            runpy.run_path(str(TOOL))
        except (SystemExit, Exception) as end:
            return Outcome(1, out.getvalue(), f"{end}\n")
    return Outcome(0, out.getvalue(), "")


def lines_of(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()[:-1]]


def test_the_checker_is_short_and_shares_nothing() -> None:
    text = TOOL.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 202
    used = {
        name
        for node in ast.walk(ast.parse(text))
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [str(node.module)]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    assert used <= set(sys.stdlib_module_names)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", SCENES | KNOWN)
def test_certificates_hold_and_meet_enumeration(name: str, tmp_path: Path) -> None:
    """By `verify` and by the checker alike, which both refuse a bound that is a little lower."""
    document = (KNOWN | SCENES)[name]
    path, best = certificate(document, tmp_path)
    claim = verify(path, parse_scene(document)).claim
    assert best * (1.0 - 1e-6) <= claim.bound <= best * (1.0 + 2e-6)
    assert claim.load_factor == pytest.approx(best, rel=1e-6)
    if name not in KNOWN:
        return
    done = checked(path)
    assert done.code == 0, done.err
    assert f"more than {claim.bound:.9g} " in done.out
    lines = lines_of(path)
    lower = {**lines[0], "bound": claim.bound - 1e-4 * abs(claim.bound), "load_factor": None, "labelling": None}
    refused = checked(rewritten([lower, *lines[1:]], path))
    assert refused.code == 1
    assert "refused: " in refused.err


@pytest.mark.parametrize(
    ("name", "words"), [("space", "spatial"), ("counts", "search.dry_faces"), ("kept", "search.keep")]
)
def test_keys_unknown_to_the_checker_are_named(name: str, words: str, tmp_path: Path) -> None:
    command = [sys.executable, "-I", str(TOOL), str(written(SCENES[name], tmp_path))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("refused: ")
    assert words in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.fixture(scope="module")
def tall(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    return lines_of(written(TALL, tmp_path_factory.mktemp("tall")))


def _mechanism(lines: list[dict[str, Any]]) -> dict[str, Any]:
    return next(line for line in lines if line.get("dry") or line.get("inner"))


def _blocks_at_rest(lines: list[dict[str, Any]]) -> None:
    """Claim a lower bound by a ceiling and blocks that do not move, which bound nothing between the two."""
    rest = {"dry": [], "inner": [], "case": 0, "digits": 0, "walls": {}, "prices": {}, "blocks": []}
    lines[0].update(bound=lines[0]["bound"] * 0.5, load_factor=None, labelling=None)
    lines[1:] = [_mechanism(lines) | {"dry": [], "inner": []}, rest]


CHANGES: dict[str, Callable[[list[dict[str, Any]]], object]] = {
    "bound": lambda lines: lines[0].update(bound=lines[0]["bound"] * 0.9999, load_factor=None, labelling=None),
    "blocks at rest": _blocks_at_rest,
    "infinite bound": lambda lines: lines[0].update(bound=float("inf")),
    "load_factor": lambda lines: lines[0].update(load_factor=lines[0]["bound"] * 1.01),
    "version": lambda lines: lines[0].update({"jld certificate": 2}),
    "stronger": lambda lines: lines[0]["scene"]["materials"]["inner"].update(tensile_strength=4e4, shear_strength=4e4),
    "larger blocks": lambda lines: lines[0]["scene"]["search"].update(block_cells=[1, 3]),
    "live load": lambda lines: lines[0]["scene"]["loads"]["live"][0].update(body=[0.9, 0]),
    "dry": lambda lines: _mechanism(lines).update(dry=[], inner=[]),
    "case": lambda lines: _mechanism(lines).update(case=1),
    "digits": lambda lines: _mechanism(lines).update(digits=_mechanism(lines)["digits"] - 1, dry=[0]),
    "moves": lambda lines: next(iter(_mechanism(lines)["moves"].values())).reverse(),
    "element": lambda lines: _mechanism(lines)["moves"].update({"16": [0, 1, 0]}),
    "large": lambda lines: next(line for line in lines if "large" in line)["large"].pop(),
    "by": lambda lines: lines[-1].update(by=lines[-1]["by"][1:]),
    "lemma": lambda lines: lines.pop(),
    "order": lambda lines: lines[1:].reverse() or lines.insert(1, lines.pop()),
}


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """The lines of a certificate of bounds by possible blocks, of a search that was stopped."""
    folder = tmp_path_factory.mktemp("stopped")
    scene = parse_scene(BLOCKS)
    space = search_space(scene, build_assembly(scene))
    driver = KINDS["exact"](space, search=0, programs=12, by_blocks="on")
    settings = ExploreSettings(pictures=False, small=0, certificate=folder / "proof.jld")
    bound = explore(scene, folder / "out", settings, driver=driver).summary.bound
    lines = lines_of(folder / "proof.jld")
    assert lines[0]["bound"] == pytest.approx(bound, rel=1e-6)
    return lines


def _blocks(lines: list[dict[str, Any]]) -> dict[str, Any]:
    return next(line for line in lines if "walls" in line)


BLOCKS = grid_document(["aaaa"] * 5 + ["####"], block_cells=[1, 2], tension=2e4, shear=2e4, friction=0.75)

BLOCK_CHANGES: dict[str, Callable[[list[dict[str, Any]]], object]] = {
    "bound": lambda lines: lines[0].update(bound=0.664, load_factor=None, labelling=None),
    "labels": lambda lines: _blocks(lines).update(dry=[], inner=[]),
    "walls": lambda lines: next(iter(_blocks(lines)["walls"].values())).reverse(),
    "prices": lambda lines: next(iter(_blocks(lines)["prices"].values())).reverse(),
    "a block": lambda lines: _blocks(lines)["blocks"].pop(),
    "velocities": lambda lines: max(_blocks(lines)["blocks"], key=lambda one: max(map(abs, one[1])))[1].reverse(),
    "ceiling": lambda lines: lines.pop(1),
    "larger blocks": lambda lines: lines[0]["scene"]["search"].update(block_cells=[1, 3]),
}


def test_bounds_by_blocks_have_certificates(stopped: list[dict[str, Any]], tmp_path: Path) -> None:
    """The bound of a search that was stopped, above the best of all layouts (benchmarks/results/exact.md)."""
    path = rewritten(stopped, tmp_path / "whole.jld")
    assert 0.6644093 < verify(path, parse_scene(BLOCKS)).claim.bound < 0.75
    assert any("walls" in line for line in stopped)
    done = checked(path)
    assert done.code == 0, done.err


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("kind", "name"), [*(("tall", name) for name in CHANGES), *(("stopped", name) for name in BLOCK_CHANGES)]
)
def test_both_checkers_refuse_changed_certificates(
    kind: str, name: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    lines = json.loads(json.dumps(request.getfixturevalue(kind)))
    (CHANGES if kind == "tall" else BLOCK_CHANGES)[name](lines)
    path = rewritten(lines, tmp_path / "changed.jld")
    with pytest.raises(InputError):
        verify(path)
    assert checked(path).code == 1


@pytest.mark.parametrize("name", ["extent", "weight", "mass"])
def test_both_refuse_a_limit_that_was_widened(name: str, tmp_path: Path) -> None:
    """Rules of the limit hold no more, and the bound is that of fewer layouts."""
    path = written(KNOWN[name], tmp_path)
    lines = lines_of(path)
    assert any(key in line for key in ("large", "small", "walls") for line in lines[1:])
    search = lines[0]["scene"]["search"]
    search[f"block_{name}"] = [None, 1e6]
    rewritten(lines, path)
    with pytest.raises(InputError, match=r"the rule .* does not follow|its mechanism does not prove"):
        verify(path)
    assert "which does not hold" in checked(path).err


def test_both_refuse_another_digest(tall: list[dict[str, Any]], tmp_path: Path) -> None:
    path = rewritten(tall, tmp_path / "whole.jld")
    path.write_bytes(path.read_bytes().replace(b'"made_by": "', b'"made_by": "x', 1))
    with pytest.raises(InputError, match="digest"):
        verify(path)
    assert "digest" in checked(path).err


def test_changed_certificates_are_judged_by_enumeration() -> None:
    tally = run_claim("certificates", 1000, 2, 600.0)
    assert tally.disagreements == []
    assert tally.notes["refused"] > tally.notes["accepted"] > 0


def test_both_refuse_a_bound_that_forgets_weights(tmp_path: Path) -> None:
    """Without gravity a stated weight acts downwards: a bound that leaves it out is far too low."""
    path = written(KNOWN["weights without gravity"], tmp_path)
    lines = lines_of(path)
    lines[0].update(bound=lines[0]["bound"] * 0.5, load_factor=None, labelling=None)
    rewritten(lines, path)
    with pytest.raises(InputError):
        verify(path)
    assert checked(path).code == 1


# Members, limits and drivers together: `--certificate` ends in a certificate that verifies, or in one line.


CELL = 2000 * 9.81 * 0.4 * 0.3 * 0.2
LIMITS: dict[str, list[Any]] = {
    "block_cells": [[1, 2], [2, 3], [1, 3]],
    "block_weight": [[1.5 * CELL, None], [0, 3.2 * CELL]],
    "block_mass": [[1.5 * CELL / 9.81, None]],
    "block_extent": [[None, 0.85], [None, 1.3]],
    "dry_faces": [[1, 5], [2, None]],
    "candidates": ["all", "all+supports"],
    "segmentation": [False],
}
NARROWER: dict[str, list[Any]] = {
    "blocks": [[1, 3]],
    "shapes": [[1, 3]],
    "convex_blocks": [True],
    "saw_cuts": [[1, 30]],
    "sawn_length": [[None, 8.0]],
    "assemble": ["translation"],
}
DRIVERS = ("exact", "exact", "exact", "enumeration", "genetic")


def _document(seed: int) -> dict[str, Any]:
    """Return a wall of at most six cells with members, load cases and limits drawn at random."""
    draw = random.Random(seed)
    columns, rows = draw.choice([(2, 2), (2, 3), (3, 2), (1, 3)])
    grid = ["".join(draw.choice("abc") for _ in range(columns)) for _ in range(rows)] + ["#" * columns]
    free = [(c, r) for r in range(rows) for c in range(columns)]
    every = [*free, *((c, rows) for c in range(columns))]

    def end(place: tuple[int, int]) -> dict[str, Any]:
        """Return a point within a cell."""
        at = [(place[0] + draw.uniform(0.1, 0.9)) * 0.4, (rows - place[1] + draw.uniform(0.1, 0.9)) * 0.3]
        return {"element": f"c{place[0]}r{place[1]}", "at": at}

    members = []
    for _ in range(draw.choice([0, 1, 2])):
        first = draw.choice(free)
        second = draw.choice([one for one in every if one != first])
        member = {"kind": draw.choice(["tie", "tendon", "pin"]), "from": end(first), "to": end(second), "tension": 20.0}
        if member["kind"] == "pin":
            member |= {"compression": 20.0, "shear": 5.0}
        members.append(member)
    document: dict[str, Any] = {
        "name": f"random {seed}",
        "grid": {"cell": [0.4, 0.3], "thickness": 0.2, "rows": grid},
        "materials": dry_and_inner(2000, draw.choice([0.3, 0.6]), draw.choice([1e3, 5e3]), 4e3),
        "loads": {"live": [{"body": draw.choice([[1, 0], [0.5, -0.2]])}]},
        "search": {
            key: draw.choice(values)
            for share, limits in ((0.3, LIMITS), (0.1, NARROWER))
            for key, values in limits.items()
            if draw.random() < share
        },
    }
    if members:
        document["members"] = members
    if draw.random() < 0.25:
        cases = [("right", 1), ("left", -1)]
        document["loads"] = {"cases": [{"name": name, "live": [{"body": [x, 0]}]} for name, x in cases]}
    return document


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", [*range(12), *(pytest.param(k, marks=pytest.mark.long) for k in range(12, 150))])
def test_a_certificate_verifies_or_is_refused_in_one_line(seed: int, tmp_path: Path) -> None:
    path = tmp_path / "proof.jld"
    with suppress(InputError):  # one line by construction
        scene = parse_scene(_document(seed))
        done = explore(scene, driver=DRIVERS[seed % len(DRIVERS)], certificate=path, pictures=False, seconds=30)
        assert verify(path, scene).claim.bound >= done.summary.best


def test_a_pin_beside_a_lower_limit_on_blocks(tmp_path: Path) -> None:
    """A member bounds no block: the rule that a block is too small speaks of faces alone."""
    document = _document(0)
    document["grid"]["rows"] = ["aa", "aa", "##"]
    document["search"] = {"block_weight": [1.5 * CELL, None]}
    document["loads"] = {"live": [{"body": [1, 0]}]}
    pin = {"kind": "pin", "tension": 5.0, "compression": 20.0, "shear": 5.0}
    ends = {"from": {"element": "c1r0", "at": [0.6, 0.7]}, "to": {"element": "c1r1", "at": [0.6, 0.5]}}
    document["members"] = [{**pin, **ends}]
    path = tmp_path / "proof.jld"
    done = explore(parse_scene(document), driver="exact", certificate=path, pictures=False)
    assert verify(path).claim.bound >= done.summary.best


def test_that_no_layout_stands_has_a_certificate(tmp_path: Path) -> None:
    """A motion that the dead load alone drives refutes every λ ≥ 0."""
    document = grid_document(["aaa", "a..", "#.."], tension=1e3, shear=1e3)
    path = tmp_path / "proof.jld"
    done = explore(parse_scene(document), driver="exact", certificate=path, pictures=False)
    assert done.summary.best is None
    assert 0.0 <= verify(path).claim.bound < 1e-6
