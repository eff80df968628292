"""Define the options of the model, shared by the commands that solve."""

from __future__ import annotations

from typing import Annotated, Literal, cast

import typer

from jld_core.limit import (
    RENAMED_BENDING,
    Condense,
    Contacts,
)
from jld_core.mechanics import InnerBending
from jld_core.solvers import SOLVERS
from jld_explore.cli.streams import warn

EffectiveArea = Annotated[
    bool, typer.Option("--effective-area", help="Torsion about the area really pressed (spatial).")
]

Contact = Annotated[
    Contacts, typer.Option(help="Resultants at centres of pressure, or points at the corners of dry faces.")
]

Bending = Annotated[
    Literal["uncoupled", "kern", "paper"],
    typer.Option(
        help="Bending of spatial inner faces: uncoupled, or by elastic edge stress; paper is uncoupled by its old name."
    ),
]

Blocks = Annotated[
    Condense, typer.Option(help="Rigid blocks, cracked on demand; auto: where inner faces are very strong.")
]

First = Annotated[
    str,
    typer.Option(help="Solver asked first: " + ", ".join(SOLVERS) + "; where it proves nothing, others follow."),
]

Gap = Annotated[float, typer.Option(help="Relative width of the bracket to aim at.")]

Strict = Annotated[bool, typer.Option("--strict", help="Take what is possible but hardly meant as an error.")]

Robust = Annotated[
    bool, typer.Option("--robust", help="λ at the low values of materials, and at the nominal ones besides.")
]


def current_bending(given: str) -> InnerBending:
    """Return the present name of a value of --inner-bending; warn if it is one of version 0.2."""
    if given not in RENAMED_BENDING:
        return cast(InnerBending, given)
    warn(f"jld: warning: --inner-bending {given} is now {RENAMED_BENDING[given]}; the old name works until version 0.4")
    return RENAMED_BENDING[given]
