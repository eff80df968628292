"""Prove the load factor of one labelling: choose the model, the solution method and its fallbacks.

This module alone holds that choice. Point contacts, kern bending, effective areas and zero dilation each have
their own module, which runs only where the options ask for the feature.
"""

from __future__ import annotations

import math
from typing import Final, cast

from jld_core import tolerances
from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.errors import ParameterError, SolverError
from jld_core.limit import LimitAnalysis, Model, Proof
from jld_core.limit import SolveOptions as SolveOptions
from jld_core.limit.fallbacks import FALLBACKS, Fallback, insert_before
from jld_core.limit.proof_attempt import ProofAttempt
from jld_core.models.effective_area import prove_effective_area, require_rectangles
from jld_core.models.loaded_part import prove_loaded_part
from jld_core.models.point_contacts import point_contact_assembly, proof_of_faces
from jld_core.models.rigid_blocks import cracked, prove_condensed, worth_condensing
from jld_core.solvers import RawStatus, is_large
from jld_core.strengths import Route

_PRESCRIBED: Final = Route("prescribed friction")


def limit_analysis(
    assembly: Assembly, options: Model, reference: Bits | None = None, *, single_labelling: bool = False
) -> LimitAnalysis:
    """Build the limit analysis that `solve_labelling` needs for the given options.

    Parameters
    ----------
    assembly : Assembly
        Assembly without load cases, or one load case of an assembly.
    options : Model
        Options; only solver, gap and inner bending are used here.
    reference : (m,) bool array, optional
        Labelling on which solvers are set up, True = dry. Default: all faces dry.
    single_labelling : bool, optional
        True if only one labelling will be solved; the analysis is then set up for this labelling where that is faster.
        Default: any number of labellings.

    Returns
    -------
    LimitAnalysis
        Analysis of the assembly under associative friction.
    """
    solver, gap, bending = options.solver, options.gap, options.inner_bending
    return LimitAnalysis(
        assembly,
        solver=solver,
        gap=gap,
        inner_bending=bending,
        reference=reference,
        single_labelling=single_labelling,
        seconds=options.seconds,
    )


def require_model(assembly: Assembly, options: Model, dry: Bits) -> None:
    """Raise InputError if the options do not support an assembly.

    Call this function before any work starts.

    Parameters
    ----------
    assembly : Assembly
        Assembly to be solved, with all its load cases.
    options : Model
        Options to check. Only effective areas and a solver other than "auto" can fail.
    dry : (m,) bool array
        Faces that may be dry in some labelling, True = may be dry.

    Raises
    ------
    InputError
        If effective areas or prescribed friction do not apply, or the solver rejects programs of this structure.
    """
    if options.effective_area:
        require_rectangles(assembly, dry)
    if options.friction != "associative":
        assembly.strengths(_PRESCRIBED)  # refuses a criterion, whose rows have no cohesion and μ of their own
    if options.solver != "auto":  # spares the analysis
        for case in assembly.by_case:
            require_solver_accepts(limit_analysis(case, options), options)


def require_solver_accepts(analysis: LimitAnalysis, options: Model) -> None:
    """Raise InputError if a solver does not accept the programs of an analysis.

    analysis: analysis that uses the solver. options: options that name the solver. Raises InputError if it does not;
    the message names the parameter `solver`.
    """
    if options.solver == "auto":
        return
    try:
        analysis.first_solver.require(analysis.template.structure)
    except SolverError as error:
        raise ParameterError("solver", str(error), "a solver that takes this scene") from None


def solve_labelling(
    analysis: LimitAnalysis,
    labels: Bits,
    options: Model,
    *,
    stands: bool = False,
    pruning_threshold: float = -math.inf,
) -> Proof:
    """Prove the load factor of one labelling under the given options.

    Parameters
    ----------
    analysis : LimitAnalysis
        Analysis returned by `limit_analysis` for the same options.
    labels : (m,) bool array
        Labels, True = dry.
    options : Model
        Modelling options.
    stands : bool, optional
        Also decide whether the structure stands at λ = 0.
    pruning_threshold : float, optional
        λ in scene units at or below which the labelling is irrelevant. Only zero dilation uses this value, see
        `prove_zero_dilation`.

    Returns
    -------
    Proof
        Proof about the assembly of `analysis`, in the scaled units of `analysis`. Under concave contact the
        proof is transferred from points to whole faces.
    """
    if options.contact == "concave" and analysis.assembly.dimension == 3:
        points, parent = point_contact_assembly(analysis.assembly, labels)
        other = limit_analysis(points, options, reference=points.labels)
        proof = _proof(other, points.labels, options, stands, pruning_threshold)
        return proof_of_faces(analysis, other, parent, proof)
    return _proof(analysis, labels, options, stands, pruning_threshold)


def _proof(analysis: LimitAnalysis, labels: Bits, options: Model, stands: bool, pruning_threshold: float) -> Proof:
    """Prove λ of one labelling under the friction of the options, on the contacts as given.

    labels: (m,) True = dry. stands, pruning_threshold: as in `solve_labelling`.
    """
    if options.friction == "zero-dilation":
        # Local imports: most labellings are solved with dilation, and `jld solve` is to start quickly.
        from jld_core.models.zero_dilation.fixed_point_search import ProximalOptions
        from jld_core.models.zero_dilation.solve import prove_zero_dilation

        proximal = ProximalOptions(effective_area=options.effective_area)
        seconds = options.floor_seconds if options.range else None
        return prove_zero_dilation(
            analysis, labels, proximal, stands=stands, pruning_threshold=pruning_threshold, range=seconds
        )
    if options.effective_area:
        return prove_effective_area(analysis, labels, stands=stands)
    return analysis.prove(labels, FALLBACKS_BY_CONDENSE[options.condense], stands=stands)


# --- fallbacks with rigid blocks ----------------------------------------------------------------------------


def _rigid_blocks(attempt: ProofAttempt) -> None:
    """Prove bounds with rigid blocks, and adopt them in the attempt if this succeeds."""
    found = prove_condensed(cast(LimitAnalysis, attempt.analysis), attempt.labels)
    if found is not None:
        attempt.adopt(found)


def _rigid_where_uncracked(attempt: ProofAttempt) -> None:
    """Prove bounds with rigid blocks, except for blocks that crack in the last solver answer.

    The attempt adopts them if this succeeds. A block cracks if its inner faces jump, see `cracked`.
    """
    analysis, raw = cast(LimitAnalysis, attempt.analysis), attempt.raw
    apart = None
    if raw is not None and raw.status is not RawStatus.UNBOUNDED:
        apart = cracked(analysis, attempt.labels, raw.dual)
    found = prove_condensed(analysis, attempt.labels, apart)
    if found is not None:
        attempt.adopt(found)


def _loaded_part(attempt: ProofAttempt) -> None:
    """Prove bounds in the scale of the loaded part, and adopt them in the attempt if this succeeds."""
    found = prove_loaded_part(cast(LimitAnalysis, attempt.analysis), attempt.labels, attempt.proof)
    if found is not None:
        attempt.adopt(found)


def _strong(attempt: ProofAttempt) -> bool:
    """Return True if the inner faces are so strong that rigid blocks are tried first."""
    return worth_condensing(attempt.template, attempt.labels)


def _large(attempt: ProofAttempt) -> bool:
    """Return True if an attempt is open and has inner faces and a large program.

    For large programs see `is_large`.
    """
    return attempt.open and not attempt.labels.all() and is_large(attempt.template.structure)


def _large_bounded(attempt: ProofAttempt) -> bool:
    """Return True if `_large` holds and repairs are slow: the last solver answer is no ray and has no mechanism."""
    ray = attempt.raw is not None and attempt.raw.status is RawStatus.UNBOUNDED
    return _large(attempt) and not ray and not attempt.mechanism_found


def _large_unbounded(attempt: ProofAttempt) -> bool:
    """Return True if `_large` holds and quick repairs of a ray or a state have not settled the last solver answer."""
    return _large(attempt) and not _large_bounded(attempt)


def _large_crushing(attempt: ProofAttempt) -> bool:
    """Return True if `_large` holds and programs have the accuracy for faces that crush."""
    return _large(attempt) and attempt.template.precision is tolerances.CRUSHING


def _small(attempt: ProofAttempt) -> bool:
    """Return True if an attempt is open, has inner faces, and its program is not large.

    For large programs see `is_large`.
    """
    return attempt.open and not attempt.labels.all() and not is_large(attempt.template.structure)


# Bounds that the fallback with rigid blocks may supply, shared by all entries of `FALLBACKS_BY_CONDENSE`
_SUPPLIES: Final = "both bounds, by blocks that are rigid until shown otherwise: no rounding is left in their cracks"

# Rigid blocks for large programs, tried before the first repair
_LARGE: Final = Fallback("rigid blocks: repairs would take longer", _large_bounded, _rigid_where_uncracked, _SUPPLIES)

# Rigid blocks for large programs that a solver calls unbounded, tried after the first repair
_UNSETTLED: Final = Fallback("rigid blocks: rays are not settled", _large_unbounded, _rigid_where_uncracked, _SUPPLIES)

# A second solve of large crushable programs, whose usual margin alone can leave the bracket too wide
_LESS_MARGIN: Final = Fallback(
    "less margin: rigid blocks would take longer",
    _large_crushing,
    ProofAttempt.solve_with_less_margin,
    "a narrower bracket of large crushable scenes",
)

FALLBACKS_BY_CONDENSE: Final[dict[str, tuple[Fallback, ...]]] = {
    "off": FALLBACKS,
    "on": (Fallback("rigid blocks", lambda attempt: True, _rigid_blocks, _SUPPLIES), *FALLBACKS),
    "auto": (
        Fallback("rigid blocks: strong inner faces", _strong, _rigid_blocks, _SUPPLIES),
        *insert_before(
            insert_before(insert_before(FALLBACKS, "repair", _LARGE), _LARGE.name, _LESS_MARGIN),
            "ray by batch solver",
            _UNSETTLED,
        ),
        Fallback(
            "loaded part",
            lambda attempt: attempt.wide_relative_to_load_factor,
            _loaded_part,
            "λ of light parts beside heavy ones that they do not touch",
        ),
        Fallback("rigid blocks: strengths far above some loads", _small, _rigid_blocks, _SUPPLIES),
    ),
}
"""Fallbacks tried in order, by the value of `Model.condense` ("off", "on", "auto")."""
