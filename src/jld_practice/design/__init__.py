"""From an outline to numbered stones: tessellations tried, searched, moved, checked and explained.

- `Design`: state of a design run, which can be written to disk at any time
- `DesignOptions`: limits, loads, materials and resources of a design; None keeps the value of the outline's file
- `Outline`: scene of an outline to be cut, with the values that were assumed
- `Screening`: strongest of a few layouts of a tessellation
- `Task`: layout whose joints are to be moved
- `Tessellation`: one way to cut an outline into cells, with its scene
- `Trial`: one labelling of one tessellation, with its bounds on λ
- `facts_of`: return the results of a design as in summary.json; None for unknown or infinite values
- `read_outline`: read the scene, drawing or solid of an outline, and apply the options to it
- `uniaxial_strength`: return the stress at which blocks fail in uniaxial compression, docs/method.md (9.1)
- `with_crushing`: return a planar scene whose faces crush at a share of the uniaxial strength of its blocks
- `with_loads`: replace the live loads of a scene by those of the options, along `side` (d,)
- `write_design`: write all files of a design into its folder; return the contents of summary.json
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_practice.design.options import DesignOptions, Outline, read_outline, with_loads
    from jld_practice.design.page import facts_of, write_design
    from jld_practice.design.run import Task
    from jld_practice.design.tessellations import Tessellation, uniaxial_strength, with_crushing
    from jld_practice.design.trials import Design, Screening, Trial

__all__ = [
    "Design",
    "DesignOptions",
    "Outline",
    "Screening",
    "Task",
    "Tessellation",
    "Trial",
    "facts_of",
    "read_outline",
    "uniaxial_strength",
    "with_crushing",
    "with_loads",
    "write_design",
]

export_lazily(
    __name__,
    {
        "options": ["with_loads", "DesignOptions", "Outline", "read_outline"],
        "page": ["facts_of", "write_design"],
        "run": ["Task"],
        "tessellations": ["uniaxial_strength", "with_crushing", "Tessellation"],
        "trials": ["Design", "Screening", "Trial"],
    },
)
