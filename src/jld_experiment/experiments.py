"""Run virtual experiments on the best layouts of a search, or search by experiment."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core import Assembly, Deadline, InputError, LimitAnalysisResult, Scene, SolveOptions, Status, files
from jld_core.limit import number
from jld_explore import Evaluation, Exploration, ExploreSettings, SearchSpace, Step, StepContext, with_entries
from jld_explore.drivers import make_driver
from jld_explore.evaluation import Evaluator, EvaluatorSettings, Pool
from jld_explore.report import csv_of
from jld_explore.space import from_string, to_string

if TYPE_CHECKING:  # every search loads this module, and few draw or tabulate an experiment
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from jld_experiment.experiment import Curve

FILE: Final = "experiments.csv"  # table of experiments in a results folder
COLUMNS: Final = ("labelling", "load_factor", "experiment", "status", "stands", "rate_error", "first_crack", "seconds")
DEFAULT: Final = 500  # default number of experiments of a search by experiment

# layouts in a row, none with λ above the strongest experiment, after which a search by experiment ends
_MOST_IDLE: Final = 500

# assumption of `none_better` where some layouts were not tested, or ended uncertified
ASSUMPTION: Final = "no layout without a certified experiment carries more than its λ"

PORTION: Final = 16  # labellings requested from the driver at a time


@dataclass
class Experiments:
    """Virtual experiments on layouts of one assembly, each run once and kept in `experiments.csv`."""

    assembly: Assembly
    folder: Path  # results folder
    jobs: int = 1  # number of processes
    deadline: Deadline = field(default_factory=Deadline)  # time after which no experiment is begun
    # results by the text of the labelling (letters "d" and "i", one per face)
    rows: dict[str, dict[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Read the experiments on disk; raise InputError if the file is damaged."""
        self.pool = Pool(self.jobs, cluster=True)
        path = self.folder / FILE
        if path.exists():
            try:
                import pandas as pd  # local imports here and below: every search loads this module

                table = pd.read_csv(path, dtype={"labelling": str})[list(COLUMNS)]
            except (KeyError, ValueError) as error:
                raise InputError(
                    str(path), f"it is damaged ({str(error).splitlines()[0]})", "a file as jld explore left it, or none"
                ) from None
            self.rows = {str(row["labelling"]): {str(k): v for k, v in row.items()} for row in table.to_dict("records")}

    @property
    def is_late(self) -> bool:
        return self.deadline.passed()

    def run(self, layouts: list[tuple[str, float]]) -> None:
        """Run experiments on layouts that are not on disk yet, until the deadline passes."""
        fresh = [(name, value) for name, value in layouts if name not in self.rows]
        for part in _portions(fresh, self.jobs):
            if self.is_late:
                return
            rows = self.pool.run(one_experiment, [(self.assembly, name, value) for name, value in part])
            self.rows |= {row["labelling"]: row for row in rows}
            files.write_text(self.folder / FILE, csv_of(self.table()))

    def table(self) -> pd.DataFrame:
        import pandas as pd

        table = pd.DataFrame(list(self.rows.values()), columns=list(COLUMNS))
        return table.sort_values(["experiment", "labelling"], ascending=[False, True]).reset_index(drop=True)

    @property
    def best(self) -> float:
        """Largest load factor of an experiment that ended in collapse; −inf for none."""
        return max((row["experiment"] for row in self.rows.values() if row["status"] == "collapse"), default=-np.inf)


def _portions(rows: list[tuple[str, float]], size: int) -> Iterator[list[tuple[str, float]]]:
    """Yield consecutive slices of a list of (labelling, λ), each with at most `size` entries."""
    for start in range(0, len(rows), size):
        yield rows[start : start + size]


def one_experiment(assembly: Assembly, name: str, load_factor: float) -> dict[str, Any]:
    """Run the experiment on a layout; return its row of the table."""
    # A layout that does not stand under its dead loads carries 0.
    from jld_experiment import run_experiment

    start = time.perf_counter()
    curve = run_experiment(assembly, from_string(name))
    return {
        "labelling": name,
        "load_factor": load_factor,
        "experiment": curve.collapse_load if curve.stands else 0.0,
        "status": status_of(curve, load_factor),
        "stands": curve.stands,
        "rate_error": curve.rate_error,
        "first_crack": curve.first_crack,
        "seconds": time.perf_counter() - start,
    }


def best_by_load_factor(exploration: Exploration, count: int) -> list[tuple[str, float]]:
    """List text and associative λ of at most `count` collapsing layouts, in order of the results."""
    ranked = exploration.results[exploration.results["status"] == str(Status.COLLAPSE)].head(count)
    return [(str(a), float(b)) for a, b in zip(ranked["labelling"], ranked["load_factor_associative"], strict=True)]


def search_by_experiment(
    experiments: Experiments, exploration: Exploration, space: SearchSpace, model: SolveOptions, budget: int, seed: int
) -> None:
    """Search by experiment with the genetic driver, starting from the best layouts by λ."""
    # the initial layouts use a third of `budget`, which limits the number of all experiments
    seeds = best_by_load_factor(exploration, max(2, budget // 3))
    experiments.run(seeds)
    driver = make_driver("genetic", space, seed, aim="best")
    evaluator = Evaluator(experiments.assembly, EvaluatorSettings(model=model))
    tested = [name for name, _ in seeds if name in experiments.rows]
    if tested:
        driver.tell(np.array([from_string(name) for name in tested]), [_measured(experiments, name) for name in tested])
    idle = 0
    while len(experiments.rows) < budget and not experiments.is_late and idle < _MOST_IDLE:
        labellings = driver.ask(PORTION)
        if not len(labellings):
            return
        evaluations = evaluator.evaluate_all(labellings)
        names = [to_string(labels) for labels in labellings]
        before = len(experiments.rows)
        # A new layout is tested only if its λ exceeds the largest load carried so far: `ASSUMPTION`. λ bounds every
        # quasi-static experiment from above unless an inner face bears more bending than its kern, as default
        # sub-contacts can.
        stronger = [
            (name, e.load_factor)
            for name, e in zip(names, evaluations, strict=True)
            if e.status is Status.COLLAPSE and e.load_factor > experiments.best
        ]
        experiments.run(stronger[: budget - len(experiments.rows)])
        idle = 0 if len(experiments.rows) > before else idle + len(names)
        driver.tell(labellings, _for_driver(experiments, names, evaluations))


def _for_driver(experiments: Experiments, names: list[str], evaluations: list[Evaluation]) -> list[Evaluation]:
    """Return the evaluations that the driver receives: measured ones, else half of λ."""
    return [
        _measured(experiments, name) if name in experiments.rows else _estimated(evaluation)
        for name, evaluation in zip(names, evaluations, strict=True)
    ]


def _measured(experiments: Experiments, name: str) -> Evaluation:
    """Return an evaluation whose λ is the load carried in an experiment."""
    row = experiments.rows[name]
    status = Status.COLLAPSE if row["stands"] and np.isfinite(row["experiment"]) else Status.UNSTABLE
    return Evaluation(status, np.nan, float(row["load_factor"]), float(row["experiment"]))


def _estimated(evaluation: Evaluation) -> Evaluation:
    """Return an evaluation with half of the associative λ, about what brittle faces carry, if it collapses."""
    if evaluation.status is not Status.COLLAPSE:
        return evaluation
    return Evaluation(Status.COLLAPSE, evaluation.low, evaluation.high, 0.5 * evaluation.associative)


class ExperimentStep(Step):
    """Virtual experiments on the best layouts of a search, or a search by experiment."""

    name = "experiment"

    def wanted(self, settings: ExploreSettings) -> bool:
        return bool(settings.experiment or settings.by_experiment)

    def refuse(self, scene: Scene, assembly: Assembly, settings: ExploreSettings) -> None:
        from jld_experiment import require_one_load

        require_one_load(assembly)

    def entries(self, done: Exploration, context: StepContext) -> Mapping[str, Any]:
        entries: dict[str, Any] = self.run(done, context).summary.facts[self.name]
        return entries

    def run(self, done: Exploration, context: StepContext) -> Exploration:
        settings = context.settings
        experiments = Experiments(done.assembly, done.folder, settings.jobs, context.deadline)
        count = settings.experiment or DEFAULT
        with experiments.pool:
            if settings.by_experiment:
                search_by_experiment(experiments, done, context.space, settings.model, count, settings.seed)
            else:
                experiments.run(best_by_load_factor(done, count))
        return with_experiments(done, experiments, settings.by_experiment)


def with_experiments(exploration: Exploration, experiments: Experiments, objective: bool) -> Exploration:
    """Return the study with a column `experiment`, NaN where none was made, and facts in its summary."""
    # `none_better`: no layout without a certified experiment has a larger λ than the most carried, and none with one
    # carried over ACCURACY more than its λ
    # Nothing is written. Layouts without an experiment have NaN.
    rows = experiments.rows
    values = [rows[name]["experiment"] if name in rows else np.nan for name in exploration.results["labelling"]]
    table = experiments.table()
    ranked = table[table["status"] == "collapse"]
    # A layout without λ has no upper bound on its experiment.
    unknown = {"locked", "uncertified", "failed"} & set(exploration.summary.counts_by_status)
    complete = exploration.summary.stop_reason == "exhausted" and len(ranked) > 0 and not unknown
    decided = table[~table["status"].isin(["uncertified", "locked"])]["labelling"]
    untested = exploration.results[~exploration.results["labelling"].isin(decided)]["load_factor_associative"]
    bounded = ranked[ranked["load_factor"] > 0.0]
    most = float((bounded["experiment"] / bounded["load_factor"]).max()) if len(bounded) else None
    contradicted = False
    if most is not None and len(untested):  # Without untested layouts nothing is assumed that could be contradicted.
        from jld_experiment.settings import ACCURACY

        contradicted = most > 1.0 + ACCURACY
    none_better = bool(complete and not contradicted and not (untested > experiments.best).any())
    facts = {
        "runs": len(table),
        "best": None if ranked.empty else float(ranked["experiment"].iloc[0]),
        "best_labelling": None if ranked.empty else str(ranked["labelling"].iloc[0]),
        "not_standing": int((~table["stands"].astype(bool)).sum()),
        "uncertified": int((table["status"] == "uncertified").sum()),
        "most_over_load_factor": most,
        "none_better": none_better,
        "none_better_assumes": ASSUMPTION if none_better and len(untested) else None,
        "searched": objective,
    }
    return with_entries(exploration, {"experiment": facts}, {"experiment": values})


PUSHED, FASTER, LIMIT = "#1B1B1B", "#D55E00", "#0072B2"


def status_of(curve: Curve, load_factor: float) -> str:
    """Return collapse, uncertified, locked, falls or creeps; load_factor: λ, NaN where limit analysis finds no end."""
    if not curve.stands:
        return str(curve.standing)
    if curve.rising and not np.isfinite(load_factor):  # a push beyond a proven λ says nothing
        return "locked"
    return "collapse" if curve.rates_agree else "uncertified"


def summary(curve: Curve, load_factor: float) -> dict[str, Any]:
    """Return the data of `jld experiment --json`: status, loads, their accuracy and settings."""
    # Numbers that are not finite are None.
    load = curve.collapse_load
    joints, settings = curve.joints, curve.settings
    return {
        "name": curve.assembly.name,
        "status": status_of(curve, load_factor),
        "collapse_load": number(load),
        "load_factor": number(load_factor),
        "ratio": number(load / load_factor if load_factor > 0.0 else np.nan),
        "stands": curve.stands,
        "rate_error": number(curve.rate_error) if curve.stands and np.isfinite(load) else None,
        "accuracy": number(curve.accuracy) if curve.stands and np.isfinite(load) else None,
        "first_crack": number(curve.first_crack),
        "unbalanced": number(float(curve.unbalanced[curve.collapse])) if len(curve.unbalanced) else None,
        "cracked_faces": int(np.count_nonzero(curve.cracked > 0.0)),
        "energy": None if curve.energy is None else asdict(curve.energy),
        "energy_error": number(float(curve.energy_error.max())) if len(curve.energy_error) else None,
        "inner": joints.inner,
        "dilation": joints.dilation,
        "inner_ratio": joints.inner_ratio,
        "residual_friction": joints.residual_friction,
        "scheme": settings.scheme,
        "segments": settings.segments,
        "damping_scheme": settings.damping_scheme,
        "moving": settings.moving,
        "periods": round(curve.periods),
    }


def table(curve: Curve) -> pd.DataFrame:
    """Return both pushes as a table with one row per record."""
    # Columns are push (slow, fast), distance (live·u), elastic, load_factor, unbalanced, broken and energy_error.
    # `elastic` is the distance over that of the elastic structure at the collapse load. The columns unbalanced, broken
    # and energy_error are NaN for the fast push. The table is empty if the structure does not stand.
    import pandas as pd

    slow = pd.DataFrame(
        {
            "push": "slow",
            "distance": curve.distance,
            "load_factor": curve.load_factor,
            "unbalanced": curve.unbalanced,
            "broken": curve.broken,
            "energy_error": curve.energy_error,
        }
    )
    fast = pd.DataFrame({"push": "fast", "distance": curve.faster[:, 0], "load_factor": curve.faster[:, 1]})
    both = pd.concat([slow, fast], ignore_index=True) if len(slow) else slow
    both.insert(2, "elastic", both["distance"] / (curve.reach * curve.collapse_load))
    return both


def end_state(curve: Curve, result: LimitAnalysisResult) -> LimitAnalysisResult:
    """Return a result whose mechanism is the displacement at the end of a push."""
    # scaled to live power 1, or to a largest entry of 1 where it does not stand or the loads do not advance
    moved = curve.at_end
    power = float((curve.assembly.live * moved).sum())
    scale = power if curve.stands and power > 0.0 else float(np.abs(moved).max()) or 1.0
    return replace(result, mechanism=moved / scale)


def draw_curve(
    ax: Axes, curve: Curve, load_factor: float, band: tuple[float, float] | None = None, proven: float | None = None
) -> None:
    """Plot λ over displacement of an experiment, with λ of limit analysis as a line."""
    # The displacement is relative to the elastic one at collapse.
    unit = curve.reach * (curve.collapse_load or np.nan)
    if band is not None:
        low, high = band
        name = f"zero dilation: {low:.5g}" + (f" – {high:.5g}" if high > low * (1.0 + 1e-4) else "")
        ax.axhspan(
            low, max(high, low * 1.004), facecolor="#FBE3B5", edgecolor="#C9A55A", hatch="///", lw=0.6, label=name
        )
    if proven is not None:
        ax.axhline(proven, color=PUSHED, lw=1.1, ls=(0, (1, 1.5)), label=f"proven, none below: {proven:.5g}")
    if len(curve.distance):
        ax.plot(
            curve.faster[:, 0] / unit, curve.faster[:, 1], color=FASTER, lw=1.0, ls=(0, (4, 2)), label="faster push"
        )
        ax.plot(curve.distance / unit, curve.load_factor, color=PUSHED, lw=1.3, label="slower push")
        at = curve.collapse
        name = f"collapse: {curve.collapse_load:.5g}"
        ax.plot(curve.distance[at] / unit, curve.load_factor[at], "v", color=PUSHED, ms=7, label=name)
    if np.isfinite(load_factor):
        name = f"limit analysis: λ = {load_factor:.5g}"
        ax.axhline(load_factor, color=LIMIT, lw=1.2, ls=(0, (6, 1.5, 1, 1.5)), label=name)
    top = np.nanmax([load_factor, curve.load_factor.max(initial=0.0), 1e-300])
    ax.set_ylim(min(0.0, float(np.clip(curve.load_factor.min(initial=0.0), -0.15 * top, 0.0))), 1.45 * top)
    ax.set_xlim(left=0.0)
    ax.set_xlabel("movement of the live loads / elastic one at collapse [–]", fontsize=9)
    ax.set_ylabel("λ [–]", fontsize=9)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(frameon=False, fontsize=8, loc="upper right")
    if not curve.stands:
        ax.text(0.5, 0.5, "does not stand under its dead loads", transform=ax.transAxes, ha="center", fontsize=10)
    ax.tick_params(labelsize=8)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)


def figure_of(
    curve: Curve, result: LimitAnalysisResult, band: tuple[float, float] | None = None, proven: float | None = None
) -> Figure:
    # The figure is not saved.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from jld_views import figures

    figure = Figure(figsize=(14.4, 5.7), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 3, width_ratios=(1.15, 1.0, 1.0))
    draw_curve(axes[0], curve, result.load_factor, band, proven)
    titles = ("end of the experiment", "mechanism of limit analysis")
    for ax, motion, title in zip(axes[1:], (end_state(curve, result), result), titles, strict=True):
        figures.draw_mechanism(ax, motion)
        ax.set_title(title, fontsize=10)
    joints = curve.joints
    dilation = "dilation = friction" if joints.dilation == "friction" else f"dilation {joints.dilation:g}"
    status = status_of(curve, result.load_factor)
    figure.suptitle(f"{curve.assembly.name}: {status} · {joints.inner} inner faces, {dilation}", fontsize=11)
    return figure
