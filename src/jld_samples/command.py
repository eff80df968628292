"""Provide `jld new KIND`: the samples with their parameters as options."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Annotated, Any, get_type_hints

import typer

from jld_core import Scene
from jld_core.scene import Search
from jld_explore.cli import options, streams
from jld_samples import KINDS, Stone

# Help texts of the options for material properties
_STONE = {
    "density": "Density, kg/m³.",
    "friction": "Friction coefficient of dry joints.",
    "tension": "Tensile strength of inner faces, Pa.",
    "shear": "Shear strength of inner faces, Pa.",
}


# Help text of the option for the largest block
_MOST = "Elements of a block at the most, in a search; 0: as many as there are."

_CELLS = 4  # Without a limit the strongest layout is often a single block.


def commands() -> typer.Typer:
    """Return the group of commands `jld new`, one per sample, with its parameters as options."""
    group = typer.Typer(
        help="Write a scene by name: a grid of candidate cells with supports, stone and a load.",
        add_completion=False,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
    )
    for kind, make in KINDS.items():
        group.command(name=kind, help=(inspect.getdoc(make) or "").split("\n\n")[0])(_command(kind, make))
    return group


def _command(kind: str, make: Callable[..., Scene]) -> Callable[..., None]:
    """Return a command whose options, with help texts, are the parameters of a sample."""
    hints = get_type_hints(make)
    help_texts = dict(re.findall(r"^(\w+): (.+)$", inspect.getdoc(make) or "", flags=re.M))
    parameters: list[inspect.Parameter] = []
    types: dict[str, Any] = {}
    for name, parameter in inspect.signature(make).parameters.items():
        if name == "stone":
            continue
        words = help_texts[name][0].upper() + help_texts[name][1:]
        types[name] = Annotated[hints[name], typer.Option(help=words)]
        parameters.append(parameter.replace(annotation=types[name], kind=inspect.Parameter.KEYWORD_ONLY))
    for name, words in _STONE.items():
        types[name] = Annotated[float, typer.Option(help=words)]
        default = getattr(Stone, name)
        parameters.append(
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=types[name])
        )
    types["most"] = Annotated[int, typer.Option(min=0, help=_MOST)]
    parameters.append(
        inspect.Parameter("most", inspect.Parameter.KEYWORD_ONLY, default=_CELLS, annotation=types["most"])
    )
    types["out"] = options.Out
    parameters.append(inspect.Parameter("out", inspect.Parameter.KEYWORD_ONLY, annotation=options.Out))

    def run(**values: Any) -> None:
        out = values.pop("out")
        stone = Stone(**{name: values.pop(name) for name in _STONE})
        most = values.pop("most")
        scene = make(**values, stone=stone)
        if most:
            scene = scene.model_copy(update={"search": Search(block_cells=[1, most])})
        options.write_scene(scene, out)
        streams.say(f"{kind}: {scene.name}, written to {out}")

    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {**types, "return": None}
    run.__name__ = kind.replace("-", "_")
    return run


new = commands()
