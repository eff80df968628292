"""Provide `jld check-design`, `jld design` and `jld reliability`, and rank the best of a search by reliability."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
import typer

from jld_core import Assembly, Bits, Deadline, ParameterError, Scene, Status, error_context, files
from jld_core.limit import FIELD_SECONDS
from jld_core.scene import design as scene_design
from jld_explore import Exploration, ExploreSettings, Step, StepContext, with_entries
from jld_explore.cli import check as cli_check
from jld_explore.cli import ending, layout, options, streams
from jld_explore.cli import options as cli_options
from jld_explore.report import csv_of
from jld_explore.space import from_string
from jld_formats import forces as exchange_forces
from jld_practice.reliability import ReliabilityOptions, SampleBounds, analyse, compare, structure_of
from jld_practice.reliability.monte_carlo import CONFIDENCE, SAMPLES, Comparison, Reliability


def check_design(
    source: Annotated[
        Path, typer.Argument(help="A scene, or a folder of jld explore or jld design.", show_default=False)
    ],
    rank: options.Rank = None,
    set_: Annotated[
        str | None,
        typer.Option("--set", help="Set of partial factors: EN 1990, EN 1990 EQU, EN 1996-1-1, or one of the scene."),
    ] = None,
    cracks: options.Cracks = None,
    seconds: options.CaseSeconds = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Folder for page (PDF, HTML) and JSON.")] = None,
    language: Annotated[Literal["en", "de", "it"], typer.Option(help="Language of the page.")] = "en",
    as_json: options.AsJson = False,
) -> None:
    """Check a layout with partial factors: utilisation, reactions, joints near their limit.

    Utilisation is required factor over λ at design values; at most 1 is verified. Permanent loads are tried as
    favourable
    and as unfavourable. The exit code is 4 if neither result is proven.
    """
    from jld_practice.design_check import design_check, in_words, to_json

    if out is not None:
        files.require_folder(out)
    scene, labels = _layout(source, rank)
    with error_context(source):
        scene = options.with_cracks(scene, cracks)
        check = design_check(
            scene,
            labels,
            scene_design.partial_factors(scene.design, set_),
            seconds=FIELD_SECONDS if seconds is None else seconds,
        )
    if not as_json and not source.is_dir():
        cli_check.warn_of(source, check.assembly)
    told = json.dumps(to_json(check), indent=1)
    if out is not None:
        from jld_practice.design_check.page import write_pages

        out.mkdir(parents=True, exist_ok=True)
        files.write_text(out / "design_check.json", told)
        write_pages(check, out, language)
    streams.say(told if as_json else in_words(check))
    if check.verified is None:
        raise typer.Exit(ending.UNCERTIFIED)


def _layout(source: Path, rank: int | None) -> tuple[Scene, Bits | None]:
    """Return the scene and the labels (m,) to check; None for those of the scene."""
    best = source / "best.json"
    file = best if source.is_dir() and best.exists() else source
    if not file.is_dir():
        if rank is not None:
            raise ParameterError("rank", f"{file} is a scene, which has no ranks", "a folder written by jld explore")
        return cli_check.load(file)[0], None
    from jld_explore.cli import layout  # a folder needs pandas, a scene does not

    scene, _, labels, model = layout.layout_of(source, rank)
    with error_context(source):
        layout.require_whole_faces(model, "the design check")
    return scene, labels


OutlineFile = Annotated[
    Path, typer.Argument(help="Outline: scene, drawing (DXF, SVG, CSV) or solid (OBJ, PLY, STL).", show_default=False)
]
Folder = Annotated[Path, typer.Option("-o", "--out", help="Folder for page, picture and scene.", show_default=False)]


def design(
    context: typer.Context,
    outline: OutlineFile,
    out: Folder,
    block_mass: Annotated[float | None, typer.Option(help="Largest mass of a block, kg.")] = None,
    shapes: Annotated[int | None, typer.Option(help="Largest number of different blocks (moulds).")] = None,
    load: Annotated[
        list[str] | None,
        typer.Option(
            help='Force downwards, as "10 kN" (a number alone in the unit of a scene), or layers of live loads.'
        ),
    ] = None,
    along: Annotated[
        str,
        typer.Option(help="Where the load acts: top, bottom, left, right, extrados, or an edge by its ends X,Y,X,Y."),
    ] = "top",
    places: Annotated[
        str, typer.Option(help="Number of places of the load, or shares of the length, as 0.25,0.5.")
    ] = "1",
    width: Annotated[
        float | None, typer.Option(help="Length that the load is spread on, m; default a tenth of the top.")
    ] = None,
    push: Annotated[float | None, typer.Option(help="Horizontal load to either side, share of the weight.")] = None,
    friction: Annotated[float | None, typer.Option(help="Friction coefficient of joints.")] = None,
    friction_low: Annotated[
        float | None, typer.Option(help="Low friction to check the best at; default 0.8 times --friction.")
    ] = None,
    density: Annotated[float | None, typer.Option(help="Density of the stone, kg/m³.")] = None,
    tension: Annotated[float | None, typer.Option(help="Tensile strength of the stone, Pa.")] = None,
    shear: Annotated[float | None, typer.Option(help="Shear strength of the stone, Pa.")] = None,
    layer: cli_options.OnlyLayers = None,
    skip: cli_options.SkippedLayers = None,
    hole: cli_options.HoleLayers = None,
    support: cli_options.SupportLayers = None,
    dry: cli_options.DryLayers = None,
    inner: cli_options.InnerLayers = None,
    thickness: cli_options.Thickness = None,
    tolerance: cli_options.Tolerance = None,
    unit: cli_options.FileUnit = None,
    up: cli_options.Up = None,
    laid: Annotated[
        Literal["translation", "standing", "left-to-right", "right-to-left", "springings"] | None,
        typer.Option(help="Only layouts that can be laid (from where), or whose every stage stands."),
    ] = None,
    seconds: Annotated[float, typer.Option(help="Time limit of all together, s.")] = 300.0,
    jobs: Annotated[int | None, typer.Option(min=1, help="Worker processes; default: one per core.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of searches and irregular cells.")] = 0,
    as_json: cli_options.AsJson = False,
) -> None:
    """Design the blocks of an outline: cells tried, joints searched and moved, the best checked.

    The folder holds a page in plain words, a picture, the table of blocks and the scene of the best layout. After a
    signal it holds the best so far.
    """
    from jld_practice.design import DesignOptions, facts_of
    from jld_practice.design.page import words_of
    from jld_practice.design.run import design_outline

    forces = [text for text in load or () if exchange_forces.is_force(text)]
    if len(forces) > 1:
        raise ParameterError("load", f"{len(forces)} forces are given", "one force, which may act at several places")
    layers = cli_options.layer_options(
        layer=layer,
        skip=skip,
        hole=hole,
        support=support,
        load_layer=[text for text in load or () if text not in forces],
        dry=dry,
        inner=inner,
    )
    options = DesignOptions(
        block_mass=block_mass,
        shapes=shapes,
        load=forces[0] if forces else None,
        along=along,
        places=places,
        width=width,
        push=push,
        friction=friction,
        friction_low=friction_low,
        density=density,
        tension=tension,
        shear=shear,
        thickness=thickness,
        tolerance=tolerance,
        unit=unit,
        up=up,
        **layers,
        laid=laid,
        seconds=seconds,
        jobs=jobs or os.cpu_count() or 1,
        seed=seed,
    )
    ending.raise_on_signals()
    with error_context(outline, str(out), str(outline)):
        done = design_outline(outline, out, options, None if as_json else streams.say, started=context.obj)
    streams.say(json.dumps(facts_of(done), indent=1) if as_json else words_of(done))


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
        found = analyse(structure, labels, options)
        compared = None
        if other is not None:
            pair = SampleBounds(structure, labels), SampleBounds(structure, other)
            compared = compare(*pair, options.samples, options.seed, options.jobs)
    told: dict[str, Any] = {"name": scene.name, **found.to_json()}
    if compared is not None:
        told["against"] = {
            "rank": against,
            "probability": compared.probability,
            "probability_interval": list(compared.interval),
            "stronger": compared.stronger,
            "weaker": compared.weaker,
            "undecided": compared.undecided,
        }
    streams.say(json.dumps(told, indent=1) if as_json else "\n".join(_lines(scene.name, found, compared, against)))
    if found.simulation.undecided:
        raise typer.Exit(ending.UNCERTIFIED)


def _lines(name: str, found: Reliability, compared: Comparison | None, against: int | None) -> list[str]:
    form, simulation = found.form, found.simulation
    first = f"β = {form.beta:.4f}, probability {form.probability:.3g}" if form.found else f"none: {form.problem}"
    first += ", at a kink of λ" if form.found and form.kink else ""
    index = "none" if simulation.beta is None else f"{simulation.beta:.4f}"
    low, high = ("unbounded" if end is None else f"{end:.4f}" for end in simulation.beta_interval)
    how = "importance sampling" if simulation.importance else "plain sampling"
    within = f"{CONFIDENCE:.0%} between {low} and {high}"
    lines = [
        f"{name}: fails below λ = {found.options.required:g}; {len(found.variables)} random values",
        f"  first order   {first}",
        f"  simulation    β = {index} ({within}), probability {simulation.probability:.3g}",
        f"                {simulation.failures} of {simulation.samples} samples fail, {how}, seed {found.options.seed}",
    ]
    if simulation.importance:
        several = "one design point" if len(found.points) == 1 else f"{len(found.points)} design points"
        lines.append(f"                around {several}; the interval counts {simulation.unseen:.1e} away from them")
    if simulation.resolved:
        lines.append(f"                {simulation.resolved} left open by the batch solver and solved again")
    if simulation.undecided:
        lines.append(f"                {simulation.undecided} undecided, counted as failures")
    if compared is not None:
        ends = f"{CONFIDENCE:.0%} between {compared.interval[0]:.4g} and {compared.interval[1]:.4g}"
        lines.append(f"  against row {against}  carries more in {compared.probability:.2%} of samples ({ends})")
        lines.append(f"                less in {compared.weaker}, undecided or alike in {compared.undecided}")
    return lines + _table(found)


def _table(found: Reliability) -> list[str]:
    """Return the design point as lines of a table, largest importance first."""
    values = found.design_values
    if values is None:
        return []
    alpha = found.form.direction
    order = sorted(range(len(alpha)), key=lambda k: (-abs(alpha[k]), k))
    width = max(len(found.variables.names[k]) for k in order[:_SHOWN])
    lines = [f"  {'value':<{width}}  {'mean':>12}  {'design point':>12}  {'α':>7}  {'α²':>6}"]
    for k in order[:_SHOWN]:
        name, mean = found.variables.names[k], found.variables.mean[k]
        lines.append(f"  {name:<{width}}  {mean:>12.6g}  {values[k]:>12.6g}  {alpha[k]:>7.3f}  {alpha[k] ** 2:>6.1%}")
    if len(order) > _SHOWN:
        rest = float((alpha[order[_SHOWN:]] ** 2).sum())
        lines.append(f"  {len(order) - _SHOWN} more, together α² = {rest:.1%}")
    return lines


FILE: Final = "reliability.csv"  # table of reliability indices in a results folder

# Keys of an analysis that become columns of the table
_KEPT: Final = ("beta_form", "beta_monte_carlo", "probability", "failures", "samples", "undecided")

COLUMNS: Final = ("row", "labelling", "load_factor", *_KEPT)

RANKED_SAMPLES: Final = 10_000  # samples of each layout: less than `jld reliability` draws, since it ranks alone

_SHARE: Final = 0.25  # share of a time limit that is kept back for the ranking


class ReliabilityStep(Step):
    """Ranking of the best layouts of a search by reliability."""

    name = "reliability"

    def wanted(self, settings: ExploreSettings) -> bool:
        return settings.reliability is not None

    def refuse(self, scene: Scene, assembly: Assembly, settings: ExploreSettings) -> None:
        for name, asked in (
            ("objective", settings.model.friction != "associative" or settings.own_objective is not None),
            ("robust", settings.robust),
            ("contact", settings.model.contact != "convex"),
            ("effective_area", settings.model.effective_area),
            ("inner_bending", settings.model.inner_bending != "uncoupled"),
            ("cracks", scene.cracks != "faces"),
            ("search.void", scene.search.void is not None),
        ):
            if asked:
                problem = "reliability supports rigid faces and associative friction only"
                raise ParameterError(name, problem, "its default")
        from jld_practice.reliability import random_structure

        random_structure(scene)

    def seconds(self, settings: ExploreSettings) -> float:
        return _SHARE * (settings.seconds or 0.0)

    def entries(self, done: Exploration, context: StepContext) -> Mapping[str, Any]:
        rows, asked = _ranked(done, context.settings, context.deadline)
        return {
            "layouts": rows,
            "left_out": asked - len(rows),
            "best_labelling": rows[0]["labelling"] if rows else None,
        }

    def run(self, done: Exploration, context: StepContext) -> Exploration:
        import pandas as pd  # slow to import and needed for tables only

        entries = self.entries(done, context)
        files.write_text(done.folder / FILE, csv_of(pd.DataFrame(entries["layouts"])))
        by_labelling = {row["labelling"]: row for row in entries["layouts"]}
        rows = [by_labelling.get(str(labelling), {}) for labelling in done.results["labelling"]]
        columns = {
            name: np.array([row.get(name) for row in rows], dtype=float) for name in ("beta_form", "beta_monte_carlo")
        }
        return with_entries(done, {self.name: entries}, columns)


def _ranked(done: Exploration, settings: ExploreSettings, deadline: Deadline) -> tuple[list[dict[str, Any]], int]:
    """Return rows of the best layouts, most reliable first, and how many were to be ranked."""
    from jld_practice.reliability import ReliabilityOptions, analyse, random_structure

    structure = random_structure(done.scene)
    options = ReliabilityOptions(samples=RANKED_SAMPLES, seed=settings.seed, jobs=settings.jobs)
    ranked = done.results[done.results["status"] == str(Status.COLLAPSE)].head(settings.reliability or 0)
    rows: list[dict[str, Any]] = []
    for number, (labelling, load) in enumerate(zip(ranked["labelling"], ranked["load_factor"], strict=True), 1):
        if rows and deadline.passed():
            break
        told = analyse(structure, from_string(str(labelling)), options).to_json()
        own = (number, str(labelling), float(load), *(told[key] for key in _KEPT))
        rows.append(dict(zip(COLUMNS, own, strict=True)))
    rows.sort(key=lambda row: (-_index(row), row["row"]))
    return rows, len(ranked)


def _index(row: dict[str, Any]) -> float:
    """Return the index that ranks a layout, by simulation or of first order; inf where no sample fails."""
    for name in ("beta_monte_carlo", "beta_form"):
        if row[name] is not None:
            return float(row[name])
    return -np.inf if row["probability"] == 1.0 else np.inf
