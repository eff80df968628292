"""Provide `jld experiment`: load one layout until collapse, beside limit analysis."""

from __future__ import annotations

import contextlib
import json
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from jld_core import Assembly, Bits, LimitAnalysisResult, Model, ParameterError, Status, error_context, files
from jld_core.models import rigid, solve_rigid
from jld_explore.cli import ending, layout, options, streams
from jld_explore.report import csv_of

if TYPE_CHECKING:
    from jld_experiment import Curve

_FLOOR = 5.0  # processor time, s, after which the lower bound without dilation begins no further step


def experiment(
    source: options.Source,
    rank: options.Rank = None,
    dilation: Annotated[
        str, typer.Option(help="Opening of dry joints as they slide: 0, friction (associative), or a tangent.")
    ] = "0",
    inner: Annotated[
        Literal["brittle", "plastic"],
        typer.Option(help="Inner faces beyond their strength lose it (brittle) or keep it (plastic)."),
    ] = "brittle",
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Folder for curve, picture and summary.")] = None,
    scheme: Annotated[
        Literal["trapezoid", "simpson", "midpoint", "limit"], typer.Option(help="Where sub-contacts lie on a face.")
    ] = "trapezoid",
    segments: Annotated[int, typer.Option(min=1, help="Parts of a face between sub-contacts.")] = 4,
    moving: Annotated[
        bool, typer.Option("--moving", help="Follow the geometry, with new contacts at corners.")
    ] = False,
    normal_stiffness: Annotated[
        float | None, typer.Option(help="Normal stiffness of a face, force per length³; default: nearly rigid.")
    ] = None,
    shear_stiffness: Annotated[float | None, typer.Option(help="Shear stiffness; default: the normal one.")] = None,
    inner_ratio: Annotated[float, typer.Option(help="Stiffness of inner faces over that of dry ones.")] = 1.0,
    residual_friction: Annotated[float, typer.Option(help="Friction coefficient of a crack.")] = 0.0,
    as_json: options.AsJson = False,
) -> None:
    """Load a layout in a virtual experiment until it comes down, and compare with λ.

    The layout is pushed twice, slowly and fast. The output has the collapse load, its ratio to λ, and the load at the
    first crack. The exit code is 4 if the two pushes do not agree.
    """
    from jld_experiment import Joints, Settings, run_experiment
    from jld_experiment.experiments import summary

    if out is not None:
        files.require_folder(out)
    joints = Joints(
        normal_stiffness=normal_stiffness,
        shear_stiffness=shear_stiffness,
        inner_ratio=inner_ratio,
        dilation="friction" if dilation == "friction" else _tangent(dilation),
        inner=inner,
        residual_friction=residual_friction,
    )
    settings = Settings(scheme=scheme, segments=segments, moving=moving)
    _, assembly, labels, model = layout.layout_of(source, rank)
    start = time.perf_counter()
    with error_context(source):
        assembly, labels = rigid(assembly, labels, "an experiment")
        curve = run_experiment(assembly, labels, joints=joints, settings=settings)
        spent = time.perf_counter() - start
        limit = solve_rigid(assembly, labels, model)
    facts = summary(curve, limit.load_factor) | {"seconds": spent}
    if out is not None:
        facts |= _without_dilation(assembly, labels) if curve.stands else {}
        _write(curve, limit, facts, out)
    streams.say(json.dumps(facts, indent=1) if as_json else _words(facts))
    if facts["status"] == "uncertified":
        raise typer.Exit(ending.UNCERTIFIED)


def _tangent(text: str) -> float:
    """Convert text to a finite tangent of at least 0; raise InputError if it is invalid."""
    with contextlib.suppress(ValueError):
        if 0.0 <= (value := float(text)) < math.inf:
            return value
    raise ParameterError("dilation", f"{text!r} is no dilation", "0, friction or a tangent")


def _without_dilation(assembly: Assembly, labels: Bits) -> dict[str, Any]:
    """Return the lowest and highest λ without dilation, and the proven bound on the lowest."""
    planar = assembly.dimension == 2
    model = Model(friction="zero-dilation", range=planar, floor_seconds=_FLOOR)
    result = solve_rigid(assembly, labels, model)
    if result.status is not Status.COLLAPSE:
        return {"zero_dilation_lowest": None, "zero_dilation_highest": None, "zero_dilation_proven": None}
    highest = result.facts["highest_found"] if planar else result.load_factor
    proven = result.facts["lowest_proven"] if planar else None
    lowest = result.load_factor
    return {"zero_dilation_lowest": lowest, "zero_dilation_highest": highest, "zero_dilation_proven": proven}


def _write(curve: Curve, limit: LimitAnalysisResult, facts: dict[str, Any], out: Path) -> None:
    from jld_experiment.experiments import figure_of, table
    from jld_views import figures

    out.mkdir(parents=True, exist_ok=True)
    files.write_text(out / "curve.csv", csv_of(table(curve)))
    files.write_text(out / "summary.json", json.dumps(facts, indent=1))
    low, high = facts.get("zero_dilation_lowest"), facts.get("zero_dilation_highest")
    band = None if low is None or high is None else (low, high)
    figures.save_figure(figure_of(curve, limit, band, facts.get("zero_dilation_proven")), out / "experiment.png")


def _words(facts: dict[str, Any]) -> str:
    def plain(value: float | None, digits: int = 6) -> str:
        return "none" if value is None else f"{value:.{digits}g}"

    lines = {
        "scene": facts["name"],
        "status": facts["status"],
        "experiment": f"collapse at λ = {plain(facts['collapse_load'])}, "
        f"two rates differ by {plain(facts['rate_error'], 2)}; accuracy {plain(facts['accuracy'], 2)} at best",
        "limit": f"λ = {plain(facts['load_factor'])}, ratio {plain(facts['ratio'], 4)}",
        "first crack": plain(facts["first_crack"]),
        "energy": f"work of the loads against stored and lost energy: error {plain(facts['energy_error'], 2)}",
        "faces": f"{facts['inner']} inner, dilation {facts['dilation']}, {facts['cracked_faces']} cracked",
    }
    if facts.get("zero_dilation_lowest") is not None:
        low, high = plain(facts["zero_dilation_lowest"]), plain(facts["zero_dilation_highest"])
        proven = facts["zero_dilation_proven"]
        none = "" if proven is None else f", none below {plain(proven)}, proven"
        lines["no dilation"] = f"limit analysis finds λ from {low} to {high}{none}"
    if not facts["stands"]:
        lines["experiment"] = "does not stand under its dead loads alone"
    return "\n".join(f"{name:<12} {value}" for name, value in lines.items())
