"""Pictures of a finished search, drawn into its folder while time lasts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from jld_core import Deadline, LimitAnalysisResult
from jld_core.models import cost_estimate
from jld_core.refinement import crack_cells
from jld_core.scene import cracks as core_cracks
from jld_explore import Exploration
from jld_explore.report import folder, reading

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DRAWING: Final = 1.2  # longest time of one picture including imports, s; a picture is not begun with less time left

_DRAWING_FACE: Final = 4e-4  # further time for each face, s: pictures of 4 900 faces take 4.5 s together


def write_pictures(
    done: Exploration,
    ending: str = "png",
    out: Path | None = None,
    deadline: Deadline | None = None,
    *,
    busy: float = 1.0,
    fields: float = reading.FIELD_PICTURE,
    names: Sequence[str] = folder.PICTURES,
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
        for file_name, draw in _drawings(name, done, fields).items():
            bounds = name == "best" and isinstance(done.scene.cracks, core_cracks.FieldCracks)
            seconds = busy * _drawing_seconds(name, done) + (fields * len(done.assembly.by_case) if bounds else 0.0)
            if deadline is not None and deadline.remaining() < seconds:
                missing.append(f"{file_name}.{ending}")
                continue
            from jld_views.figures import save_figure

            path = (out or done.folder) / f"{file_name}.{ending}"
            save_figure(draw(), path)
            written.append(path)
    return written, missing


def _drawing_seconds(name: str, done: Exploration) -> float:
    """Return the longest processor time of one picture, s; the best layout is solved for its own."""
    solved, cracks = done.assembly, done.scene.cracks
    if name != "best" or isinstance(cracks, core_cracks.FieldCracks):
        return _DRAWING + _DRAWING_FACE * solved.faces
    if isinstance(cracks, core_cracks.CellCracks):
        solved = crack_cells(done.scene, solved, cracks.cell).fine
    return _DRAWING + _DRAWING_FACE * solved.faces + cost_estimate(solved).seconds


def _drawings(name: str, done: Exploration, fields: float) -> dict[str, Callable[[], Figure]]:
    """Return the functions that draw one of `PICTURES`, by file name; empty without data."""
    if name == "best":
        # With load cases "best" shows the governing case, and every case has a picture of its own.
        if isinstance(done.scene.cracks, core_cracks.FieldCracks):
            return {name: partial(_field_picture, done, fields)}
        best = _Best(done)
        cases = done.assembly.cases
        each = {f"best-{k}": partial(best.draw, case.name) for k, case in enumerate(cases, 1) if case.place is None}
        moving = {folder.PATH: best.draw_path} if any(case.place is not None for case in cases) else {}
        return {name: best.draw, **moving, **each}
    if name == "convergence" and reading.history_of(done.folder) is None:
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
        from jld_views import pictures as drawings

        return drawings.plot_best(self._found if case is None else self._found.cases[case])

    def draw_path(self) -> Figure:
        """Draw λ of the layout along the paths of moving loads."""
        from jld_views.moved_joints import figure_of_path, path_values

        return figure_of_path(self._found.assembly, path_values(self._found))


def _field_picture(done: Exploration, seconds: float) -> Figure:
    """Draw stress trajectories and cracks of the best layout under its governing load case."""
    from jld_views.field_figures import figure_of_fields

    return figure_of_fields(*done.field_result(seconds=seconds).governing_case)


def _drawn(name: str, done: Exploration) -> Figure:
    """Draw one of `PICTURES` other than the best layout."""
    from jld_views import pictures as drawings
    from jld_views.pictures import front_picture

    if name == "pareto":
        return front_picture(done)
    if name == "distribution":
        return drawings.plot_distribution(done.results)
    if name == "dry_frequency":
        return drawings.plot_dry_frequency(done.results, done.assembly)
    history = reading.history_of(done.folder)
    if history is None:
        raise ValueError(f"{done.folder} has no history, so its convergence cannot be drawn")
    return drawings.plot_convergence({str(done.summary.driver): history})
