"""Analysis of labellings of one structure under each of its load cases."""

from __future__ import annotations

import inspect
import math
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from jld_core.arrays import Bits
from jld_core.assembly import Assembly, Labels, checked_labels, labels_of, with_members
from jld_core.build.assemble import build_assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import InputError, ParameterError, error_context
from jld_core.limit import FIELD_SECONDS, Proof, result_of
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.options import Model, Status
from jld_core.limit.result import LimitAnalysisResult, Result, governing_result
from jld_core.mechanics import require_materials
from jld_core.models.rigid_blocks import limit_analysis, require_model, require_solver_accepts, solve_labelling
from jld_core.models.tilting import with_tilt
from jld_core.parameters import shown_value
from jld_core.scene.cracks import CellCracks, FieldCracks, cracks_of
from jld_core.scene.reading import load_scene
from jld_core.scene.schema import Scene
from jld_core.threads import one_thread

_DIVIDES: Final = 1e-9  # relative error that a whole number of cells may have


def under(assembly: Assembly, model: Model | None = None) -> Assembly:
    cracks = assembly.cracks if model is None or model.cracks is None else cracks_of(model.cracks)
    return assembly if cracks == assembly.cracks else replace(assembly, cracks=cracks)


def require_cracks(assembly: Assembly, model: Model | None = None) -> None:
    """Raise InputError if an assembly cannot be analysed with its crack model.

    Cells must divide the grid. With cracks by fields no option may ask for another model or solver, and
    `require_fields` must pass.

    Parameters
    ----------
    assembly : Assembly
        Structure.
    model : Model, optional
        Model; None: the default.
    """
    if isinstance(assembly.cracks, CellCracks):
        _require_cells(assembly, assembly.cracks.cell, model)
    if not isinstance(assembly.cracks, FieldCracks):
        return
    model = model or Model()
    unsupported = [*model.beyond_whole_faces]
    unsupported += [name for name in ("condense", "solver") if getattr(model, name) != getattr(Model, name)]
    for name in unsupported:
        raise ParameterError(name, "cracks by fields do not support it", "the default, or cracks by faces")
    from jld_core.fields.problem import require_fields  # `jld check` without fields is to start quickly

    require_fields(assembly)


def rigid(assembly: Assembly, labels: Bits, what: str = "") -> tuple[Assembly, Bits]:
    """Return the rigid elements under a crack model: those of the assembly, or the finer cells.

    Parameters
    ----------
    assembly : Assembly
        Assembly with its crack model, see `under`.
    labels : (m,) or (k, m) bool array
        Labels, True = dry.
    what : str
        What needs rigid elements, to refuse cracks by fields; "" where fields are left as they are.

    Returns
    -------
    (Assembly, (M,) or (k, M) bool array)
        Elements that are solved as rigid, and their labels.

    Raises
    ------
    InputError
        Blocks crack by fields and `what` is given, or no cells can be cut.
    """
    if what and isinstance(assembly.cracks, FieldCracks):
        raise InputError("cracks", f"{what} needs rigid cells, and fields have none", '"faces" or "cells"')
    if not isinstance(assembly.cracks, CellCracks):
        return assembly, labels
    from jld_core.refinement.refine import cells_of

    require_cracks(assembly)
    cells = cells_of(assembly, assembly.cracks.cell)
    return cells.fine, cells.labels(labels)


def _require_cells(assembly: Assembly, cell: float, model: Model | None) -> None:
    """Raise InputError unless cells of size `cell` divide the grid of an assembly's scene."""
    # Of general elements any size is accepted here. The message names the parameter where the model states the cells.
    grid = None if assembly.scene is None else assembly.scene.grid
    if grid is None:
        return
    for name, length in zip(("width", "height"), grid.cell, strict=True):
        parts = length / cell
        if round(parts) < 1 or abs(parts - round(parts)) > _DIVIDES * parts:
            stated = model is not None and model.cracks is not None
            raise (ParameterError if stated else InputError)(
                "cracks",
                f"cells of {cell:g} do not divide the {name} {length:g} of a cell of the grid",
                f"{length:g} over a whole number, as {length / max(2, round(parts)):g}",
            )


class CaseAnalysis:
    """Limit analyses of one structure, one for each load case, or one for its single load.

    The analyses are set up once and serve any number of labellings. Threads may share the object; they solve in turn.
    Raises InputError if the solver of the model does not accept programs of this structure.

    Parameters
    ----------
    assembly : Assembly
        Structure, with or without load cases.
    model : Model, optional
        Model and solver options; default: those of `solve`.
    reference : (m,) array of bool, optional
        Labelling on which solvers are set up, True = dry; default: that of the assembly.
    single_labelling : bool
        Only one labelling will be solved. Each analysis is then set up for it alone where that is faster, when its load
        case is solved, and dropped afterwards, which bounds the memory.

    Examples
    --------
    >>> analysis = CaseAnalysis(build_assembly(load_scene("scenes/wall_in_two_winds.json")))
    >>> analysis.solve(analysis.assembly.labels).governing
    """

    def __init__(
        self,
        assembly: Assembly,
        model: Model | None = None,
        *,
        reference: Bits | None = None,
        single_labelling: bool = False,
    ) -> None:
        self.assembly, self.model = assembly, model or Model()
        self._reference = assembly.labels if reference is None else reference
        self._single_labelling = single_labelling
        self._lock = threading.Lock()  # A limit analysis may be used by one thread at a time.
        self._analyses_of_cases = None if single_labelling else [self._analysis(case) for case in assembly.by_case]

    def solve(self, labels: Bits, *, stands: bool = False) -> LimitAnalysisResult:
        """Solve one labelling under every load case.

        labels: (m,) True = dry. stands: also decide whether the structure stands without live load, that is, at λ = 0.
        Result: result in scene units. With load cases: the governing factor, with the result of each case in `cases`.
        Raises InputError if a material that the labelling needs is missing, or the solver does not accept the programs.
        """
        require_materials(self.assembly, labels, ~labels)
        with self._lock:
            results = [self._solve_case(analysis, labels, stands) for analysis in self._analyses()]
        if not self.assembly.cases:
            return results[0]
        names = [case.name for case in self.assembly.cases]
        return governing_result(self.assembly, dict(zip(names, results, strict=True)))

    def _solve_case(self, analysis: LimitAnalysis, labels: Bits, stands: bool) -> LimitAnalysisResult:
        start = time.process_time()
        proof = solve_labelling(analysis, labels, self.model, stands=stands)
        least_load = least_bracket(analysis, labels, self.model, proof)
        elapsed = time.process_time() - start
        assemble = analysis.seconds if self._single_labelling else 0.0
        result = result_of(analysis.template, labels, self.model, proof, assemble=assemble, elapsed=elapsed)
        return replace(result, least_bracket=least_load)

    def _analyses(self) -> Iterator[LimitAnalysis]:
        """Yield the analysis of each load case, in their order."""
        analyses = self._analyses_of_cases
        yield from map(self._analysis, self.assembly.by_case) if analyses is None else analyses

    def _analysis(self, case: Assembly) -> LimitAnalysis:
        """Create the analysis of one load case; raise InputError if the solver does not accept it."""
        single = self._single_labelling and self.model.supports_bounds_over_labellings
        analysis = limit_analysis(case, self.model, reference=self._reference, single_labelling=single)
        require_solver_accepts(analysis, self.model)
        return analysis


# Factor between a λ at which a structure stands and the least one, above which the least is sought once more
_FAR_ABOVE_LEAST: Final = 4.0


def least_bracket(analysis: LimitAnalysis, labels: Bits, model: Model, proof: Proof) -> tuple[float, float]:
    """Bound the least λ in scene units, zeros where it stands; NaN where unknown, or states are not convex."""
    # The structure carries its dead load with a live load λ₀ that it stands under, and reversed live load is added: of
    # that, it takes λ₀ less the least λ.
    # Minimised by the program that maximises λ. Without dilation, or with effective areas, states are not convex.
    unknown = math.nan, math.nan
    if proof.stands:
        return 0.0, 0.0
    convex = model.friction == "associative" and not model.effective_area
    if proof.stands is None or proof.state is None or proof.status is Status.UNSTABLE or not convex:
        return unknown
    assembly, standing_load, bracket = analysis.assembly, proof.state.load * analysis.template.scaling.load, unknown
    for _ in range(2):
        dead = assembly.dead_loads + standing_load * assembly.live_loads
        reversed_case = replace(assembly, dead_loads=dead, live_loads=-1.0 * assembly.live_loads)
        analysis_of_reversed = limit_analysis(reversed_case, model, reference=labels, single_labelling=True)
        proof_of_reversed = solve_labelling(analysis_of_reversed, labels, model)
        scale = analysis_of_reversed.template.scaling.load
        bounds = standing_load - scale * proof_of_reversed.high, standing_load - scale * proof_of_reversed.low
        if not math.isfinite(bounds[1]):
            break
        bracket = max(bounds[0], 0.0) if math.isfinite(bounds[0]) else math.nan, bounds[1]
        if standing_load <= _FAR_ABOVE_LEAST * bounds[1]:
            break
        standing_load = 2.0 * bounds[1]
    return bracket


# What can be solved: a scene file, a dict as in the file, a scene or an assembly.
Structure = str | Path | Mapping[str, Any] | Scene | Assembly


def assembly_of(structure: Structure) -> Assembly:
    """Return the assembly of a scene file, dict, `Scene` or `Assembly`; InputError for others."""
    if isinstance(structure, Assembly):
        return structure
    if isinstance(structure, Scene):
        return build_assembly(structure)
    if isinstance(structure, Mapping):
        return build_assembly(structure)
    if not isinstance(structure, str | Path):
        problem = f"{type(structure).__name__!r} is no structure"
        raise ParameterError("structure", problem, "the name of a scene file, a dict, a Scene or an Assembly")
    scene = load_scene(Path(structure))
    with error_context(structure):
        return build_assembly(scene)


def labellings_of(assembly: Assembly, labellings: ArrayLike | Iterable[Labels]) -> Bits:
    """Return several labellings (k, m) as a checked bool array; InputError as `labels_of`."""
    expected = f"rows of {assembly.faces} labels"
    if isinstance(labellings, np.ndarray) and labellings.ndim == 2 and labellings.dtype == np.bool_:
        if labellings.shape[1] not in (assembly.faces, len(assembly.interfaces)):
            raise ParameterError("labellings", f"rows have {labellings.shape[1]} labels", expected)
        return with_members(assembly, labellings)
    if isinstance(labellings, str) or not isinstance(labellings, Iterable):
        raise ParameterError("labellings", f"{shown_value(labellings)} is no sequence of labellings", expected)
    rows = [checked_labels(row, assembly, f"labellings[{k}]") for k, row in enumerate(labellings)]
    return with_members(assembly, np.array([row[: assembly.faces] for row in rows]).reshape(len(rows), assembly.faces))


P = ParamSpec("P")
R = TypeVar("R")


def model_of(model: Model | None, options: dict[str, Any]) -> Model:
    """Return a model with fields replaced; InputError for an unknown name or value."""
    if model is not None and not isinstance(model, Model):
        raise ParameterError("model", f"{type(model).__name__!r} is no model", "a `Model`")
    names = [field.name for field in fields(Model)]
    for name in options:
        if name not in names:
            close = get_close_matches(name, names, 1)
            expected = f"`{close[0]}`" if close else ", ".join(names)
            raise ParameterError(name, "a model has no such field", expected)
    return replace(model or Model(), **options)


def options_of_model(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function that takes the fields of `Model` as keywords state them in its signature, for editors."""
    signature = inspect.signature(function)
    parameters = [
        parameter for parameter in signature.parameters.values() if parameter.kind is not inspect.Parameter.VAR_KEYWORD
    ]
    kind = inspect.Parameter.KEYWORD_ONLY
    model_fields = [
        inspect.Parameter(field.name, kind, default=field.default, annotation=field.type) for field in fields(Model)
    ]
    function.__dict__["__signature__"] = signature.replace(parameters=parameters + model_fields)
    return function


@options_of_model
def solve(
    structure: Structure, labels: Labels | None = None, model: Model | None = None, **options: Any
) -> LimitAnalysisResult:
    """Compute the collapse load factor of one labelling, with a two-sided bracket.

    Blocks crack as the scene says, unless the model names another crack model.

    Parameters
    ----------
    structure : str, Path, dict, Scene or Assembly
        Scene file, dict as in such a file, scene or assembly, planar or spatial, with or without load cases.
    labels : (m,) array or str, optional
        Labels in the order of the interfaces: True or 1 = dry, False or 0 = inner, or a text of the letters d and i.
        Default: the labels of the scene.
    model : Model, optional
        Crack model, friction, contact, bending, solver. Default: associative friction on whole faces.
    **options
        Fields of `Model`, which replace those of `model`.

    Returns
    -------
    LimitAnalysisResult
        Result in scene units. For a structure with load cases: the governing factor, with the result of each case in
        `cases`. By fields it is a `FieldResult`: it has what every `Result` has, without forces and mechanism.

    Raises
    ------
    InputError
        If the scene cannot be used, the labels have a wrong length or value, a material that the labelling needs is
        missing, an option has an invalid value, or the crack model or the solver does not take this structure.

    Notes
    -----
    Source: Iannuzzo et al. 2024, eq. (2); docs/method.md (2.1), (3.3).

    Examples
    --------
    >>> result = solve("scenes/flat_beam_arch.json", friction="zero-dilation")
    >>> result.load_factor, result.bracket
    """
    chosen = model_of(model, options)
    assembly = under(assembly_of(structure), chosen)
    # both kinds of results are read alike; stated as one, type checkers know the forces of the common kind
    return cast(LimitAnalysisResult, solve_cracked(assembly, labels_of(assembly, labels), chosen))


def solve_cracked(assembly: Assembly, labels: Bits, model: Model) -> Result:
    """Compute λ of one labelling under the crack model of an assembly, whatever `cracks` of the model.

    InputError as `solve`.
    """
    require_cracks(assembly, model)
    by_fields = replace(model, cracks=assembly.cracks).by_fields
    if by_fields is not None:
        from jld_core.models.by_fields import solve_by_fields  # loads the mesh and the programs of fields

        seconds = FIELD_SECONDS if model.seconds is None else model.seconds
        return solve_by_fields(assembly, labels, gap=by_fields.gap, seconds=seconds)
    return solve_by_elements(assembly, labels, model)


def solve_by_elements(
    assembly: Assembly, labels: Bits, model: Model | None = None, what: str = ""
) -> LimitAnalysisResult:
    """Compute λ of one labelling under the crack model of an assembly, by faces or by cells.

    Parameters
    ----------
    assembly, labels, model
        As in `solve_cracked`.
    what : str
        What needs rigid elements, to refuse cracks by fields.

    Returns
    -------
    LimitAnalysisResult
        Result in scene units; by cells on the finer cells.

    Raises
    ------
    InputError
        As `solve`, or if blocks crack by fields.
    """
    elements, element_labels = rigid(assembly, labels, what)
    result = solve_rigid(elements, element_labels, model)
    cases = {name: replace(case, cracks=assembly.cracks) for name, case in result.cases.items()}
    return replace(result, cracks=assembly.cracks, cases=cases)


@one_thread()
def solve_rigid(assembly: Assembly, labels: Bits | None = None, model: Model | None = None) -> LimitAnalysisResult:
    """Compute λ of one labelling of rigid elements as they are, whatever the crack model of the assembly.

    Parameters
    ----------
    assembly : Assembly
        Rigid elements, with or without load cases.
    labels : (m,) bool array, optional
        Labels, True = dry. Default: those of the assembly.
    model : Model, optional
        Model; its `cracks` does not count.

    Returns
    -------
    LimitAnalysisResult
        Result in scene units.

    Raises
    ------
    InputError
        As `solve`.
    """
    model, labels_solved = model or Model(), assembly.labels if labels is None else labels
    if model.effective_area:
        require_model(assembly, model, labels_solved)
    analysis = CaseAnalysis(assembly, model, reference=labels_solved, single_labelling=True)
    if model.seconds is None:
        return with_tilt(analysis.solve(labels_solved, stands=True))
    try:
        with Deadline(len(assembly.by_case) * model.seconds).enforced():
            return with_tilt(analysis.solve(labels_solved, stands=True))
    except DeadlinePassed:
        raise ParameterError("seconds", f"no answer was found in {model.seconds:g} s", "a longer time") from None
