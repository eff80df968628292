"""From a scene to a finished folder: driver chosen, study run, tables and pictures written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jld_core.build import build_assembly
from jld_core.errors import InputError
from jld_core.limit import SolveOptions
from jld_core.scene import Scene
from jld_core.threads import one_thread
from jld_explore.drivers import DRIVERS, OPTIONS, make_driver, size_up_to
from jld_explore.evaluation import CERTIFICATES_FILE, EvaluatorSettings, Store
from jld_explore.experiments import DEFAULT, Experiments, add_experiments
from jld_explore.report import Exploration, check_folder, write_pictures, write_report, write_tables, write_text
from jld_explore.space import SearchSpace, search_space
from jld_explore.study import Progress, StopReason, Study

if TYPE_CHECKING:
    pass

SMALL = 20_000
"""Classes up to which a space is enumerated when no driver is named, as `ExploreSettings.small`."""


@dataclass(frozen=True)
class ExploreSettings:
    """How to search. driver: a name, or None to choose. budget: classes; seconds: time limit; seed, jobs as said.

    model: what is modelled, whose λ is maximised. resume: go on with a folder that holds a study. certificates: let
    past solves settle labellings. pictures: draw what was found at the end. strict: take what is possible but hardly
    meant as an error. experiment: how many of the best by λ are put to the virtual experiment
    at the end. by_experiment: search by it then, with as many experiments in all (default 500), seeded by the best
    by λ. small: classes up to which a space is counted beforehand, and enumerated where no driver is
    named; 0: not counted.
    """

    driver: str | None = None
    model: SolveOptions = field(default_factory=SolveOptions)
    budget: int | None = None
    seconds: float | None = None
    jobs: int = 1
    seed: int = 0
    resume: bool = False
    certificates: bool = False
    experiment: int | None = None
    by_experiment: bool = False
    pictures: bool = True
    strict: bool = False
    small: int = SMALL
    options: dict[str, Any] = field(default_factory=dict)


@one_thread()
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
    if assembly.warnings and settings.strict:
        raise InputError("", assembly.warnings[0], "a scene without warnings, or no --strict")
    if announce is not None:
        for warning in assembly.warnings:
            announce(f"warning: {warning}")
    if assembly.cases and settings.certificates:
        raise InputError("--certificates", "they speak of one load, and the scene has cases", "a search without them")
    space = search_space(scene, assembly)
    name, total = choose_driver(space, settings)
    if announce is not None:
        announce(f"driver: {name}" + (f", {total} classes" if total is not None else ""))
    driver = make_driver(name, space, settings.seed, **_options(name, scene, folder, settings))
    if driver.modular and not replace(settings.model, friction="associative").modular:
        raise InputError(
            "--driver", f"{name} has no bounds for this model", "convex contact on whole faces, paper bending"
        )
    study = Study(
        scene=scene,
        assembly=assembly,
        space=space,
        driver=driver,
        folder=folder,
        seed=settings.seed,
        jobs=settings.jobs,
        budget=settings.budget,
        seconds=settings.seconds,
        settings=EvaluatorSettings(model=settings.model),
        certificates=settings.certificates and settings.model.modular,
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
        write_tables(study, name, StopReason.INTERRUPTED, total)
        raise
    if reason is StopReason.EXHAUSTED and not len(study.store):
        # a space too large to see through beforehand has turned out empty: leave nothing behind
        for path in (study.store.path, folder / CERTIFICATES_FILE, folder / "scene.json"):
            path.unlink(missing_ok=True)
        if not any(folder.iterdir()):
            folder.rmdir()
        raise _nothing_to_search()
    done = write_tables(study, name, reason, total)
    if settings.experiment or settings.by_experiment:
        deadline = None if settings.seconds is None else study.started + settings.seconds
        experiments = Experiments(assembly, folder, settings.jobs, deadline)
        objective = (settings.model, settings.seed) if settings.by_experiment else None
        done = add_experiments(done, space, experiments, settings.experiment or DEFAULT, objective)
    if settings.pictures:
        write_pictures(done)
        write_report(done)
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
        facts = (
            scene.name,
            scene.fingerprint[:12],
            settings.model.friction,
            given.get("sampler", "TPE"),
            settings.seed,
        )
        given["title"] = "jld " + " ".join(str(fact) for fact in facts)
    return given


def choose_driver(space: SearchSpace, settings: ExploreSettings) -> tuple[str, int | None]:
    """Name of the driver and the number of classes where it is known.

    Raises InputError for an unknown name, and for a space that provably holds no labelling.
    """
    if settings.driver is not None and settings.driver not in DRIVERS:
        raise InputError("--driver", f"no driver is named {settings.driver!r}", "one of " + ", ".join(DRIVERS))
    known = size_up_to(space, settings.small) if settings.small else None
    if known == 0:
        raise _nothing_to_search()
    return settings.driver or ("enumeration" if known is not None else "genetic"), known


def _nothing_to_search() -> InputError:
    return InputError("search", "no labelling satisfies the constraints", "constraints that some labelling meets")
