"""A stopped `jld move` keeps the best so far, and every command ends a signal with one line and exit code 3."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import numpy as np
import pytest

from command import Command
from jld_core import Scene, build_assembly, load_scene, parse_scene, samples, solve
from jld_geometry.field_search import move_by_fields
from jld_geometry.optimise import Point, move_joints


def arch() -> Scene:
    """A small arch whose joints may move."""
    document = samples.arch(voussoirs=7, thickness=0.3).model_dump(mode="json", exclude_defaults=True, by_alias=True)
    document["move"] = {"along": [{"circle": [0, 0]}]}
    return parse_scene(document)


def stop_after(count: int) -> object:
    """Return a progress function that interrupts at one of the accepted points."""
    seen: list[Point] = []

    def progress(point: Point) -> None:
        seen.append(point)
        if len(seen) == count:
            raise KeyboardInterrupt

    return progress


@pytest.mark.parametrize("mover", [move_joints, move_by_fields])
def test_an_interrupt_ends_with_the_best_so_far(mover: object) -> None:
    """Interrupted at its second point, a move returns that point, proven; its scene has the value stated."""
    scene = arch()
    assembly = build_assembly(scene)
    labels = np.ones(len(assembly.interfaces), dtype=bool)
    done = mover(scene, assembly, labels, progress=stop_after(2))  # type: ignore[operator]
    assert done.end == "interrupted"
    assert len(done.points) == 2
    assert done.after is not None
    assert done.after.load_factor == pytest.approx(solve(done.scene).load_factor, rel=1e-5)
    if mover is move_joints:
        assert done.value > done.start
        assert done.value == pytest.approx(done.points[1].value, rel=1e-9)


def test_the_command_writes_its_results_when_interrupted(
    jld: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit code 3, one line, and the scene of the best point; SIGTERM is taken as Ctrl-C is."""
    file, out = tmp_path / "arch.json", tmp_path / "moved.json"
    file.write_text(json.dumps(arch().model_dump(mode="json", exclude_defaults=True, by_alias=True)))

    def mover(*arguments: object, progress: object, **options: object) -> object:
        assert signal.getsignal(signal.SIGTERM) is signal.default_int_handler
        return move_joints(*arguments, progress=stop_after(2), **options)  # type: ignore[arg-type]

    monkeypatch.setattr("jld_geometry.moving.move_joints", mover)
    done = jld("move", file, "-o", out)
    assert (done.code, done.err) == (3, f"stopped; the best so far is in {out}\n")
    assert solve(load_scene(out)).load_factor > solve(arch()).load_factor
    assert out.with_suffix(".csv").exists()


def test_an_interrupt_before_any_result_is_one_line(
    jld: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A command that has nothing to keep says so, with exit code 3."""

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    file = tmp_path / "arch.json"
    file.write_text(json.dumps(arch().model_dump(mode="json", exclude_defaults=True, by_alias=True)))
    monkeypatch.setattr("jld_practice.laying.command.assembly_order", interrupted)
    done = jld("assembly", file)
    assert (done.code, done.out) == (3, "")
    assert done.err.strip() == "stopped; nothing more is written"


def test_a_move_keeps_time_for_its_checks(jld: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The time limit counts from the start of the program, and a fifth of it is kept for checks and picture."""
    given: list[float] = []

    def mover(*arguments: object, seconds: float, **options: object) -> object:
        given.append(seconds)
        return move_joints(*arguments, seconds=0.0, **options)  # type: ignore[arg-type]

    file = tmp_path / "arch.json"
    file.write_text(json.dumps(arch().model_dump(mode="json", exclude_defaults=True, by_alias=True)))
    monkeypatch.setattr("jld_geometry.moving.move_joints", mover)
    assert jld("move", file, "-o", tmp_path / "moved.json", "--seconds", "100").code == 0
    assert 60.0 < given[0] < 80.0
