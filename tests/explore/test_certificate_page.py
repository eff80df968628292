"""The checker written from docs/certificate.md alone agrees with `jld verify` and shares no code with it."""

from __future__ import annotations

import ast
import io
import json
import runpy
import subprocess
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import pytest
from benchmarks.claims import certificates
from test_verification import SCENES, TALL, rewritten

from cases import grid_document
from command import Outcome
from jld_core import InputError, parse_scene
from jld_explore import ExploreSettings, explore
from jld_explore.verification import verify
from paths import SCENES as SCENE_FILES

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
    "rough": grid_document(["aa", "aa", "##"], inner_friction=0.9, cohesion=5e2, tension=2e3, shear=3e3, friction=0.5),
    "weights without gravity": {
        **VOUSSOIRS,
        "elements": [
            one if one.get("support") else {**one, "weight": 10.0 + k} for k, one in enumerate(VOUSSOIRS["elements"])
        ],
        "materials": {**VOUSSOIRS["materials"], "gravity": 0},
    },
    "sawing": grid_document(
        ["aaa", "aaa", "###"],
        tension=2e3,
        shear=2e3,
        block_cells=[1, 2],
        sawn_length=[None, 9.0],
        saw_cuts=[1, 40],
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
    assert len(text.splitlines()) <= 150
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


@pytest.mark.parametrize("name", KNOWN)
def test_the_checker_agrees_with_verify(name: str, tmp_path: Path) -> None:
    path = written(KNOWN[name], tmp_path)
    bound = verify(path).claim.bound
    done = checked(path)
    assert done.code == 0, done.err
    assert f"more than {bound:.9g} " in done.out
    lines = lines_of(path)
    lower = {**lines[0], "bound": bound - 1e-4 * abs(bound), "load_factor": None, "labelling": None}
    refused = checked(rewritten([lower, *lines[1:]], path))
    assert refused.code == 1
    assert "refused: " in refused.err


@pytest.mark.parametrize(
    ("name", "words"),
    [("space", "spatial"), ("counts", "search.dry_faces"), ("kept", "search.keep")],
)
def test_keys_unknown_to_the_checker_are_named(name: str, words: str, tmp_path: Path) -> None:
    command = [sys.executable, "-I", str(TOOL), str(written(SCENES[name], tmp_path))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("refused: ")
    assert words in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.fixture(scope="module")
def tall(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    return lines_of(written(TALL, tmp_path_factory.mktemp("tall")))


def _mechanism(lines: list[dict[str, Any]]) -> dict[str, Any]:
    return next(line for line in lines if line.get("dry") or line.get("inner"))


CHANGES: dict[str, Callable[[list[dict[str, Any]]], object]] = {
    "bound": lambda lines: lines[0].update(bound=lines[0]["bound"] * 0.9999, load_factor=None, labelling=None),
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


@pytest.mark.parametrize("name", CHANGES)
def test_both_checkers_refuse_changed_certificates(name: str, tall: list[dict[str, Any]], tmp_path: Path) -> None:
    lines = json.loads(json.dumps(tall))
    CHANGES[name](lines)
    path = rewritten(lines, tmp_path / "changed.jld")
    with pytest.raises(InputError):
        verify(path)
    assert checked(path).code == 1


@pytest.mark.parametrize("name", ["extent", "weight", "mass"])
def test_both_refuse_a_limit_that_was_widened(name: str, tmp_path: Path) -> None:
    """Rules of the limit hold no more, and the bound is that of fewer layouts."""
    path = written(KNOWN[name], tmp_path)
    lines = lines_of(path)
    assert any(key in line for key in ("large", "small") for line in lines[1:])
    search = lines[0]["scene"]["search"]
    search[f"block_{name}"] = [None, 1e6]
    rewritten(lines, path)
    with pytest.raises(InputError, match=r"the rule .* does not follow"):
        verify(path)
    assert "which does not hold" in checked(path).err


def test_both_refuse_another_digest(tall: list[dict[str, Any]], tmp_path: Path) -> None:
    path = rewritten(tall, tmp_path / "whole.jld")
    path.write_bytes(path.read_bytes().replace(b'"made_by": "', b'"made_by": "x', 1))
    with pytest.raises(InputError, match="digest"):
        verify(path)
    assert "digest" in checked(path).err


def test_changed_certificates_are_judged_by_enumeration() -> None:
    tally = certificates.run(first_seed=1000, cases=2, seconds=600.0)
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
