"""What the studies around the experiment rest on; the studies themselves take minutes and leave their tables."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from studies import brittle_front, cracking_units, leonardo_section_3_3, non_planar_faces
from studies.report import SCENES

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
