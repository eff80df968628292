"""Collapse without dilation of one labelling: one solution, the lowest and highest found, a proven bound below all.

- `ProximalOptions`: parameters of the fixed-point search
- `certificate`: the exact check of a lower bound on all solutions
- `modes`: the mechanisms, statics and regions that such a check speaks of
- `options_of`: return the parameters that a model states
- `prove`: prove λ without dilation of one labelling, as `jld_core` asks for it
- `prove_zero_dilation`: the same with parameters, and the range of λ

Terms of the lower bounds are those of docs/method.md (4.6) to (4.9).
"""

from jld_core import Bits, LimitAnalysis, Model
from jld_core.limit import Proof
from jld_dilation import certificate, modes
from jld_dilation.fixed_point_search import ProximalOptions
from jld_dilation.range import prove_zero_dilation

__all__ = ["ProximalOptions", "certificate", "modes", "options_of", "prove", "prove_zero_dilation"]


def options_of(model: Model) -> ProximalOptions:
    """Return the parameters of the fixed-point search that a model states.

    Parameters
    ----------
    model : Model
        Model without dilation.

    Returns
    -------
    ProximalOptions
        Start, share of the present normal force, effective areas.
    """
    return ProximalOptions(alpha=model.alpha, start=model.start, effective_area=model.effective_area)


def prove(analysis: LimitAnalysis, labels: Bits, model: Model, stands: bool, pruning_threshold: float) -> Proof:
    """Prove λ without dilation of one labelling, as `jld_core` asks for it.

    Parameters
    ----------
    analysis : LimitAnalysis
        Analysis with associative friction.
    labels : (m,) bool array
        Labels, True = dry.
    model : Model
        Options: effective areas, and the range with its time for a lower bound, s.
    stands : bool
        Also decide whether the structure stands at λ = 0.
    pruning_threshold : float
        λ, scene units, at or below which the labelling is of no interest.

    Returns
    -------
    Proof
        Proof in the scaled units of `analysis`.
    """
    options = options_of(model)
    seconds = model.floor_seconds if model.range else None
    return prove_zero_dilation(
        analysis, labels, options, stands=stands, pruning_threshold=pruning_threshold, range=seconds
    )
