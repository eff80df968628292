"""Provide `jld reliability`: reliability index and probability of failure of a layout."""

from __future__ import annotations

import json
import os
from typing import Annotated, Any

import typer

from jld_core import ParameterError, error_context
from jld_explore.cli import ending, layout, streams
from jld_explore.cli import options as cli_options
from jld_practice.reliability import ReliabilityOptions, SampleBounds, analyse, compare, structure_of
from jld_practice.reliability.monte_carlo import CONFIDENCE, SAMPLES, Comparison, Reliability

_SHOWN = 12  # number of variables of the printed table, those of largest importance first


def reliability(
    source: cli_options.Source,
    rank: cli_options.Rank = None,
    against: Annotated[
        int | None, typer.Option(min=1, help="Row of a folder's results.csv: how often the layout carries more.")
    ] = None,
    required: Annotated[float, typer.Option(help="Load factor below which the structure fails.")] = 1.0,
    samples: Annotated[int, typer.Option(min=1, help="Samples of the simulation.")] = SAMPLES,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")] = 0,
    jobs: Annotated[int | None, typer.Option(min=1, help="Threads; default: one per core.")] = None,
    as_json: cli_options.AsJson = False,
) -> None:
    """Compute the reliability index of a layout, by the first-order method and by simulation.

    Values of the scene with a distribution ({"mean", "cov", "kind"}) are random. The structure fails where its load
    factor is below --required. The exit code is 4 if samples stay undecided.
    """
    options = ReliabilityOptions(required, samples, seed, jobs or os.cpu_count() or 1)
    scene, assembly, labels, model = layout.layout_of(source, rank, uncertain=True)
    if against is not None and not source.is_dir():
        problem = f"{source} is a scene, which has one layout"
        raise ParameterError("against", problem, "a folder written by jld explore")
    with error_context(source):
        layout.require_whole_faces(model, "reliability")
        structure = structure_of(scene, assembly, labels)
        other = None if against is None else layout.layout_of(source, against, uncertain=True).labels
        result = analyse(structure, labels, options)
        compared = None
        if other is not None:
            pair = SampleBounds(structure, labels), SampleBounds(structure, other)
            compared = compare(*pair, options.samples, options.seed, options.jobs)
    facts: dict[str, Any] = {"name": scene.name, **result.to_json()}
    if compared is not None:
        facts["against"] = {
            "rank": against,
            "probability": compared.probability,
            "probability_interval": list(compared.interval),
            "stronger": compared.stronger,
            "weaker": compared.weaker,
            "undecided": compared.undecided,
        }
    streams.say(json.dumps(facts, indent=1) if as_json else "\n".join(_lines(scene.name, result, compared, against)))
    if result.simulation.undecided:
        raise typer.Exit(ending.UNCERTIFIED)


def _lines(name: str, result: Reliability, compared: Comparison | None, against: int | None) -> list[str]:
    form, simulation, seed = result.form, result.simulation, result.options.seed
    first = f"β = {form.beta:.4f}, probability {form.probability:.3g}" if form.found else f"none: {form.problem}"
    first += ", at a kink of λ" if form.found and form.kink else ""
    index = "none" if simulation.beta is None else f"{simulation.beta:.4f}"
    low, high = ("unbounded" if end is None else f"{end:.4f}" for end in simulation.beta_interval)
    how = "importance sampling" if simulation.importance else "plain sampling"
    within = f"{CONFIDENCE:.0%} between {low} and {high}"
    lines = [
        f"{name}: fails below λ = {result.options.required:g}; {len(result.variables)} random values",
        f"  first order   {first}",
        f"  simulation    β = {index} ({within}), probability {simulation.probability:.3g}",
        f"                {simulation.failures} of {simulation.samples} samples fail, {how}, seed {seed}",
    ]
    if simulation.importance:
        several = "one design point" if len(result.points) == 1 else f"{len(result.points)} design points"
        lines.append(f"                around {several}; the interval counts {simulation.unseen:.1e} away from them")
    if simulation.resolved:
        lines.append(f"                {simulation.resolved} left open by the batch solver and solved again")
    if simulation.undecided:
        lines.append(f"                {simulation.undecided} undecided, counted as failures")
    if compared is not None:
        ends = f"{CONFIDENCE:.0%} between {compared.interval[0]:.4g} and {compared.interval[1]:.4g}"
        lines.append(f"  against row {against}  carries more in {compared.probability:.2%} of samples ({ends})")
        lines.append(f"                less in {compared.weaker}, undecided or alike in {compared.undecided}")
    return lines + _table(result)


def _table(result: Reliability) -> list[str]:
    """Return the design point as lines of a table, largest importance first."""
    values = result.design_values
    if values is None:
        return []
    alpha = result.form.direction
    order = sorted(range(len(alpha)), key=lambda k: (-abs(alpha[k]), k))
    width = max(len(result.variables.names[k]) for k in order[:_SHOWN])
    lines = [f"  {'value':<{width}}  {'mean':>12}  {'design point':>12}  {'α':>7}  {'α²':>6}"]
    for k in order[:_SHOWN]:
        name, mean = result.variables.names[k], result.variables.mean[k]
        lines.append(f"  {name:<{width}}  {mean:>12.6g}  {values[k]:>12.6g}  {alpha[k]:>7.3f}  {alpha[k] ** 2:>6.1%}")
    if len(order) > _SHOWN:
        remainder = float((alpha[order[_SHOWN:]] ** 2).sum())
        lines.append(f"  {len(order) - _SHOWN} more, together α² = {remainder:.1%}")
    return lines
