"""Orders without solved stages: every block has a way out, and the command gives them where time is short."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from command import Command
from jld_core import Scene, build_assembly, samples
from jld_core.deadline import DeadlinePassed
from jld_practice.laying.freedom import Freedom, blocks_of_labelling
from jld_practice.laying.quick import order_without_stages
from jld_practice.laying.standing import Parts


@pytest.mark.parametrize("make", [samples.wall, samples.arch])
def test_every_block_can_be_removed_in_reverse(make: Callable[[], Scene]) -> None:
    """Replay the order backwards: each block has a way out, and all free blocks are laid once."""
    assembly = build_assembly(make())
    labels = np.ones_like(assembly.labels)
    laying = order_without_stages(assembly, labels)
    assert laying is not None
    blocks = blocks_of_labelling(assembly, labels)
    freedom, there = Freedom(blocks), np.ones(len(blocks), dtype=bool)
    for step in reversed(laying.steps):
        assert len(step.blocks) == 1
        assert freedom.way_out(step.blocks[0], there) is not None
        there[list(step.blocks)] = False
    assert np.array_equal(there, blocks.fixed)
    assert laying.stands is None


def test_an_order_is_given_where_stages_take_too_long(
    jld: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The time is over at the first stage: the order says that its props are not known, and the table is blank."""

    def too_late(*_: object) -> None:
        raise DeadlinePassed

    monkeypatch.setattr(Parts, "_solved", too_late)
    file = tmp_path / "arch.json"
    file.write_text(samples.arch(voussoirs=7).model_dump_json(exclude_defaults=True))
    for line in ((), ("--props", "100")):
        done = jld("assembly", file, "--seconds", "60", "--out", tmp_path / "out", *line)
        assert done.code == 0, done.err
        assert "7 blocks in 7 steps, props not known and not minimal" in done.out
        table = pd.read_csv(tmp_path / "out" / "assembly.csv")
        assert len(table) == 7
        forces = [column for column in table.columns if column.startswith("props_") and column != "props_along"]
        assert table[forces].isna().all().all()
