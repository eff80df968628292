"""Define arguments and options shared by the commands."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Final, Literal, get_args, get_type_hints

import typer

from jld_core.errors import InputError
from jld_core.files import write_text
from jld_core.scene.cracks import parse_cracks
from jld_core.scene.schema import Scene
from jld_explore.cli.ending import flag_of, with_flags

Out = Annotated[Path, typer.Option("-o", "--out", help="Scene file to write.", show_default=False)]
SceneFile = Annotated[Path, typer.Argument(help="Scene file (JSON).", show_default=False)]
Source = Annotated[Path, typer.Argument(help="A scene file, or a folder written by jld explore.", show_default=False)]
Rank = Annotated[int | None, typer.Option(min=1, help="Row of a folder's results.csv; default 1.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]


def refuse_itself(source: Path, out: Path) -> None:
    """Raise InputError if the output file is the input file."""
    if out.exists() and source.exists() and out.samefile(source):
        raise InputError(str(out), "it is the file that is read", "another file")


Strict = Annotated[bool, typer.Option("--strict", help="Treat plausibility warnings as errors.")]

Robust = Annotated[
    bool, typer.Option("--robust", help="Use the low values of materials; λ at nominal values is stated as well.")
]


Option = tuple[Any, Any]  # annotation and default of an option of a command

READING: Final[dict[str, Option]] = {
    name: (Annotated[kind | None, typer.Option(f"--{name}", help=words)], None)
    for name, kind, words in (
        ("layer", list[str], "Only these layers are read, beside those with a role; * and ?, may be given again."),
        ("skip", list[str], "Layers that are not read."),
        ("hole", list[str], "Layers of openings."),
        ("support", list[str], "Layers of supports, or: lowest."),
        ("load", list[str], "Layers of live loads; numbered layers are load cases."),
        ("dry", list[str], "Layers of dry joints."),
        ("inner", list[str], "Layers of inner faces."),
        ("thickness", float, "Out-of-plane thickness of a drawing, m; default 1."),
        ("tolerance", float, "Gaps and overlaps up to it are closed, in the file's unit; default 5e-4 of the size."),
        ("unit", str, "Unit of the file's lengths (mm, cm, m, in, ft), made metres; default its own."),
        ("up", Literal["y", "z"], "Axis of solids that points upwards; default z."),
    )
}
"""Options of commands that read drawings and solids, by the names of `ImportOptions`."""


def of_reading(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of `READING` as `ImportOptions` takes them: layers in tuples."""
    return {
        name: tuple(values[name] or ()) if get_args(hint)[0] == list[str] | None else values[name]
        for name, (hint, _) in READING.items()
        if name in values
    }


def setting_options(kind: type, *names: str, group: str | None = None) -> dict[str, Option]:
    """Return options for the fields that `setting` states, or those named; group: their heading in the help."""
    hints, options = get_type_hints(kind), {}
    for field in fields(kind):
        if "words" not in field.metadata or (names and field.name not in names):
            continue
        limits = {key: value for key, value in field.metadata.items() if key != "words"}
        parts = get_args(hints[field.name])
        # what is a name on the command line may be an object in Python
        hint = (str | None if NoneType in parts else str) if str in parts else hints[field.name]
        words = with_flags(field.metadata["words"])
        option = typer.Option(flag_of(field.name), help=words, rich_help_panel=group, **limits)
        options[field.name] = (Annotated[hint, option], field.default)
    return options


def with_options(
    options: Mapping[str, Option], before: str = ""
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator of a command that adds options, which it gets as further keywords; last, or `before` one."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        parameters = inspect.signature(command).parameters.values()
        existing = [p for p in parameters if p.kind is not p.VAR_KEYWORD and p.name not in options]
        hints = get_type_hints(command, include_extras=True)
        types = {p.name: hints[p.name] for p in existing} | {name: hint for name, (hint, _) in options.items()}
        position = [p.name for p in existing].index(before) if before else len(existing)
        keyword = inspect.Parameter.KEYWORD_ONLY
        existing = [p.replace(annotation=types[p.name], kind=keyword) for p in existing]
        added = [inspect.Parameter(name, keyword, default=default) for name, (_, default) in options.items()]
        added = [p.replace(annotation=types[p.name]) for p in added]

        def run(**values: Any) -> None:
            command(**values)

        run.__signature__ = inspect.Signature([*existing[:position], *added, *existing[position:]])  # type: ignore[attr-defined]
        run.__annotations__, run.__doc__ = types, command.__doc__
        return run

    return decorate


def flags_of(command: Callable[..., None]) -> dict[str, str]:
    """Return the flag of each option of a command."""
    return {
        name: option.param_decls[0] if option.param_decls else flag_of(name)
        for name, hint in command.__annotations__.items()
        for option in getattr(hint, "__metadata__", ())
        if isinstance(option, typer.models.OptionInfo)
    }


def asked(context: typer.Context, values: dict[str, Any]) -> dict[str, Any]:
    """Return those values, by name of the option, that the command line states itself."""
    # by name, since typer may bring a click of its own
    sources = {name: getattr(context.get_parameter_source(name), "name", "") for name in values}
    return {name: value for name, value in values.items() if sources[name] == "COMMANDLINE"}


Cracks = Annotated[
    str | None,
    typer.Option(
        help="How blocks crack: faces, cells:SIZE or fields[:GAP]; default: as the scene says, or along its faces."
    ),
]
CaseSeconds = Annotated[
    float | None,
    typer.Option(
        "--seconds", min=0.0, help="Time after which nothing further is tried, of each load case, s; 60 by fields."
    ),
]


def with_cracks(scene: Scene, text: str | None) -> Scene:
    return scene if text is None else scene.model_copy(update={"cracks": parse_cracks(text)})


def write_scene(scene: Scene, out: Path) -> None:
    """Write a scene file, completely or not at all; keys with default values are left out."""
    if out.is_dir():
        raise InputError(str(out), "it is a folder", "the name of a scene file")
    if not out.absolute().parent.is_dir():
        raise InputError(str(out), "its folder does not exist", "a file in a folder that is there")
    write_text(out, scene.model_dump_json(indent=1, exclude_defaults=True) + "\n")
