"""Check results folders, and write tables and pictures into them."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from jld_core.deadline import Deadline
from jld_core.errors import InputError, ParameterError
from jld_core.files import require_folder, require_writable, write_text
from jld_core.layout import blocks_csv
from jld_core.limit import load_scale, number
from jld_core.limit.options import Status
from jld_core.limit.result import LimitAnalysisResult
from jld_core.models import cost_estimate
from jld_core.refinement import crack_cells
from jld_core.scene.cracks import CellCracks, FieldCracks, cracks_to_json
from jld_core.tolerances import GAP
from jld_explore.drivers.choice import what_would_prove
from jld_explore.drivers.field_exact import CONFLICTS_FILE
from jld_explore.evaluation.records import RECORDS_FILE, REFINED_FILE
from jld_explore.report import tables
from jld_explore.report.columns import columns, csv_of, front_rows, values_on, with_evidence
from jld_explore.report.reading import FIELD_PICTURE, Exploration, history_of
from jld_explore.report.tables import Summary, without_parquet, write_results
from jld_explore.search.state import StopReason, name_of
from jld_explore.search.study import Study
from jld_explore.space import registered

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


_DRAWING: Final = 1.2  # longest time of one picture including imports, s; a picture is not begun with less time left

_DRAWING_FACE: Final = 4e-4  # further time for each face, s: pictures of 4 900 faces take 4.5 s together

# pictures of a search, in the order in which they are drawn
PICTURES: Final = ("best", "pareto", "distribution", "dry_frequency", "convergence")

SHOWN: Final = PICTURES[:2]  # those that a search draws unasked

PATH: Final = "path"  # picture of λ along the paths of moving loads

# what would prove the result of a search with cracks beside the faces
BESIDE_FACES: Final = "--driver enumeration without a budget proves the best of these cracks, where it comes to its end"

# file names in a results folder that are reserved for the search
RESERVED: Final = frozenset(
    [
        *("scene.json", "summary.json", "columns.json", "results.parquet", "report.html", "results.csv", "pareto.csv"),
        *(
            "faces.csv",
            "blocks.csv",
            "convergence.csv",
            "experiments.csv",
            "reliability.csv",
            RECORDS_FILE,
            REFINED_FILE,
            CONFLICTS_FILE,
        ),
        *(f"{name}.png" for name in (*PICTURES, PATH)),
    ]
)


def check_folder(folder: Path, resume: bool) -> None:
    """Raise InputError unless a folder is writable, and new or empty, or holds a study to resume."""
    require_folder(folder)
    if not folder.exists() or not any(folder.iterdir()):
        return
    if not resume:
        raise InputError(
            str(folder), "the folder is not empty", "an empty or new folder, or `resume=True` to go on with it"
        )
    if not (folder / RECORDS_FILE).exists():
        raise InputError(
            str(folder), f"nothing to go on with: no {RECORDS_FILE} in it", "a folder written by jld explore"
        )


def check_certificate_file(path: Path, folder: Path) -> None:
    """Raise InputError if a certificate cannot be written there, or would replace a file of the search."""
    option, expected = "certificate", "a file in a folder that can be written into"
    place, results = Path(os.path.realpath(path)), Path(os.path.realpath(folder))
    if place == results or path.is_dir():
        raise ParameterError(option, f"{path} is a folder", "a file")
    if place.parent == results and place.name in RESERVED:
        raise ParameterError(option, f"the search writes {path} itself", "another name")
    try:
        require_writable(place)
    except OSError as error:
        raise ParameterError(option, f"{path} cannot be written ({error.strerror})", expected) from None


def write_tables(study: Study, reason: StopReason, deadline: Deadline | None = None) -> Exploration:
    """Write the tables of a finished study, but results and summary, which `save_tables` writes."""
    own, by_fields = study.settings.own_objective, isinstance(study.scene.cracks, FieldCracks)
    results = tables.results_table(
        study.table_records,
        study.assembly,
        study.space,
        study.driver.name,
        own_objective=own is not None,
        deadline=deadline,
        standing=study.standing,
        by_fields=by_fields,
    )
    real = study.assembly if study.space.void is None else study.space.void.real
    axes = study.scene.search.front.axes
    front = tables.front_table(results, axes)
    complete = reason is StopReason.EXHAUSTED and study.driver.exhaustive and not study.undecided
    found = tables.summary(results, study, reason, complete=complete)
    if study.assembly.has_low_values:
        found |= {"robust": True, "best_nominal": tables.nominal_of_best(results)}
    found["warnings"] = [*study.assembly.warnings, *study.assembly.notes, *_complaints(study), *_uncounted(results)]
    found["warnings"] += without_parquet(len(results))
    model = study.settings.model
    found["model"] = model.facts()
    if model.effective_area:
        # A proof holds for the effective areas of one fixed point and not for other fixed points.
        found |= {"proven": False, "bound": None, "gap": None}
    if own is not None:
        # Bounds on λ say nothing about another objective.
        found |= {"own_objective": name_of(own), "proven": False, "bound": None, "gap": None}
    of_study = study.facts(results)
    found |= study.driver.facts(results, complete) | of_study
    found["proven"] &= tables.is_ahead(results, found["bound"], max(GAP, model.gap), load_scale(study.assembly))
    sure = complete and bool(found["proven"])
    finished = study.driver.finished and not found.get("open_layouts")
    asked = tables.facts(results, study.scene.search, complete=complete, finished=finished)
    # A proof for the count under a required load factor is no proof for the front of λ.
    known = {**found, "proven": found["proven"] and not asked}
    every = front_rows(front, known, axes, complete=sure, aimed=study.driver.settings.get("aim") == "front")
    counts = [name for name, _ in axes]
    on_front = {str(value) for value in values_on(front, counts)}
    found["front"] = [row for row in every if str(row["count"]) in on_front]
    found["best_by_count"] = every
    found |= asked
    front = with_evidence(front, found, counts)
    if own is None:
        found["next"] = what_would_prove(study.space, model, found, whole=study.driver.exhaustive, finite=study.finite)
    if study.scene.cracks != "faces":
        found["next"] = of_study.get("next", BESIDE_FACES if found.get("next") else None)
    found |= {"cracks": cracks_to_json(study.scene.cracks), "uncut": None}
    found["by_fields"] = _bracket_of_best(results) if by_fields else None
    write_text(study.folder / "faces.csv", csv_of(tables.faces_table(real, study.space)))
    write_text(study.folder / "pareto.csv", csv_of(front))
    write_text(study.folder / tables.CONVERGENCE, csv_of(tables.convergence_table(study.table_records)))
    write_text(study.folder / "columns.json", json.dumps(columns(real), indent=1, ensure_ascii=False))
    done = Exploration(study.scene, real, results, front, Summary.of(found), study.folder, reason, model)
    if found["best_labelling"] is not None:
        write_text(study.folder / "blocks.csv", blocks_csv(done.layout()))
    if done.summary.stands_at_zero is not False:
        return done
    least = math.nan if by_fields else getattr(done.result(), "least_load_factor", math.nan)  # unknown by fields
    return replace(done, summary=Summary.of({**found, "least_load_factor": least if math.isfinite(least) else None}))


def save_tables(done: Exploration, saved: Exploration | None = None, *, csv: bool = False) -> Exploration:
    """Write results and summary of a search, except what `saved`, which is on disk, has too; return the search."""
    if saved is None or done.results is not saved.results:
        write_results(done.folder, done.results, csv=csv)
    if saved is None or done.summary is not saved.summary:
        write_text(done.folder / "summary.json", json.dumps(done.summary.to_json(), indent=1))
    return done


def _bracket_of_best(results: pd.DataFrame) -> list[float | None] | None:
    """Return the bounds on λ of the first ranked row, None where there is none."""
    ranked = results[results["status"] == str(Status.COLLAPSE)]
    ends = ranked[["bracket_lo", "bracket_hi"]].head(1).to_numpy(dtype=float).tolist()
    return [number(end) for end in ends[0]] if ends else None


def _complaints(study: Study) -> list[str]:
    """Return the problems of the record and of proofs in a study, one line each."""
    anew = f"{study.records.path.name} was empty: nothing had been finished, and the search began anew"
    left_out = (
        f"{study.undecided} layouts are left out: the search for an order whose stages stand stopped at its limit"
    )
    return [
        *([anew] if study.records.began_anew else []),
        *([left_out] if study.undecided else []),
        *study.records.withdrawn,
        *(one for one in study.driver.complaints if one not in study.records.withdrawn),
    ]


def _uncounted(results: pd.DataFrame) -> list[str]:
    """Return a warning for each count that is blank in some rows because time ran out."""
    missing = {count.name: int(results[count.name].isna().sum()) for count in registered()}
    told = "the time limit ended the counting; --resume with more time goes on with it"
    return [f"{name}: blank in {count} of {len(results)} layouts; {told}" for name, count in missing.items() if count]


def write_pictures(
    done: Exploration,
    ending: str = "png",
    out: Path | None = None,
    deadline: Deadline | None = None,
    *,
    busy: float = 1.0,
    fields: float = FIELD_PICTURE,
    names: Sequence[str] = PICTURES,
) -> tuple[list[Path], list[str]]:
    """Draw the pictures of a search: best layout, front, distributions and convergence.

    Parameters
    ----------
    done : Exploration
        The finished search.
    ending : str
        "png", "svg" or "pdf".
    out : Path, optional
        Default: the folder of the study.
    deadline : Deadline, optional
        Deadline.
    busy : float
        Factor by which other work prolongs drawing.
    fields : float
        Time, s, for bounds by fields of each load case.
    names : sequence of str
        Those of `PICTURES` to draw.

    Returns
    -------
    written : list of Path
        Files.
    missing : list of str
        Pictures omitted for lack of time.

    Raises
    ------
    InputError
        If the ending is unknown.
    """
    written, missing = [], []
    for name in names:
        if name == "best" and done.summary.best_labelling is None:
            continue
        for own, draw in _drawings(name, done, fields).items():
            bounds = name == "best" and isinstance(done.scene.cracks, FieldCracks)
            seconds = busy * _drawing_seconds(name, done) + (fields * len(done.assembly.by_case) if bounds else 0.0)
            if deadline is not None and deadline.remaining() < seconds:
                missing.append(f"{own}.{ending}")
                continue
            from jld_core.views.figures import save_figure

            path = (out or done.folder) / f"{own}.{ending}"
            save_figure(draw(), path)
            written.append(path)
    return written, missing


def _drawing_seconds(name: str, done: Exploration) -> float:
    """Return the longest processor time of one picture, s; the best layout is solved for its own."""
    solved, cracks = done.assembly, done.scene.cracks
    if name != "best" or isinstance(cracks, FieldCracks):
        return _DRAWING + _DRAWING_FACE * solved.faces
    if isinstance(cracks, CellCracks):
        solved = crack_cells(done.scene, solved, cracks.cell).fine
    return _DRAWING + _DRAWING_FACE * solved.faces + cost_estimate(solved).seconds


def _drawings(name: str, done: Exploration, fields: float) -> dict[str, Callable[[], Figure]]:
    """Return the functions that draw one of `PICTURES`, by file name; empty without data."""
    if name == "best":
        # With load cases "best" shows the governing case, and every case has a picture of its own.
        if isinstance(done.scene.cracks, FieldCracks):
            return {name: partial(_field_picture, done, fields)}
        best = _Best(done)
        cases = done.assembly.cases
        each = {f"best-{k}": partial(best.draw, case.name) for k, case in enumerate(cases, 1) if case.place is None}
        moving = {PATH: best.draw_path} if any(case.place is not None for case in cases) else {}
        return {name: best.draw, **moving, **each}
    if name == "convergence" and history_of(done.folder) is None:
        return {}
    return {name: partial(_drawn, name, done)}


class _Best:
    """Pictures of the best layout, which is solved once for all of them."""

    def __init__(self, done: Exploration) -> None:
        self._done = done

    @cached_property
    def _found(self) -> LimitAnalysisResult:
        return self._done.result()

    def draw(self, case: str | None = None) -> Figure:
        """Draw the layout under one load case, None: the governing one."""
        from jld_explore.report import pictures as drawings

        return drawings.plot_best(self._found if case is None else self._found.cases[case])

    def draw_path(self) -> Figure:
        """Draw λ of the layout along the paths of moving loads."""
        from jld_core.views.moved_joints import figure_of_path, path_values

        return figure_of_path(self._found.assembly, path_values(self._found))


def _field_picture(done: Exploration, seconds: float) -> Figure:
    """Draw stress trajectories and cracks of the best layout under its governing load case."""
    from jld_core.views.field_figures import figure_of_fields

    return figure_of_fields(*done.field_result(seconds=seconds).governing_case)


def _drawn(name: str, done: Exploration) -> Figure:
    """Draw one of `PICTURES` other than the best layout."""
    from jld_explore.report import pictures as drawings
    from jld_explore.report.pictures import front_picture

    if name == "pareto":
        return front_picture(done)
    if name == "distribution":
        return drawings.plot_distribution(done.results)
    if name == "dry_frequency":
        return drawings.plot_dry_frequency(done.results, done.assembly)
    history = history_of(done.folder)
    if history is None:
        raise ValueError(f"{done.folder} has no history, so its convergence cannot be drawn")
    return drawings.plot_convergence({str(done.summary.driver): history})
