"""An objective: λ for each block, which a search maximises instead of λ."""

import numpy as np

from jld_core import Assembly, blocks_of
from jld_explore import Evaluation


def strength_per_block(evaluation: Evaluation, assembly: Assembly, labels: np.ndarray) -> float:
    blocks = blocks_of(assembly, labels)[~assembly.elements.support]
    return evaluation.load_factor / len(np.unique(blocks))
