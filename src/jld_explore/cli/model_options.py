"""Define the options of the model, shared by the commands that solve."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from jld_core.limit import Condense, Contacts
from jld_core.mechanics import InnerBending
from jld_core.solvers import SOLVERS

EffectiveArea = Annotated[
    bool, typer.Option("--effective-area", help="Base torsion on the area in compression (spatial).")
]

Contact = Annotated[
    Contacts, typer.Option(help="Resultants at centres of pressure, or points at the corners of dry faces.")
]

Bending = Annotated[
    InnerBending, typer.Option(help="Bending of spatial inner faces: uncoupled, or by elastic edge stress.")
]

Blocks = Annotated[
    Condense, typer.Option(help="Rigid blocks that crack where needed; auto: where inner faces are very strong.")
]

First = Annotated[
    str,
    typer.Option(help="First solver: " + ", ".join(SOLVERS) + "; others follow where it proves nothing."),
]

Gap = Annotated[float, typer.Option(help="Relative width of the bracket to aim at.")]

Strict = Annotated[bool, typer.Option("--strict", help="Treat plausibility warnings as errors.")]

Robust = Annotated[
    bool, typer.Option("--robust", help="Use the low values of materials; λ at nominal values is stated as well.")
]


def asked(context: typer.Context, values: dict[str, Any]) -> dict[str, Any]:
    """Return those values, by name of the option, that the command line states itself."""
    sources = {name: context.get_parameter_source(f"{name}_" if name == "range" else name) for name in values}
    # by name, since typer may bring a click of its own
    return {name: value for name, value in values.items() if getattr(sources[name], "name", "") == "COMMANDLINE"}
