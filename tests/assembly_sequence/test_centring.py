"""Centring of an arch: when it may be struck; stages as an animation; the time limit of `jld assembly`."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from PIL import Image

from command import Command
from jld_core import build_assembly, load_scene, samples
from jld_practice.laying import assembly_order
from jld_practice.laying.command import words_of


@pytest.fixture
def arch(tmp_path: Path) -> Path:
    """Arch of seven voussoirs, which stands once its keystone is laid and not before."""
    path = tmp_path / "arch.json"
    path.write_text(samples.arch(voussoirs=7).model_dump_json(exclude_defaults=True))
    return path


def test_an_arch_is_struck_when_its_keystone_is_laid(jld: Command, arch: Path, tmp_path: Path) -> None:
    """Props stand until the last stone closes the arch; the line names the step of the table."""
    out = tmp_path / "out"
    done = jld("assembly", arch, "--start", "springings", "--out", out, "--animation")
    assert done.code == 0, done.err
    table = pd.read_csv(out / "assembly.csv")
    needed = table["step"][table["props_N"] > 0.0]
    assert needed.max() == len(table) - 1 == 6
    assert table["stands"].iloc[-1] == "yes"
    assert dict(zip(table["stone"], table["block"], strict=True))[3] == "v2r0"
    assert f"centring     from step {needed.min()}, in turn below" in done.out
    assert "it may be struck after step 7" in done.out
    with Image.open(out / "assembly.gif") as animation:
        assert getattr(animation, "n_frames", 1) == len(table)


def test_a_stage_that_was_not_solved_keeps_the_centring(arch: Path) -> None:
    """Without props and without a proof the last stage does not free it."""
    assembly = build_assembly(load_scene(arch))
    laying = assembly_order(assembly, assembly.labels, start="springings")
    last = laying.steps[-1]
    assert "it may be struck after step 7" in words_of(laying)
    undecided = replace(last, stage=replace(last.stage, error=math.inf))
    words = words_of(replace(laying, steps=(*laying.steps[:-1], undecided)))
    assert "may be struck" not in words
    assert "that the finished structure stands without it is not proven" in words


def test_a_wall_needs_no_centring(jld: Command, tmp_path: Path) -> None:
    """Courses on the ground stand; the line of the centring is left out."""
    wall = tmp_path / "wall.json"
    wall.write_text(samples.wall(courses=2, length=0.8).model_dump_json(exclude_defaults=True))
    done = jld("assembly", wall)
    assert done.code == 0
    assert "stands without props" in done.out
    assert "centring" not in done.out


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--animation"], "--animation: there is no folder"),
        (["--seconds", "-1"], "--seconds: -1 s are no time"),
        (["--seconds", "1e-9"], "--seconds: no order was found in 1e-09 s"),
    ],
)
def test_bad_options_are_one_line(jld: Command, arch: Path, flags: list[str], words: str) -> None:
    """Exit code 2, one line."""
    done = jld("assembly", arch, *flags)
    assert done.code == 2
    assert words in done.err
    assert done.err.count("\n") == 1
