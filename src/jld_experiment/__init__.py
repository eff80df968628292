"""Run virtual experiments: load rigid elements on springs until collapse, independently of limit analysis.

- `Curve`: result of an experiment
- `Joints`: properties of faces that limit analysis does not have
- `Push`: result of a push at a constant rate
- `Ramp`: result of raising the load step by step
- `Settings`: numerical settings of an experiment
- `Specimen`: one labelling ready to be loaded
- `Standing`: behaviour under constant loads
- `State`: variables that change during loading
- `push`: push until collapse
- `ramp`: raise the load until collapse
- `require_one_load`: raise an error for load cases
- `run_experiment`: load one labelling until collapse
- `specimen_of`: prepare an assembly for loading
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jld_core import export_lazily

if TYPE_CHECKING:
    from jld_experiment.experiment import Curve, Push, Ramp, push, ramp, require_one_load, run_experiment
    from jld_experiment.settings import Joints, Settings
    from jld_experiment.specimen import Specimen, Standing, State, specimen_of

__all__ = [
    "Curve",
    "Joints",
    "Push",
    "Ramp",
    "Settings",
    "Specimen",
    "Standing",
    "State",
    "push",
    "ramp",
    "require_one_load",
    "run_experiment",
    "specimen_of",
]

# the command and the step of a search are listed where numba, which the engine needs, is not installed
export_lazily(
    __name__,
    {
        "experiment": ["Push", "Ramp", "push", "ramp", "Curve", "require_one_load", "run_experiment"],
        "settings": ["Joints", "Settings"],
        "specimen": ["Specimen", "Standing", "State", "specimen_of"],
    },
)
