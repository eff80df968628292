"""Read the folder of a study; every file is validated before use."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from jld_core.assembly import Assembly
from jld_core.build import build_robust
from jld_core.build.assemble import build_assembly
from jld_core.errors import InputError, ParameterError
from jld_core.files import json_of
from jld_core.layout import Layout
from jld_core.limit.options import SolveOptions, Status
from jld_core.limit.result import LimitAnalysisResult
from jld_core.models import solve_by_elements, solve_by_fields
from jld_core.models.by_fields import FieldResult
from jld_core.notebook_repr import NotebookRepr
from jld_core.parameters import require_kind, typed
from jld_core.scene.cracks import FieldCracks, cracks_in_short
from jld_core.scene.reading import load_scene
from jld_core.scene.schema import Scene
from jld_core.solvers import SOLVERS
from jld_explore.evaluation.records import RECORDS_FILE, recorded
from jld_explore.report import tables
from jld_explore.report.columns import with_evidence
from jld_explore.report.tables import Summary, read_results, results_path
from jld_explore.search.state import StopReason, versions
from jld_explore.space import cut
from jld_explore.space.labelling import is_labelling

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


FIELD_PICTURE: Final = 2.0  # default time for bounds by fields that are drawn, for each load case, s


@dataclass(frozen=True)
class Exploration(NotebookRepr):
    """Finished study with its tables, summary and folder.

    Attributes
    ----------
    scene : Scene
        The scene.
    assembly : Assembly
        Structure without the sink of void cells.
    results : DataFrame
        One row per class, ranked, as in results.csv.
    front : DataFrame
        Rows of `results` on the front, with a column `evidence`.
    summary : Summary
        Best layout, proof and course of the search.
    folder : Path
        Results folder.
    stop_reason : StopReason
        Why the search ended.
    model : SolveOptions
        Model of the search.
    """

    shown_by: ClassVar[str] = "jld_views.page_of_study:ExplorationView"

    scene: Scene
    assembly: Assembly
    results: pd.DataFrame
    front: pd.DataFrame
    summary: Summary
    folder: Path
    stop_reason: StopReason
    model: SolveOptions = field(default_factory=SolveOptions)

    def __repr__(self) -> str:
        best, proven = self.summary.best, ", proven" if self.summary.proven else ""
        outcome = (
            "none ranked"
            if best is None
            else f"best λ = {best:.9g}{proven}, cracks {cracks_in_short(self.scene.cracks)}"
        )
        if best is not None and self.scene.cracks == "faces" and self.summary.by_fields is not None:
            low, high = ("none" if end is None else f"{end:.4g}" for end in self.summary.by_fields)
            outcome += f", [{low}, {high}] by fields"
        outcome += ", falls without live load" if self.summary.stands_at_zero is False else ""
        return f"Exploration({self.scene.name!r}, {len(self.results)} classes, {outcome}, in {self.folder})"

    def plot(self) -> Figure:
        """Draw λ against the counts of the front, with the layouts on the front.

        Returns
        -------
        matplotlib.figure.Figure
            Save it by `savefig`.
        """
        figure: Figure = self.drawn()
        return figure

    def layout(self, rank: int | None = None) -> Layout:
        """Return one layout as blocks.

        Parameters
        ----------
        rank : int, optional
            Number of the row of the results, from 1; rows that tie keep their order, rows without a rank follow.
            Default:
            the strongest layout.

        Returns
        -------
        Layout

        Raises
        ------
        InputError
            If there is no such row.
        """
        return Layout(self.scene, *cut(self.assembly, str(self.row(rank)["labelling"])))

    def result(self, rank: int | None = None) -> LimitAnalysisResult:
        """Return the limit analysis of one layout, solved by the model of the search.

        Parameters
        ----------
        rank : int, optional
            As in `layout`.

        Returns
        -------
        LimitAnalysisResult
            On finer cells where the scene's blocks crack by cells.

        Raises
        ------
        InputError
            If there is no such row, or blocks crack by fields.
        """
        layout = self.layout(rank)
        return solve_by_elements(layout.assembly, layout.labels, self.model, "a picture of forces")

    def field_result(self, rank: int | None = None, seconds: float = FIELD_PICTURE) -> FieldResult:
        """Return both bounds by fields on λ of one layout, with stresses and velocities.

        Parameters
        ----------
        rank : int, optional
            As in `layout`.
        seconds : float
            Time for each load case, s; one mesh is always solved.

        Returns
        -------
        FieldResult
            Refined to the gap of the scene, or to 0.05.

        Raises
        ------
        InputError
            If there is no such row, or fields do not apply to the scene.
        """
        layout, cracks = self.layout(rank), self.scene.cracks
        gap = cracks.gap if isinstance(cracks, FieldCracks) else FieldCracks(kind="fields").gap
        return solve_by_fields(layout.assembly, layout.labels, gap=gap, seconds=seconds)

    def blocks(self, rank: int | None = None) -> pd.DataFrame:
        """Return the blocks of one layout, by `rank` as in `layout`, with the columns of blocks.csv."""
        import pandas as pd  # slow to import and needed for tables only

        return pd.DataFrame(self.layout(rank).table())

    def row(self, rank: int | None = None) -> pd.Series[Any]:
        """Return one row of the results.

        Parameters
        ----------
        rank : int, optional
            As in `layout`.

        Returns
        -------
        Series
            Values by column of results.csv.

        Raises
        ------
        InputError
            If there is no such row, or no layout has a load factor.
        """
        ranked = int(np.count_nonzero(self.results["status"] == str(Status.COLLAPSE)))
        if rank is None and not ranked:
            problem = f"no layout of {self.folder} has a load factor to be ranked by"
            raise ParameterError("rank", problem, f"a row of results.csv, 1 to {len(self.results)}")
        number = 1 if rank is None else rank
        require_kind("rank", number, int)
        if not 1 <= number <= len(self.results):
            expected = (
                f"1 to {len(self.results)}, the rows of results.csv" if len(self.results) else "a search with rows"
            )
            raise ParameterError("rank", f"{self.folder} has no layout of rank {number}", expected)
        return self.results.iloc[number - 1]


# remedy in error messages about damaged files
LEFT: Final = "a file as jld explore left it, or jld explore --resume to write it again"
_NUMBERS: Final = ("multiplicity", "load_factor", "bracket_lo", "bracket_hi", "seconds")


class _Point(BaseModel):
    """Fields of a point of the front that other code relies on."""

    model_config = ConfigDict(extra="allow")
    count: Any
    load_factor: float | None
    bound: float | None
    proven: bool


class _Summary(BaseModel):
    """Fields of summary.json that other code relies on."""

    model_config = ConfigDict(extra="allow")
    best: float | None
    best_labelling: str | None
    unbounded: bool
    proven: bool
    bound: float | None
    gap: float | None
    stop_reason: StopReason
    evaluated: int
    labellings: int
    counts_by_status: dict[Status, int]
    seconds: float
    rate: float | None
    driver: str
    model: dict[str, Any]
    versions: dict[str, str] = {}
    warnings: list[str] = []
    front: list[_Point] = []


@typed
def read_folder(folder: str | Path) -> Exploration:
    """Read a finished study from its folder.

    Parameters
    ----------
    folder : str or Path
        Results folder.

    Returns
    -------
    Exploration

    Raises
    ------
    InputError
        If a file is missing, damaged or of another scene.
    """
    if not isinstance(folder, str | Path):
        raise ParameterError("folder", f"{type(folder).__name__!r} is no folder", "the name of a results folder")
    folder = Path(folder)
    table = results_path(folder)
    for name in (RECORDS_FILE, "scene.json", table.name, "summary.json"):
        if not (folder / name).exists():
            if (folder / RECORDS_FILE).exists() and (folder / "scene.json").exists():
                resume = f"jld explore {folder / 'scene.json'} --out {folder} --resume, with its first options, ends it"
                problem = f"{name} is missing: the search was killed, or is still running"
                raise InputError(str(folder), problem, f"one that ended; {resume}")
            raise InputError(str(folder), f"{name} is missing", "a folder written by jld explore")
    scene = load_scene(folder / "scene.json")
    record = recorded(folder / RECORDS_FILE)
    # another version of jld may find scenes by another digest
    if record.get("versions") == versions() and record.get("scene") != scene.fingerprint:
        remedy = "the file as jld explore wrote it, or a new folder for another scene"
        raise InputError(str(folder / "scene.json"), "it is not the scene of the search in this folder", remedy)
    try:
        assembly = build_assembly(scene)
    except InputError as error:
        raise error.within(str(folder / "scene.json")) from None
    summary = _summary(folder / "summary.json", assembly.faces)
    if summary.get("robust"):
        assembly = build_robust(scene)
    axes = scene.search.front.axes
    counts = [name for name, _ in axes]
    results = _results(table, assembly, counts)
    return Exploration(
        scene=scene,
        assembly=assembly,
        results=results,
        front=with_evidence(tables.front_table(results, axes), summary, counts),
        summary=Summary.of(summary),
        folder=folder,
        stop_reason=StopReason(summary["stop_reason"]),
        model=_model(folder / "summary.json", summary["model"]),
    )


def history_of(folder: Path) -> pd.DataFrame | None:
    """Return the columns solves, seconds and best of convergence.csv, None without the file."""
    import pandas as pd  # here and below: slow to import and needed for tables only

    path = folder / tables.CONVERGENCE
    if not path.exists():
        return None
    try:
        return pd.read_csv(path)[["solves", "seconds", "best"]].astype(float)
    except (KeyError, ValueError) as error:  # pandas raises ValueError for text that is no table
        raise _damaged(path, str(error)) from None


def _summary(path: Path, faces: int) -> dict[str, Any]:
    """Read and validate summary.json; raise InputError if it is damaged or of another scene."""
    try:
        content = json_of(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict):
            raise _damaged(path, "it holds no JSON object")
        _Summary.model_validate(content)
    except InputError:
        raise
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{path}: {key}" if key else str(path), str(first["msg"]).lower(), LEFT) from None
    except ValueError as error:
        raise _damaged(path, str(error)) from None
    if content["best_labelling"] is not None and not is_labelling(content["best_labelling"], faces):
        raise InputError(f"{path}: best_labelling", "it is of another scene", f"{faces} letters d, i or v")
    facts: dict[str, Any] = content
    return facts


def _results(path: Path, assembly: Assembly, counts: list[str]) -> pd.DataFrame:
    """Read and validate the table of results; raise InputError if it is damaged."""
    import pandas as pd

    try:
        table = read_results(path)
    except (OSError, TypeError, ValueError) as error:
        raise _damaged(path, str(error)) from None
    for name in ("rank", "labelling", "status", "settled", *_NUMBERS, *counts):
        if name not in table:
            raise InputError(str(path), f"it has no column {name}", LEFT)
    for name in (*_NUMBERS, *counts):
        if not pd.api.types.is_numeric_dtype(table[name]):
            raise InputError(str(path), f"column {name} holds no numbers", LEFT)
    if not table["status"].isin([str(status) for status in Status]).all():
        raise InputError(str(path), "column status holds an unknown status", LEFT)
    faces = assembly.faces
    wrong = np.flatnonzero([not is_labelling(text, faces) for text in table["labelling"]])
    if len(wrong):
        problem = f"the labelling of row {wrong[0] + 1} is of another scene"
        raise InputError(str(path), problem, f"{faces} letters d, i or v, one for each face of scene.json")
    return table.reset_index(drop=True)


def _model(path: Path, facts: dict[str, Any]) -> SolveOptions:
    """Return the model of a summary, with the default solver in place of a custom one."""
    options = dict(facts)
    if options.get("solver") not in SOLVERS:
        options["solver"] = "auto"
    if options.get("inner_bending") == "paper":  # folders of version 0.2
        options["inner_bending"] = "uncoupled"
    try:
        return SolveOptions(**options)
    except TypeError as error:
        raise InputError(f"{path}: model", str(error).partition("() ")[2] or str(error), LEFT) from None
    except InputError as error:
        raise InputError(f"{path}: model", f"{error.where}: {error.problem}", error.expected) from None


def _damaged(path: Path, how: str) -> InputError:
    return InputError(str(path), f"it is damaged ({how.splitlines()[0]})", LEFT)
