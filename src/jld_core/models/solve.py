"""How one labelling is solved: which model, by which rungs, and what becomes its result. Stated here alone.

Only what is asked for is modelled: point contacts, kern bending, effective areas and zero dilation each have
their own module and cost nothing where they are not wanted.
"""

from __future__ import annotations

import inspect
import math
import time
from collections.abc import Callable
from dataclasses import fields
from typing import Any, Final, TypeVar, cast

import numpy as np

from jld_core.arrays import Bits
from jld_core.assembly import Assembly
from jld_core.errors import InputError, SolverError
from jld_core.limit import (
    FALLBACKS,
    Fallback,
    LimitAnalysis,
    LimitAnalysisResult,
    Proof,
    ProofAttempt,
    SolveOptions,
    governing_result,
    result_of,
)
from jld_core.mechanics import require_materials
from jld_core.models.effective_area import prove_effective_area, require_rectangles
from jld_core.models.point_contacts import point_contact_assembly, proof_of_faces
from jld_core.models.rigid_blocks import prove_condensed, worth_condensing
from jld_core.models.zero_dilation.search import ProximalOptions
from jld_core.models.zero_dilation.solve import prove_zero_dilation
from jld_core.solvers import is_large
from jld_core.threads import one_thread

_Function = TypeVar("_Function", bound=Callable[..., Any])


def _with_options(function: _Function) -> _Function:
    """A function whose `**options` are the fields of `SolveOptions`: what `help` and notebooks then show of it."""
    stated = inspect.signature(function)
    own = [one for one in stated.parameters.values() if one.kind is not inspect.Parameter.VAR_KEYWORD]
    more = [
        inspect.Parameter(one.name, inspect.Parameter.KEYWORD_ONLY, default=one.default, annotation=one.type)
        for one in fields(SolveOptions)
    ]
    function.__signature__ = stated.replace(parameters=[*own, *more])  # type: ignore[attr-defined]
    return function


@_with_options
@one_thread()
def solve(assembly: Assembly, labels: Bits | None = None, **options: Any) -> LimitAnalysisResult:
    """Collapse load factor of one labelling, with a two-sided bracket.

    assembly: planar or spatial. labels: (m,) True dry; default the scene's own. All else: see `SolveOptions`.
    Of a structure with load cases: the governing factor, and every case's own result in `cases`.
    Raises InputError where a material that the labelling needs is missing, or an option has no such value.
    Source: Iannuzzo et al. 2024, eq. (2); docs/method.md (2.1), (3.3).
    """
    if assembly.cases:
        return governing_result(
            assembly,
            {
                case.name: solve(one, labels, **options)
                for case, one in zip(assembly.cases, assembly.by_case, strict=True)
            },
        )
    model = SolveOptions(**options)
    own = assembly.labels if labels is None else np.asarray(labels, dtype=bool)
    require_materials(assembly, own, ~own)
    analysis = limit_analysis(assembly, model, reference=own, single=model.modular)
    start = time.perf_counter()
    proof = solve_labelling(analysis, own, model, stands=True)
    elapsed = time.perf_counter() - start
    return result_of(analysis.template, own, model, proof, assemble=analysis.seconds, elapsed=elapsed)


def limit_analysis(
    assembly: Assembly, options: SolveOptions, reference: Bits | None = None, *, single: bool = False
) -> LimitAnalysis:
    """The limit analysis that `solve_labelling` asks for, for any number of labellings of an assembly, or for one."""
    solver, gap, bending = options.solver, options.gap, options.inner_bending
    return LimitAnalysis(assembly, solver=solver, gap=gap, inner_bending=bending, reference=reference, single=single)


def require_model(assembly: Assembly, options: SolveOptions, dry: Bits) -> None:
    """Raise InputError where options do not go with an assembly of which the faces (m,) `dry` may be dry.

    Asked before anything is begun, so that nothing is half done.
    """
    if options.effective_area:
        require_rectangles(assembly, dry)
    if options.solver == "auto":
        return
    analysis = limit_analysis(assembly.by_case[0], options)
    try:
        analysis.route.require(analysis.template.structure)
    except SolverError as error:
        raise InputError("--solver", str(error), "a solver that takes this scene") from None


def solve_labelling(
    analysis: LimitAnalysis, labels: Bits, options: SolveOptions, *, stands: bool = False, floor: float = -math.inf
) -> Proof:
    """Proof of one labelling under the options asked for, about the analysis' own assembly and scaled as in it.

    analysis: of `limit_analysis`. labels: (m,) True dry. stands: also decide whether it stands at λ = 0. floor: λ,
    scene units, at or below which a labelling does not matter (without dilation, see `prove_zero_dilation`).
    """
    if options.contact == "concave" and analysis.assembly.dimension == 3:
        points, parent = point_contact_assembly(analysis.assembly, labels)
        other = limit_analysis(points, options, reference=points.labels)
        proof = _proof(other, points.labels, options, stands, floor)
        return proof_of_faces(analysis, other, parent, proof)
    return _proof(analysis, labels, options, stands, floor)


def _proof(analysis: LimitAnalysis, labels: Bits, options: SolveOptions, stands: bool, floor: float) -> Proof:
    """The proof under convex contact."""
    if options.friction == "zero-dilation":
        scheme = ProximalOptions(effective_area=options.effective_area)
        seconds = options.floor_seconds if options.range else None
        return prove_zero_dilation(analysis, labels, scheme, stands=stands, floor=floor, range=seconds)
    if options.effective_area:
        return prove_effective_area(analysis, labels, stands=stands)
    return analysis.prove(labels, FALLBACKS_BY_FRICTION[options.condense], stands=stands)


# --- the ladder with rigid blocks ---------------------------------------------------------------------------


def _rigid_blocks(climb: ProofAttempt) -> None:
    found = prove_condensed(cast(LimitAnalysis, climb.analysis), climb.labels)
    if found is not None:
        climb.take(found)


def _strong(climb: ProofAttempt) -> bool:
    return worth_condensing(climb.template, climb.labels)


def _large(climb: ProofAttempt) -> bool:
    return climb.open and not climb.labels.all() and is_large(climb.template.structure)


def _left(climb: ProofAttempt) -> bool:
    return climb.open and not climb.labels.all() and not is_large(climb.template.structure)


_OFFER: Final = "both sides by blocks that are rigid until shown otherwise: no rounding is left in their cracks"

FALLBACKS_BY_FRICTION: Final[dict[str, tuple[Fallback, ...]]] = {
    "off": FALLBACKS,
    "on": (Fallback("rigid blocks", lambda climb: True, _rigid_blocks, _OFFER), *FALLBACKS),
    "auto": (
        Fallback("rigid blocks: strong inner faces", _strong, _rigid_blocks, _OFFER),
        *FALLBACKS[:2],
        Fallback("rigid blocks: repairs would take longer", _large, _rigid_blocks, _OFFER),
        *FALLBACKS[2:],
        Fallback("rigid blocks: strengths far above some loads", _left, _rigid_blocks, _OFFER),
    ),
}
"""What is tried, in order, by `SolveOptions.condense`."""
