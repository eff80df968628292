"""Define the command line; commands are imported when they are called."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from typing import Annotated, Any, Final

import typer
from typer.core import TyperCommand, TyperGroup

from jld_core import plugins
from jld_core._version import __version__
from jld_explore.cli import overview
from jld_explore.cli.ending import run
from jld_explore.cli.streams import say

# Module of this sub-package and function of each command; `new` is a group of commands
_FUNCTIONS: Final = {
    "check": ("check", "check"),
    "explore": ("explore", "explore_command"),
    "solve": ("solve", "solve"),
    "verify": ("check", "verify_command"),
}


def _guard(name: str, command: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(command)
    def guarded(*arguments: Any, **keywords: Any) -> Any:
        with plugins.guarded("jld.commands", name):
            return command(*arguments, **keywords)

    return guarded


def _import_command(name: str) -> Any:
    """Return a command of jld or of a plug-in by its name, None for an unknown one."""
    if name in _FUNCTIONS:
        module, function = _FUNCTIONS[name]
        command = getattr(import_module(f"jld_explore.cli.{module}"), function)
    elif name in plugins.entry_points("jld.commands"):
        command = plugins.load("jld.commands", name)
        if isinstance(command, typer.Typer):  # a group of commands
            return typer.main.get_command(command)
        if not callable(command):
            raise plugins.refuse_type("jld.commands", name, "a function whose parameters are annotated for typer")
    else:
        return None
    if name not in _FUNCTIONS:
        command = _guard(name, command)
    group = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    group.command(name=name, cls=_Command)(command)
    return typer.main.get_command(group)


class _Command(TyperCommand):
    """Command whose help has its options under the headings that they name."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        groups: dict[str, list[Any]] = {"Arguments": [], "Options": []}
        for parameter in self.get_params(ctx):
            if (row := parameter.get_help_record(ctx)) is not None:
                default_heading = "Arguments" if parameter.param_type_name == "argument" else "Options"
                groups.setdefault(getattr(parameter, "rich_help_panel", None) or default_heading, []).append(row)
        for heading, rows in groups.items():
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)


class _Group(TyperGroup):
    """Group of commands that are imported when they are called, which halves the time of a small solve."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(overview.COMMANDS | dict.fromkeys(plugins.entry_points("jld.commands"), ""))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        try:
            return _import_command(cmd_name)
        finally:
            if not gc.isenabled():  # `jld_explore.__main__` disables it while modules load
                gc.freeze()
                gc.enable()

    def format_help(self, ctx: Any, formatter: Any) -> None:
        formatter.write(overview.text())


app = typer.Typer(
    cls=_Group,
    name="jld",
    help="Joint Layout Design: find the strongest way to cut a structure into dry-jointed blocks, with proof.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)


def _version(asked_for: bool) -> None:
    if asked_for:
        from jld_core.batch.library import described as kernel_in_use

        say(f"jld {__version__}, {kernel_in_use()}")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    pass


def main(started: float | None = None) -> None:
    """Run the command line; every error ends in one line on stderr and an exit code."""
    run(app, time.perf_counter() if started is None else started)


if __name__ == "__main__":
    main()
