"""A labelling whose evaluation ends its worker. Workers import this module: one of tests takes them a second more."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

import numpy as np

from jld_core import Assembly
from jld_explore import Evaluation
from jld_explore.evaluation import Evaluator


class FatalLabelling:
    """Stands for an assembly in a recipe: unpickling it makes evaluations of one labelling fatal."""

    def __init__(self, assembly: Assembly, labels: np.ndarray, way: str) -> None:
        self.content = assembly, labels.tolist(), way

    def __reduce__(self) -> Any:
        return poisoned, self.content


def poisoned(assembly: Assembly, labels: list[bool], way: str) -> Assembly:
    """Make evaluators of this process die or hang on a labelling."""
    healthy = Evaluator.evaluate

    def evaluate(self: Evaluator, row: np.ndarray, *more: Any) -> Evaluation:
        if row.tolist() == labels:
            if way == "dies":
                os.kill(os.getpid(), signal.SIGKILL)
            time.sleep(60.0)
        return healthy(self, row, *more)

    Evaluator.evaluate = evaluate
    return assembly
