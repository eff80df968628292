"""What the studies around the experiment rest on; the studies themselves take minutes and leave their tables."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from studies import brittle_front, cracking_units, distinct_elements, leonardo_section_3_3, non_planar_faces
from studies.report import SCENES
from studies.scenes import stacked_cubes

from jld_core import build_assembly, load_scene, solve

STRONGEST = "iiidididddddiididdidiiid"
"""The proven best layout of the beam-arch by λ."""


def test_the_layout_that_gives_the_published_load_factor() -> None:
    """Iannuzzo et al. 2024, section 3.3: 2153 N with dilation; 1312 N is among its answers without."""
    assembly = build_assembly(leonardo_section_3_3.found())
    span = solve(assembly, friction="zero-dilation", range=True, floor_seconds=0.0)
    assert span.facts["associative_load_factor"] == pytest.approx(2152.85, abs=0.01)
    assert span.facts["lowest_found"] < 1312.0 < span.facts["highest_found"]


def test_bricks_that_crack() -> None:
    """λ grows with the strength of the brick up to that of rigid bricks, and no strength betters it."""
    size = {"courses": 4, "length": 2}
    rigid = solve(cracking_units.wall(1.0, rigid=True, **size)).load_factor
    found = [solve(cracking_units.wall(strength, **size)).load_factor for strength in (0.5, 1.0, 3.0, 30.0)]
    assert (np.diff(found) > -1e-9).all()
    assert found[0] < 0.8 * rigid
    assert found[-1] == pytest.approx(rigid, rel=1e-6)


@pytest.mark.long
def test_abeilles_vault_punches_through_its_cracks() -> None:
    """Rigid blocks in a fixed frame are locked. Crackable ones give way by shear of eight half middle planes: with
    every 1e5 Pa λ grows by the same, no more than τ times their area."""
    assert str(solve(non_planar_faces.abeille(3, None)).status) == "locked"
    one, two, three = (solve(non_planar_faces.abeille(3, k * 1e5)).load_factor for k in (1, 2, 3))
    assert three - two == pytest.approx(two - one, rel=1e-6)
    area = 8 * non_planar_faces.CELL * non_planar_faces.DEPTH
    assert two - one == pytest.approx(1e5 * area, rel=1e-6)


@pytest.mark.parametrize("facets", [1, 3])
def test_osteomorphic_blocks(facets: int) -> None:
    """Waves lift a block that slides: λ above friction, and below straight sliding up the steepest facet."""
    rigid = solve(non_planar_faces.osteomorphic(facets, None, saddle=False)).load_factor
    assert non_planar_faces.FRICTION < rigid <= non_planar_faces.steepest(facets) * (1.0 + 1e-9)
    saddle = solve(non_planar_faces.osteomorphic(facets, None)).load_factor
    assert solve(non_planar_faces.osteomorphic(facets, non_planar_faces.WEAK)).load_factor < saddle


def test_layouts_below_what_was_carried_are_left_out() -> None:
    """The front by experiment goes from the largest λ down and stops where λ is below what was carried."""
    assembly = build_assembly(load_scene(SCENES / "flat_beam_arch.json"))
    rows = [(STRONGEST, 12, 12.6), (STRONGEST, 12, 5.0), (STRONGEST, 10, 5.0)]
    table = brittle_front.experiments(
        pd.DataFrame(rows, columns=["labelling", "dry_faces", "load_factor"]), assembly, 5
    )
    assert len(table) == 1
    assert 5.0 < table["experiment"].item() < 6.0
    assert not table["open"].item()
    assert brittle_front.front(table, "experiment")["dry_faces"].tolist() == [12]


def test_runs_of_the_study_go_on_where_they_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows are written one by one; a second call makes the missing ones alone, in the same order."""
    monkeypatch.setattr(distinct_elements, "NUMERICS", {distinct_elements.DEFAULT: {"periods": 20.0}})
    monkeypatch.setattr(distinct_elements, "FIELD_SECONDS", 0.1)
    scene = stacked_cubes(2, friction=0.9, tension=0.2, shear=9.0)
    assembly = build_assembly(scene)
    case = distinct_elements.Case("cubes", scene, assembly, (tuple(assembly.labels.tolist()),))
    monkeypatch.setattr(distinct_elements, "limit_analysis", lambda case, layout, kind: replace(_row(case), kind=kind))
    path = tmp_path / "runs.csv"
    assert distinct_elements.run_all(path, [case]) == 6
    whole = pd.read_csv(path, dtype=str)
    path.write_text("\n".join(path.read_text("utf-8").splitlines()[:4]) + "\n", "utf-8")
    assert distinct_elements.run_all(path, [case]) == 3
    again = pd.read_csv(path, dtype=str)
    assert again.drop(columns="seconds").equals(whole.drop(columns="seconds"))
    assert distinct_elements.run_all(path, [case]) == 0
    brittle = whole[whole["inner"] == "brittle"]
    # Five points have I/l² = 3/32: the face cracks at λ = (1 + σt) 3/8, and both cubes rock on at the base at 1/2.
    assert brittle["first_crack"].astype(float).to_numpy() == pytest.approx(0.45, rel=0.03)
    assert brittle["load_factor"].astype(float).to_numpy() == pytest.approx(0.5, rel=0.01)
    assert (whole[whole["kind"] == "experiment"]["energy_error"].astype(float) < 1e-2).all()


def _row(case: distinct_elements.Case) -> distinct_elements.Row:
    return distinct_elements.started(case, 0, "cells", "", "plastic", "friction")
