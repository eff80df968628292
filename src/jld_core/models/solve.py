"""Solve one labelling of a structure under its load, or under all its load cases."""

from __future__ import annotations

from jld_core import tolerances
from jld_core.limit import FLOOR_SECONDS, Condense, Contacts, Friction, LimitAnalysisResult, SolveOptions
from jld_core.mechanics import InnerBending
from jld_core.models.case_analysis import CaseAnalysis
from jld_core.models.inputs import Labels, Structure, assembly_of, labels_of
from jld_core.solvers import Solver
from jld_core.threads import one_thread


@one_thread()
def solve(
    structure: Structure,
    labels: Labels | None = None,
    *,
    friction: Friction = "associative",
    range: bool = False,
    floor_seconds: float = FLOOR_SECONDS,
    contact: Contacts = "convex",
    effective_area: bool = False,
    inner_bending: InnerBending = "uncoupled",
    condense: Condense = "auto",
    solver: str | Solver = "auto",
    gap: float = tolerances.GAP,
) -> LimitAnalysisResult:
    """Compute the collapse load factor of one labelling, with a two-sided bracket.

    Parameters
    ----------
    structure : str, Path, Scene or Assembly
        Scene file, scene or assembly, planar or spatial, with or without load cases.
    labels : (m,) array or str, optional
        Labels in the order of the interfaces: True or 1 = dry, False or 0 = inner, or a text of the letters d and i.
        Default: the labels of the scene.
    friction, range, floor_seconds, contact, effective_area, inner_bending, condense, solver, gap
        Options of model and solver, as in `SolveOptions`.

    Returns
    -------
    LimitAnalysisResult
        Result in scene units. For a structure with load cases: the governing factor, with the result of each
        case in `cases`.

    Raises
    ------
    InputError
        If the scene cannot be used, the labels have a wrong length or value, a material that the labelling needs is
        missing, an option has an invalid value, or the solver does not accept programs of this structure.

    Notes
    -----
    Source: Iannuzzo et al. 2024, eq. (2); docs/method.md (2.1), (3.3).

    Examples
    --------
    >>> result = solve("scenes/flat_beam_arch.json", friction="zero-dilation")
    >>> result.load_factor, result.bracket
    """
    model = SolveOptions(friction, range, floor_seconds, contact, effective_area, inner_bending, condense, solver, gap)
    assembly = assembly_of(structure)
    own = labels_of(assembly, labels)
    return CaseAnalysis(assembly, model, reference=own, single_labelling=True).solve(own, stands=True)
