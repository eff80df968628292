"""Solve many labellings of one structure by the batch solver."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly, Labels
from jld_core.errors import ParameterError
from jld_core.limit import CaseBounds, governing
from jld_core.limit.batch import BatchAnalysis
from jld_core.limit.options import Model, Status
from jld_core.limit.result import Result
from jld_core.mechanics import require_materials
from jld_core.models.case_analysis import (
    Structure,
    assembly_of,
    labellings_of,
    model_of,
    options_of_model,
    require_cracks,
    rigid,
    solve_cracked,
    under,
)
from jld_core.models.rigid_blocks import limit_analysis, solve_labelling
from jld_core.parameters import require_kind
from jld_core.scene.cracks import FieldCracks, cracks_in_short
from jld_core.threads import one_thread

if TYPE_CHECKING:
    import pandas as pd

    from jld_core.scene.cracks import CrackModel


@dataclass(frozen=True)
class BatchResult:
    """Load factors of k labellings of one structure, with proven bounds.

    Attributes
    ----------
    assembly : Assembly
        Structure with m interfaces.
    labels : (k, m) bool array
        Labels, True = dry.
    load_factor : (k,) float array
        λ in scene units, NaN where there is none. With load cases: the governing factor.
    low, high : (k,) float array
        Proven bounds on `load_factor`; NaN where a bound is unproven or infinite.
    status : tuple of Status
        Outcome of each labelling.
    model : Model
        Model and solver options.
    cases : dict of str to BatchResult
        Results of each load case by its name; empty without load cases.
    governing : tuple of str
        Name of the governing load case of each labelling; empty without load cases.
    """

    assembly: Assembly
    labels: Bits
    load_factor: Floats
    low: Floats
    high: Floats
    status: tuple[Status, ...]
    model: Model = field(default_factory=Model)
    cases: dict[str, BatchResult] = field(default_factory=dict)
    governing: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        best_in_words = (
            ""
            if np.isnan(self.load_factor).all()
            else f", largest λ = {np.nanmax(self.load_factor):.9g}, cracks {cracks_in_short(self.cracks)}"
        )
        return f"BatchResult({self.assembly.name!r}, {len(self)} labellings{best_in_words})"

    @property
    def best(self) -> int | None:
        """Return the index of the labelling with the largest λ; None if no labelling has a λ."""
        return None if np.isnan(self.load_factor).all() else int(np.nanargmax(self.load_factor))

    @property
    def cracks(self) -> CrackModel:
        """Return the crack model of the labellings."""
        return self.assembly.cracks

    def result(self, number: int) -> Result:
        """Solve one of the labellings again, for its forces and its mechanism.

        Parameters
        ----------
        number : int
            Number of the labelling, from 0 to k − 1.

        Returns
        -------
        Result
            Full result of the labelling, as of `solve`.

        Raises
        ------
        InputError
            If there is no labelling of that number.
        """
        require_kind("number", number, int)
        if not 0 <= number < len(self):
            raise ParameterError("number", f"there is no labelling {number}", f"0 to {len(self) - 1}")
        return solve_cracked(self.assembly, self.labels[number], self.model)

    def to_frame(self) -> pd.DataFrame:
        """Return a table with one row per labelling.

        Returns
        -------
        pandas.DataFrame
            Columns `labelling` (letters d and i), `load_factor`, `bracket_lo`, `bracket_hi`, `status`; with load cases
            also `governing` and `load_factor[NAME]` for each. Load factors are in scene units.
        """
        import pandas as pd  # slow to import and needed for tables only

        columns: dict[str, Any] = {
            "labelling": ["".join("d" if dry else "i" for dry in row) for row in self.labels],
            "load_factor": self.load_factor,
            "bracket_lo": self.low,
            "bracket_hi": self.high,
            "status": [str(status) for status in self.status],
        }
        if self.cases:
            columns["governing"] = list(self.governing)
            columns |= {f"load_factor[{name}]": case.load_factor for name, case in self.cases.items()}
        return pd.DataFrame(columns)


@options_of_model
@one_thread()
def solve_many(
    structure: Structure, labellings: ArrayLike | Iterable[Labels], model: Model | None = None, **options: Any
) -> BatchResult:
    """Compute the collapse load factors of many labellings of one structure.

    The compiled batch solver settles most labellings of whole faces with associative friction. For 1000 labellings of
    24 planar faces it takes about one hundredth of the time of as many calls of `solve`. All others are solved one by
    one. Blocks crack as the scene says, unless the model names another crack model.

    Parameters
    ----------
    structure : str, Path, dict, Scene or Assembly
        As in `solve`.
    labellings : (k, m) array or sequence of labellings
        Each labelling as in `solve`: m truth values, numbers 0 and 1, or letters d and i.
    model : Model, optional
        As in `solve`.
    **options
        Fields of `Model`, which replace those of `model`.

    Returns
    -------
    BatchResult
        λ, bounds and status of each labelling, scene units; they do not depend on the other labellings.

    Raises
    ------
    InputError
        As `solve`.

    Examples
    --------
    >>> many = solve_many("scenes/flat_beam_arch.json", ["d" * 24, "di" * 12])
    >>> many.load_factor
    """
    chosen = model_of(model, options)
    assembly = under(assembly_of(structure), chosen)
    rows = labellings_of(assembly, labellings)
    require_cracks(assembly, chosen)
    if isinstance(assembly.cracks, FieldCracks):
        return _by_fields(assembly, rows, chosen)
    elements, element_labels = rigid(assembly, rows)
    results = [
        replace(_solve_many(element_case, element_labels, chosen), assembly=case, labels=rows)
        for case, element_case in zip(assembly.by_case, elements.by_case, strict=True)
    ]
    return _governing(assembly, rows, chosen, results)


def _by_fields(assembly: Assembly, labels: Bits, model: Model) -> BatchResult:
    """Bound k labellings (k, m) of blocks that crack by fields, one by one."""
    from jld_core.models.by_fields import FieldResult, case_bounds_of  # loads the mesh and the programs of fields

    results = [solve_cracked(assembly, row, model) for row in labels]
    bounds = [[*map(case_bounds_of, result.cases.values())] for result in results if isinstance(result, FieldResult)]
    by_case = [_collect(case, labels, model, [row[k] for row in bounds]) for k, case in enumerate(assembly.by_case)]
    return _governing(assembly, labels, model, by_case)


def _collect(assembly: Assembly, labels: Bits, model: Model, bounds: list[CaseBounds]) -> BatchResult:
    value, low, high = (
        np.array([getattr(case, name) for case in bounds], dtype=float) for name in ("load_factor", "low", "high")
    )
    return BatchResult(assembly, labels, value, low, high, tuple(case.status for case in bounds), model)


def _solve_many(assembly: Assembly, labels: Bits, model: Model) -> BatchResult:
    """Solve k labellings (k, m) under one load, by the batch solver where it settles them."""
    require_materials(assembly, np.asarray(labels.any(axis=0)), np.asarray(~labels.all(axis=0)))
    analysis = limit_analysis(assembly, model)
    scale, count = analysis.template.scaling.load, len(labels)
    load_factor, low, high = (np.full(count, np.nan) for _ in "123")
    status: list[Status | None] = [None] * count
    batch = BatchAnalysis.of(analysis) if model.supports_bounds_over_labellings and count else None
    if batch is not None:
        bounds = batch.prove(labels)
        low, high = scale * bounds.low, scale * bounds.high
        with np.errstate(invalid="ignore"):  # of a bracket without ends
            load_factor = 0.5 * (low + high)
        status = [bounds.status(k) for k in np.arange(count).tolist()]
    for k in (k for k, case_status in enumerate(status) if case_status is None):
        proof = solve_labelling(analysis, labels[k], model)
        status[k], load_factor[k] = proof.status, scale * proof.load_factor
        low[k], high[k] = (scale * end for end in proof.bracket)
    statuses = tuple(case_status for case_status in status if case_status is not None)
    return BatchResult(assembly, labels, load_factor, low, high, statuses, model)


def _governing(assembly: Assembly, labels: Bits, model: Model, results: list[BatchResult]) -> BatchResult:
    """Combine the results of load cases into the least λ / required of each labelling; without cases the one."""
    if not assembly.cases:
        return results[0]
    cases = {case.name: result for case, result in zip(assembly.cases, results, strict=True)}
    required, names = assembly.required.tolist(), list(cases)
    outcomes = [
        governing([CaseBounds(r.status[k], r.low[k], r.high[k], r.load_factor[k]) for r in results], required)
        for k in np.arange(len(labels)).tolist()
    ]
    value, low, high = (
        np.array([getattr(outcome, name) for outcome in outcomes], dtype=float)
        for name in ("load_factor", "low", "high")
    )
    status = tuple(outcome.status for outcome in outcomes)
    governing_names = tuple(names[outcome.case] for outcome in outcomes)
    return BatchResult(assembly, labels, value, low, high, status, model, cases, governing_names)
