"""Errors name parameters in Python and flags on the command line, by one mechanism."""

from __future__ import annotations

import pickle
import re
from pathlib import Path

import pytest
from typer import Context
from typer.main import get_command

from command import ROOT, Command
from jld_core import InputError, ParameterError, SolveOptions
from jld_explore.cli import ending


@pytest.mark.parametrize(
    ("options", "in_python", "on_command_line"),
    [
        (
            {"range": True},
            'range: λ of associative friction is one number; expected `friction="zero-dilation"` with it',
            "--range: λ of associative friction is one number; expected --friction zero-dilation with it",
        ),
        (
            {"floor_seconds": -1.0},
            "floor_seconds: -1 is no number of seconds; ",
            "--floor-seconds: -1 is no number of seconds; ",
        ),
        ({"friction": "assoc"}, "friction: no friction is named 'assoc'", "--friction: no friction is named 'assoc'"),
        ({"solver": "abacus"}, "solver: no solver is named 'abacus'", "--solver: no solver is named 'abacus'"),
    ],
)
def test_parameters_become_flags(options: dict[str, object], in_python: str, on_command_line: str) -> None:
    with pytest.raises(InputError) as caught:
        SolveOptions(**options)
    assert caught.value.parameter == next(iter(options))
    assert str(caught.value).startswith(in_python)
    assert ending.in_flags(caught.value).startswith(on_command_line)


def test_truth_values_become_bare_flags() -> None:
    error = ParameterError("certificate", "not with `robust=True`", "`robust=False`, or `floor_seconds=0`")
    assert ending.in_flags(error) == "--certificate: not with --robust; expected no --robust, or --floor-seconds 0"
    other = InputError("scene.json: elements[3]", "its cells do not add up", "`cell` with another size")
    assert (
        ending.in_flags(other) == "scene.json: elements[3]: its cells do not add up; expected --cell with another size"
    )


@pytest.mark.parametrize("error", [ParameterError("gap", "0 is no width", "a number"), InputError("a", "b", "c")])
def test_errors_survive_the_way_between_processes(error: InputError) -> None:
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.parameter) == (type(error), str(error), error.parameter)


def test_no_error_of_a_library_names_a_flag() -> None:
    """A message raised outside the command line is read in Python as well."""
    raised = re.compile(r"(?:InputError|ParameterError)\((?:[^()]|\([^()]*\))*\)")
    found = [
        f"{path.relative_to(ROOT)}: {call}"
        for path in sorted(Path(ROOT, "src").rglob("*.py"))
        if "cli" not in path.parts
        for call in raised.findall(path.read_text("utf-8"))
        if re.search(r"[\s\"'(]--[a-z]", call)
    ]
    assert found == []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("explore", "scene.json", "-x"), "jld explore --help"),
        (("new", "arch", "--foo", "3"), "jld new --help"),
        (("refin",), "expected refine, or another that jld --help"),
        (("solv", "scene.json"), "expected solve, or another that jld --help"),
        (("new", "wal"), "expected wall, or another that jld new --help"),
        (("solve", "--sovler", "highs"), "expected --solver, or another that jld solve --help"),
        (("xyzzy",), "expected what jld --help"),
    ],
)
def test_an_unknown_option_names_the_help_of_its_command(jld: Command, arguments: tuple[str, ...], said: str) -> None:
    told = jld(*arguments)
    assert (told.code, told.err.count("\n")) == (2, 1)
    assert told.err.endswith(f"{said} lists\n")


def test_o_and_out_are_one_option_of_every_command() -> None:
    from command import app

    group = get_command(app)
    context = Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        for one in [command, *getattr(command, "commands", {}).values()]:
            names = [set(option.opts) for option in one.params]
            assert all(("-o" in each) == ("--out" in each) for each in names), name
