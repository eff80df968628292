"""Define the options of the model, shared by the commands that solve."""

from __future__ import annotations

from typing import Annotated

import typer

from jld_core.limit import Condense, Contacts
from jld_core.mechanics import InnerBending
from jld_core.solvers import SOLVERS

EffectiveArea = Annotated[
    bool, typer.Option("--effective-area", help="Torsion about the area really pressed (spatial).")
]

Contact = Annotated[
    Contacts, typer.Option(help="Resultants at centres of pressure, or points at the corners of dry faces.")
]

Bending = Annotated[
    InnerBending, typer.Option(help="Bending of spatial inner faces: uncoupled, or by elastic edge stress.")
]

Blocks = Annotated[
    Condense, typer.Option(help="Rigid blocks, cracked on demand; auto: where inner faces are very strong.")
]

First = Annotated[
    str,
    typer.Option(help="Solver asked first: " + ", ".join(SOLVERS) + "; where it proves nothing, others follow."),
]

Gap = Annotated[float, typer.Option(help="Relative width of the bracket above which λ is uncertified.")]

Strict = Annotated[bool, typer.Option("--strict", help="Take what is possible but hardly meant as an error.")]

Robust = Annotated[
    bool, typer.Option("--robust", help="λ at the low values of materials, and at the nominal ones besides.")
]
