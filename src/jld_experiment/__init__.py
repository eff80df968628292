"""The virtual experiment: load an assembly of rigid elements on springs until it comes down.

An explicit distinct-element engine of its own, independent of every program in `jld_core`: no optimisation, no bracket,
but what limit analysis cannot say, namely what happens when cracks are brittle and joints do not dilate.
"""

from __future__ import annotations

from jld_experiment.driving import Push, Ramp, push, ramp
from jld_experiment.experiment import Curve, run_experiment
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
    "run_experiment",
    "specimen_of",
]
