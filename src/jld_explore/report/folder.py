"""A study's folder: tables and pictures written, and read back."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from jld_core.build import build_assembly
from jld_core.errors import InputError
from jld_core.exchange import blocks_csv
from jld_core.limit import SolveOptions
from jld_core.models import solve
from jld_core.solvers import SOLVERS
from jld_explore.evaluation import RECORDS_FILE
from jld_explore.report import tables
from jld_explore.report.columns import columns, csv_of
from jld_explore.report.evidence import front_rows, with_evidence
from jld_explore.report.exploration import Exploration
from jld_explore.space import from_string
from jld_explore.study import StopReason, Study, versions

if TYPE_CHECKING:
    pass


def check_folder(folder: Path, resume: bool) -> None:
    """Raise InputError for a folder that may not be written into."""
    check_writable(folder)
    if not folder.exists() or not any(folder.iterdir()):
        return
    if not resume:
        raise InputError(str(folder), "the folder is not empty", "an empty or new folder, or --resume to go on with it")
    if not (folder / RECORDS_FILE).exists():
        raise InputError(
            str(folder), f"nothing to go on with: no {RECORDS_FILE} in it", "a folder written by jld explore"
        )


def check_writable(folder: Path) -> None:
    """Raise InputError where no folder of this name can be made or written into."""
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not there.is_dir():
        raise InputError(str(there), "it is a file", "a folder for the results")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(str(there), "it is not writable", "a folder that results may be written into")


def write_tables(study: Study, reason: StopReason) -> Exploration:
    """Write every table of a study that ended for a reason."""
    results = tables.results_table(study.records, study.assembly, study.space, study.driver.name)
    axes = study.scene.search.front.axes
    counts = [name for name, _ in axes]
    front = tables.front_table(results, axes)
    complete = reason is StopReason.EXHAUSTED and study.driver.exhaustive
    found = tables.summary(
        results,
        stop_reason=str(reason),
        complete=complete,
        classes=len(results) if complete else study.total,
        solved=study.solved,
        seconds=study.elapsed,
        driver=study.driver.name,
        seed=study.settings.seed,
        versions=versions(),
        bound=study.driver.bound,
        proven=study.driver.finished,
    )
    found["warnings"] = list(study.assembly.warnings)
    model = study.settings.model
    found["model"] = model.facts()
    if model.effective_area:
        # proven with the areas of each labelling frozen, which says nothing of other fixed points
        found |= {"proven": False, "bound": None, "gap": None}
    found |= study.driver.facts(results, complete)
    aimed = study.driver.settings.get("aim") == "front"
    sure = complete and bool(found["proven"])
    found["front"] = front_rows(front, found, counts, complete=sure, aimed=aimed)
    front = with_evidence(front, found, counts)
    write_text(study.folder / "faces.csv", csv_of(tables.faces_table(study.assembly, study.space)))
    write_text(study.folder / "results.csv", csv_of(results))
    with whole_file(study.folder / "results.parquet") as fresh:
        results.to_parquet(fresh, index=False)
    write_text(study.folder / "pareto.csv", csv_of(front))
    write_text(study.folder / tables.CONVERGENCE, csv_of(tables.convergence_table(study.records)))
    write_text(study.folder / "columns.json", json.dumps(columns(study.assembly), indent=1, ensure_ascii=False))
    write_text(study.folder / "summary.json", json.dumps(found, indent=1))
    done = Exploration(study.scene, study.assembly, results, front, found, study.folder, reason, model)
    if found["best_labelling"] is not None:
        write_text(study.folder / "blocks.csv", blocks_csv(done.layout()))
    return done


def write_pictures(done: Exploration, ending: str = "png", out: Path | None = None) -> list[Path]:
    """Draw the front with its layouts and, where one was found, the best layout. Returns what was written.

    ending: "png", "svg" or "pdf". out: folder written into, default the study's own.
    Raises InputError for another ending.
    """
    from jld_core.views.figures import save_figure
    from jld_explore.report import pictures as drawings
    from jld_explore.report.pictures_of_three import front_picture

    pictures = {"pareto": front_picture(done)}
    best = done.summary["best_labelling"]
    if best is not None:
        found = solve(done.assembly, from_string(best), **vars(done.model))
        pictures["best"] = drawings.plot_best(found)
        # of several load cases the best picture shows the one that governs, and each has one of its own
        for number, one in enumerate(found.cases.values(), 1):
            pictures[f"best-{number}"] = drawings.plot_best(one)
    pictures["distribution"] = drawings.plot_distribution(done.results)
    pictures["dry_frequency"] = drawings.plot_dry_frequency(done.results, done.assembly)
    history = done.folder / tables.CONVERGENCE
    if history.exists():
        pictures["convergence"] = drawings.plot_convergence({str(done.summary["driver"]): pd.read_csv(history)})
    written = [(out or done.folder) / f"{name}.{ending}" for name in pictures]
    for path, figure in zip(written, pictures.values(), strict=True):
        save_figure(figure, path)
    return written


def read_folder(folder: Path) -> Exploration:
    """A finished study read back from its folder. Raises InputError where a file is missing."""
    from jld_core.scene.reading import load_scene

    for name in (RECORDS_FILE, "scene.json", "results.parquet", "summary.json"):
        if not (folder / name).exists():
            raise InputError(str(folder), f"{name} is missing", "a folder written by jld explore")
    scene = load_scene(folder / "scene.json")
    results = pd.read_parquet(folder / "results.parquet")
    axes = scene.search.front.axes
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return Exploration(
        scene=scene,
        assembly=build_assembly(scene),
        results=results,
        front=with_evidence(tables.front_table(results, axes), summary, [name for name, _ in axes]),
        summary=summary,
        folder=folder,
        stop_reason=StopReason(summary["stop_reason"]),
        model=model_of(summary),
    )


def model_of(summary: dict[str, Any]) -> SolveOptions:
    """What a summary says was modelled; a solver that was handed in is taken for the default one."""
    facts = dict(summary["model"])
    if facts["solver"] not in SOLVERS:
        facts["solver"] = "auto"
    return SolveOptions(**facts)


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    with whole_file(path) as fresh:
        fresh.write_text(text, encoding="utf-8")


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A name to write under, which becomes the file's once all is written; where that fails nothing stays.

    Raises OSError with the name of the file.
    """
    fresh = path.with_name(path.name + ".new")
    try:
        yield fresh
        os.replace(fresh, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror or str(error), str(path)) from None
    finally:
        fresh.unlink(missing_ok=True)
