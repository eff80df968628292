"""Solve one labelling of a structure under its load, or under all its load cases: the one way to an answer."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import fields, replace
from difflib import get_close_matches
from typing import Any, ParamSpec, TypeVar, cast

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import ParameterError
from jld_core.limit import FIELD_SECONDS, LimitAnalysisResult, Model, Result
from jld_core.models.case_analysis import CaseAnalysis
from jld_core.models.crack_models import require_cracks, rigid, under
from jld_core.models.inputs import Labels, Structure, assembly_of, labels_of
from jld_core.models.labelling import require_model
from jld_core.threads import one_thread

P = ParamSpec("P")
R = TypeVar("R")


def model_of(model: Model | None, options: dict[str, Any]) -> Model:
    """Return a model with some of its fields replaced.

    Parameters
    ----------
    model : Model or None
        Model, None for the defaults.
    options : dict of str to object
        Values of fields of the model, by name.

    Returns
    -------
    Model
        The model.

    Raises
    ------
    InputError
        A name is no field of the model, or a value is not allowed.
    """
    if model is not None and not isinstance(model, Model):
        raise ParameterError("model", f"{type(model).__name__!r} is no model", "a `Model`")
    names = [one.name for one in fields(Model)]
    for name in options:
        if name not in names:
            close = get_close_matches(name, names, 1)
            expected = f"`{close[0]}`" if close else ", ".join(names)
            raise ParameterError(name, "a model has no such field", expected)
    return replace(model or Model(), **options)


def options_of_model(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function that takes the fields of `Model` as keywords state them in its signature, for editors.

    Parameters
    ----------
    function : callable
        Function whose last parameter is `**options`.

    Returns
    -------
    callable
        The same function.
    """
    signature = inspect.signature(function)
    own = [one for one in signature.parameters.values() if one.kind is not inspect.Parameter.VAR_KEYWORD]
    kind = inspect.Parameter.KEYWORD_ONLY
    stated = [inspect.Parameter(one.name, kind, default=one.default, annotation=one.type) for one in fields(Model)]
    function.__dict__["__signature__"] = signature.replace(parameters=own + stated)
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
    """Compute λ of one labelling under the crack model of an assembly, see `under`.

    Parameters
    ----------
    assembly : Assembly
        Structure with its crack model.
    labels : (m,) bool array
        Labels, True = dry.
    model : Model
        Model; its `cracks` does not count any more.

    Returns
    -------
    Result
        Result in scene units.

    Raises
    ------
    InputError
        As `solve`.
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
    elements, own = rigid(assembly, labels, what)
    found = solve_rigid(elements, own, model)
    cases = {name: replace(one, cracks=assembly.cracks) for name, one in found.cases.items()}
    return replace(found, cracks=assembly.cracks, cases=cases)


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
    model, own = model or Model(), assembly.labels if labels is None else labels
    if model.effective_area:
        require_model(assembly, model, own)
    analysis = CaseAnalysis(assembly, model, reference=own, single_labelling=True)
    if model.seconds is None:
        return analysis.solve(own, stands=True)
    try:
        with Deadline(len(assembly.by_case) * model.seconds).enforced():
            return analysis.solve(own, stands=True)
    except DeadlinePassed:
        raise ParameterError("seconds", f"no answer was found in {model.seconds:g} s", "a longer time") from None
