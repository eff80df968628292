"""The virtual experiment: load an assembly of rigid elements on springs until it comes down.

An explicit distinct-element engine of its own, independent of every program in `jld_core`: no optimisation, no bracket,
but what limit analysis cannot say, namely what happens when cracks are brittle and joints do not dilate.

- `Curve`: what an experiment showed
- `Joints`: properties of faces that limit analysis does not know
- `Push`: a push at a constant rate
- `Ramp`: a load raised step by step
- `Settings`: how an experiment is run
- `Specimen`: one labelling, ready to be loaded
- `Standing`: what it does under loads that stay
- `State`: what changes while it is loaded
- `push`: push until it comes down
- `ramp`: raise the load until it comes down
- `require_one_load`: refuses load cases
- `run_experiment`: load one labelling until it comes down, at two rates
- `specimen_of`: an assembly under one labelling → Specimen
"""

from __future__ import annotations

from jld_experiment.driving import Push, Ramp, push, ramp
from jld_experiment.experiment import Curve, require_one_load, run_experiment
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
