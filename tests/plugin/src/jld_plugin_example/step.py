"""A step: the mean number of blocks of the ten best layouts, as an entry of summary.json."""

from collections.abc import Mapping
from typing import Any

from jld_explore import Exploration, Step, StepContext


class MeanBlocks(Step):
    name = "mean_blocks"

    def entries(self, done: Exploration, context: StepContext) -> Mapping[str, Any]:
        best = done.results.head(10)
        return {"layouts": len(best), "blocks": float(best["blocks"].mean())}
