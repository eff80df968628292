"""From a scene to a finished folder: driver chosen, study run, tables and pictures written."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from jld_core.assembly import Assembly
from jld_core.build.assemble import build_assembly
from jld_core.errors import InputError
from jld_core.models.solve import solve
from jld_core.scene.reading import Scene
from jld_core.views import notebook
from jld_explore.drivers.enumeration import size_up_to
from jld_explore.drivers.exact.driver import Exact
from jld_explore.drivers.exact.optimum import front as proven_front
from jld_explore.drivers.exact.optimum import front_of_all
from jld_explore.drivers.registry import DRIVERS, OPTIONS, make_driver
from jld_explore.evaluation.evaluator import EvaluatorSettings
from jld_explore.evaluation.records import NAME, Store
from jld_explore.evaluation.with_certificates import NAME as ARCHIVE
from jld_explore.report import tables, words
from jld_explore.space.labelling import from_string
from jld_explore.space.search_space import SearchSpace, search_space
from jld_explore.study import Interrupted, Progress, StopReason, Study, versions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SMALL = 20_000
"""Classes up to which a space is enumerated when no driver is named."""


@dataclass(frozen=True)
class Exploration:
    """A finished study: its tables (columns as in results.csv), its summary and its folder.

    results: one row per class, ranked. front: those of its rows that are on the front. summary: as in summary.json.
    In a notebook it shows what was found, the front with its layouts, and the first rows of both tables.
    """

    scene: Scene
    assembly: Assembly
    results: pd.DataFrame
    front: pd.DataFrame
    summary: dict[str, Any]
    folder: Path
    stop_reason: StopReason

    @cached_property
    def _drawing(self) -> str | None:
        if len(self.assembly.elements) > notebook.LARGEST:
            return None
        from jld_core.views.figures import svg_of

        return svg_of(_front_picture(self))

    def _repr_svg_(self) -> str | None:
        return self._drawing

    def _repr_html_(self) -> str:
        tables_of = {"strongest": words.best_rows(self), f"front, {words.front_name(self)}": self.front}
        parts = [f"<p>{name}</p>{table[words.COLUMNS].to_html(index=False)}" for name, table in tables_of.items()]
        return notebook.page(self.scene.name, words.facts_of_exploration(self), self._drawing, *parts)


@dataclass(frozen=True)
class ExploreSettings:
    """How to search. driver: a name, or None to choose. budget: classes; seconds: time limit; seed, jobs as said.

    resume: go on with a folder that holds a study. certificates: let past solves settle labellings.
    """

    driver: str | None = None
    objective: str = "associative"
    budget: int | None = None
    seconds: float | None = None
    jobs: int = 1
    seed: int = 0
    resume: bool = False
    certificates: bool = False
    options: dict[str, Any] = field(default_factory=dict)


def explore(
    scene: Scene,
    folder: Path,
    settings: ExploreSettings | None = None,
    report: Callable[[Progress], None] | None = None,
    announce: Callable[[str], None] | None = None,
) -> Exploration:
    """Search the labellings of a scene and write everything docs/scene.md lists into a folder.

    scene: validated. folder: empty or new, unless resuming. report: called with progress. announce: told which
    driver was chosen. Raises InputError for a folder or a search that cannot be used; Interrupted after writing
    the tables of what was finished.
    """
    settings = settings or ExploreSettings()
    check_folder(folder, settings.resume)
    assembly = build_assembly(scene)
    space = search_space(scene, assembly)
    name, total = choose_driver(space, settings)
    if announce is not None:
        announce(f"driver: {name}" + (f", {total} classes" if total is not None else ""))
    study = Study(
        scene=scene,
        assembly=assembly,
        space=space,
        driver=make_driver(name, space, settings.seed, **_options(name, scene, folder, settings)),
        folder=folder,
        seed=settings.seed,
        jobs=settings.jobs,
        budget=settings.budget,
        seconds=settings.seconds,
        settings=EvaluatorSettings(objective=settings.objective),
        certificates=settings.certificates and settings.objective == "associative",
        total=total,
        report=report,
    )
    write_text(folder / "scene.json", scene.model_dump_json(indent=1, exclude_defaults=True))
    try:
        reason = study.run()
    except BaseException:
        # a signal may come between the disk and the memory: what is on disk is what was finished
        study.store = Store(folder, study.header, len(assembly.interfaces))
        study.store.close()
        _write_tables(study, name, StopReason.INTERRUPTED, total)
        raise
    if reason is StopReason.EXHAUSTED and not len(study.store):
        # a space too large to see through beforehand has turned out empty: leave nothing behind
        for path in (study.store.path, folder / ARCHIVE, folder / "scene.json"):
            path.unlink(missing_ok=True)
        if not any(folder.iterdir()):
            folder.rmdir()
        raise _nothing_to_search()
    done = _write_tables(study, name, reason, total)
    write_pictures(done)
    return done


def _options(name: str, scene: Scene, folder: Path, settings: ExploreSettings) -> dict[str, Any]:
    """The driver's own options. Raises InputError for one that another driver takes."""
    given = {key: value for key, value in settings.options.items() if value is not None}
    for key in given:
        if key not in OPTIONS.get(name, ()):
            owner = next((other for other, keys in OPTIONS.items() if key in keys), None)
            raise InputError(f"--{key}", f"the driver {name} has no such option", f"--driver {owner}")
    if name == "optuna":
        given.setdefault("storage", folder / "optuna.sqlite3")
        facts = (scene.name, scene.fingerprint[:12], settings.objective, given.get("sampler", "TPE"), settings.seed)
        given["title"] = "jld " + " ".join(str(fact) for fact in facts)
    return given


def check_folder(folder: Path, resume: bool) -> None:
    """Raise InputError for a folder that may not be written into."""
    check_writable(folder)
    if not folder.exists() or not any(folder.iterdir()):
        return
    if not resume:
        raise InputError(str(folder), "the folder is not empty", "an empty or new folder, or --resume to go on with it")
    if not any(folder.glob(NAME.partition(".")[0] + ".*")):
        raise InputError(str(folder), f"nothing to go on with: no {NAME} in it", "a folder written by jld explore")


def check_writable(folder: Path) -> None:
    """Raise InputError where no folder of this name can be made or written into."""
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not there.is_dir():
        raise InputError(str(there), "it is a file", "a folder for the results")
    if not os.access(there, os.W_OK | os.X_OK):
        raise InputError(str(there), "it is not writable", "a folder that results may be written into")


def choose_driver(space: SearchSpace, settings: ExploreSettings) -> tuple[str, int | None]:
    """Name of the driver and the number of classes where it is known.

    Raises InputError for an unknown name, and for a space that provably holds no labelling.
    """
    if settings.driver is not None and settings.driver not in DRIVERS:
        raise InputError("--driver", f"no driver is named {settings.driver!r}", "one of " + ", ".join(DRIVERS))
    known = size_up_to(space, SMALL)
    if known == 0:
        raise _nothing_to_search()
    return settings.driver or ("enumeration" if known is not None else "genetic"), known


def _nothing_to_search() -> InputError:
    return InputError("search", "no labelling satisfies the constraints", "constraints that some labelling meets")


def _write_tables(study: Study, driver: str, reason: StopReason, total: int | None) -> Exploration:
    results = tables.results_table(study.store, study.assembly, study.space, driver)
    front_of = study.scene.search.front
    front = tables.front_table(results, front_of.count, front_of.sense)
    complete = reason is StopReason.EXHAUSTED and study.driver.exhaustive
    found = tables.summary(
        results,
        stop_reason=str(reason),
        complete=complete,
        classes=len(results) if complete else total,
        solved=study.solved,
        seconds=study.elapsed,
        driver=driver,
        seed=study.seed,
        versions=versions(),
        bound=study.driver.bound,
        proven=study.driver.finished,
    )
    if isinstance(study.driver, Exact):
        found |= {"conflicts": study.driver.conflicts, "relaxations": study.driver.relaxations}
        if study.driver.aim == "front":
            known = study.driver.found.values()
            everything = study.driver.exhaustive
            count = study.space.search.front.count
            found["front"] = front_of_all(results, count, complete) if everything else proven_front(known)
    write_text(study.folder / "faces.csv", tables.faces_table(study.assembly, study.space).to_csv(index=False))
    write_text(study.folder / "results.csv", results.to_csv(index=False))
    fresh = study.folder / "results.parquet.new"
    results.to_parquet(fresh, index=False)
    os.replace(fresh, study.folder / "results.parquet")
    write_text(study.folder / "pareto.csv", front.to_csv(index=False))
    write_text(study.folder / tables.CONVERGENCE, tables.convergence_table(study.store).to_csv(index=False))
    write_text(study.folder / "summary.json", json.dumps(found, indent=1))
    return Exploration(study.scene, study.assembly, results, front, found, study.folder, reason)


def write_pictures(done: Exploration, ending: str = "png", out: Path | None = None) -> list[Path]:
    """Draw the front with its layouts and, where one was found, the best layout. Returns what was written.

    ending: "png", "svg" or "pdf". out: folder written into, default the study's own.
    Raises InputError for another ending.
    """
    from jld_core.views.figures import save_figure
    from jld_explore.report import pictures as drawings

    pictures = {"pareto": _front_picture(done)}
    best = done.summary["best_labelling"]
    if best is not None:
        pictures["best"] = drawings.plot_best(solve(done.assembly, from_string(best)))
    pictures["distribution"] = drawings.plot_distribution(done.results)
    pictures["dry_frequency"] = drawings.plot_dry_frequency(done.results, done.assembly)
    history = done.folder / tables.CONVERGENCE
    if history.exists():
        pictures["convergence"] = drawings.plot_convergence({str(done.summary["driver"]): pd.read_csv(history)})
    written = [(out or done.folder) / f"{name}.{ending}" for name in pictures]
    for path, figure in zip(written, pictures.values(), strict=True):
        save_figure(figure, path)
    return written


def _front_picture(done: Exploration) -> Figure:
    from jld_explore.report.pictures import plot_pareto

    front_of = done.scene.search.front
    return plot_pareto(done.results, done.front, done.assembly, count=front_of.count, sense=front_of.sense)


def read_folder(folder: Path) -> Exploration:
    """A finished study read back from its folder. Raises InputError where a file is missing."""
    from jld_core.scene.reading import load_scene

    for name in (NAME, "scene.json", "results.parquet", "summary.json"):
        if not (folder / name).exists():
            raise InputError(str(folder), f"{name} is missing", "a folder written by jld explore")
    scene = load_scene(folder / "scene.json")
    results = pd.read_parquet(folder / "results.parquet")
    front_of = scene.search.front
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return Exploration(
        scene=scene,
        assembly=build_assembly(scene),
        results=results,
        front=tables.front_table(results, front_of.count, front_of.sense),
        summary=summary,
        folder=folder,
        stop_reason=StopReason(summary["stop_reason"]),
    )


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    fresh = path.with_name(path.name + ".new")
    fresh.write_text(text, encoding="utf-8")
    os.replace(fresh, path)


__all__ = ["Exploration", "ExploreSettings", "Interrupted", "explore", "read_folder", "write_pictures"]
