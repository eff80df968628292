"""Check results folders, and write tables and pictures into them."""

from __future__ import annotations

import json
import math
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from jld_core.deadline import Deadline
from jld_core.errors import InputError, ParameterError
from jld_core.files import require_folder, require_writable, write_text
from jld_core.layout import blocks_csv
from jld_core.limit import load_scale, number
from jld_core.limit.options import Status
from jld_core.scene.cracks import FieldCracks, cracks_to_json
from jld_core.tolerances import GAP
from jld_explore.drivers.choice import what_would_prove
from jld_explore.drivers.field_exact import CONFLICTS_FILE
from jld_explore.evaluation.records import RECORDS_FILE, REFINED_FILE
from jld_explore.report import tables
from jld_explore.report.columns import columns, csv_of, front_rows, values_on, with_evidence
from jld_explore.report.reading import Exploration
from jld_explore.report.tables import Summary, without_parquet, write_results
from jld_explore.search.state import StopReason, name_of
from jld_explore.search.study import Study
from jld_explore.space import registered

if TYPE_CHECKING:
    import pandas as pd


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
    target, results = Path(os.path.realpath(path)), Path(os.path.realpath(folder))
    if target == results or path.is_dir():
        raise ParameterError(option, f"{path} is a folder", "a file")
    if target.parent == results and target.name in RESERVED:
        raise ParameterError(option, f"the search writes {path} itself", "another name")
    try:
        require_writable(target)
    except OSError as error:
        raise ParameterError(option, f"{path} cannot be written ({error.strerror})", expected) from None


def write_tables(study: Study, reason: StopReason, deadline: Deadline | None = None) -> Exploration:
    """Write the tables of a finished study, but results and summary, which `save_tables` writes."""
    by_fields = isinstance(study.scene.cracks, FieldCracks)
    results = tables.results_table(
        study.table_records,
        study.assembly,
        study.space,
        study.driver.name,
        own_objective=study.settings.own_objective is not None,
        deadline=deadline,
        standing=study.standing,
        by_fields=by_fields,
    )
    real = study.assembly if study.space.void is None else study.space.void.real
    front = tables.front_table(results, study.scene.search.front.axes)
    facts = _summary_facts(study, reason, results, front)
    front = with_evidence(front, facts, [name for name, _ in study.scene.search.front.axes])
    write_text(study.folder / "faces.csv", csv_of(tables.faces_table(real, study.space)))
    write_text(study.folder / "pareto.csv", csv_of(front))
    write_text(study.folder / tables.CONVERGENCE, csv_of(tables.convergence_table(study.table_records)))
    write_text(study.folder / "columns.json", json.dumps(columns(real), indent=1, ensure_ascii=False))
    model = study.settings.model
    exploration = Exploration(study.scene, real, results, front, Summary.of(facts), study.folder, reason, model)
    if facts["best_labelling"] is not None:
        write_text(study.folder / "blocks.csv", blocks_csv(exploration.layout()))
    if exploration.summary.stands_at_zero is not False:
        return exploration
    least = math.nan if by_fields else getattr(exploration.result(), "least_load_factor", math.nan)  # unknown by fields
    facts["least_load_factor"] = least if math.isfinite(least) else None
    return replace(exploration, summary=Summary.of(facts))


def _summary_facts(study: Study, reason: StopReason, results: pd.DataFrame, front: pd.DataFrame) -> dict[str, Any]:
    """Return the entries of summary.json, all but `least_load_factor`."""
    objective, model, axes = study.settings.own_objective, study.settings.model, study.scene.search.front.axes
    complete = reason is StopReason.EXHAUSTED and not study.undecided
    facts = tables.summary(results, study, reason, complete=complete)
    if study.assembly.has_low_values:
        facts |= {"robust": True, "best_nominal": tables.nominal_of_best(results)}
    facts["warnings"] = [*study.assembly.warnings, *study.assembly.notes, *_complaints(study), *_blank_counts(results)]
    facts["warnings"] += without_parquet(len(results))
    facts["model"] = model.facts()
    if model.effective_area:
        # A proof holds for the effective areas of one fixed point and not for other fixed points.
        facts |= {"proven": False, "bound": None, "gap": None}
    if objective is not None:
        # Bounds on λ say nothing about another objective.
        facts |= {"own_objective": name_of(objective), "proven": False, "bound": None, "gap": None}
    of_study = study.facts(results)
    facts |= study.driver.facts(results, complete) | of_study
    facts["proven"] &= tables.is_ahead(results, facts["bound"], max(GAP, model.gap), load_scale(study.assembly))
    front_proven = complete and bool(facts["proven"])
    finished = study.driver.finished and not facts.get("open_layouts")
    requirement = tables.requirement_entries(results, study.scene.search, complete=complete, finished=finished)
    # A proof for the count under a required load factor is no proof for the front of λ.
    of_front = {**facts, "proven": facts["proven"] and not requirement}
    aimed = study.driver.settings.get("aim") == "front"
    best_by_count = front_rows(front, of_front, axes, complete=front_proven, aimed=aimed)
    on_front = {str(value) for value in values_on(front, [name for name, _ in axes])}
    facts["front"] = [row for row in best_by_count if str(row["count"]) in on_front]
    facts["best_by_count"] = best_by_count
    facts |= requirement
    if objective is None:
        facts["next"] = what_would_prove(study.space, model, facts, whole=study.driver.exhaustive, finite=study.finite)
    if study.scene.cracks != "faces":
        facts["next"] = of_study.get("next", BESIDE_FACES if facts.get("next") else None)
    facts |= {"cracks": cracks_to_json(study.scene.cracks), "uncut": None}
    facts["by_fields"] = _bracket_of_best(results) if isinstance(study.scene.cracks, FieldCracks) else None
    return facts


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
    """Return the sentences of warning about a finished search."""
    anew = f"{study.records.path.name} was empty: nothing had been finished, and the search began anew"
    left_out = (
        f"{study.undecided} layouts are left out: the search for an order whose stages stand stopped at its limit"
    )
    return [
        *([anew] if study.records.began_anew else []),
        *([left_out] if study.undecided else []),
        *study.records.withdrawn,
        *(complaint for complaint in study.driver.complaints if complaint not in study.records.withdrawn),
    ]


def _blank_counts(results: pd.DataFrame) -> list[str]:
    """Return a warning for each count that is blank in some rows because time ran out."""
    missing = {count.name: int(results[count.name].isna().sum()) for count in registered()}
    text = "the time limit ended the counting; --resume with more time goes on with it"
    return [f"{name}: blank in {count} of {len(results)} layouts; {text}" for name, count in missing.items() if count]
