"""What each way of finding conflicts is worth: conflicts and processor time until nothing above a given λ is left.

Walls at their proven optimum, so that nothing is found and all is refuted; and how λ > 80 of a crushable arch falls.
Then what was tried and loses, and how strong layouts annealing finds in a given time.
`python -m benchmarks.refuting` measures all, `… refuting ways`, `lost` or `annealing` (three minutes) that section
alone; every line is one process and one thread.
"""

from __future__ import annotations

import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.common import RESULTS, table, write
from benchmarks.exact import arch, sections, summary_of, wall
from benchmarks.refuting_ways import Implying, Reaching, Together, Translating
from jld_core import Scene, build_assembly
from jld_core.batch import library
from jld_core.limit import LimitAnalysis
from jld_core.limit.relaxation import Relaxation
from jld_explore.drivers.exact import conflict_generation
from jld_explore.drivers.exact.formula import Formula
from jld_explore.drivers.exact.possible_blocks import possible_blocks
from jld_explore.space import SearchSpace, search_space

CASES: Final[dict[str, tuple[Scene, float]]] = {
    "6 × 8, s = 3, 20 kPa, λ > 0.716415": (wall(6, 8, 3, 2e4), 0.716415),
    "5 × 7, s = 3, 5 kPa, λ > 0.649483": (wall(5, 7, 3, 5e3), 0.649483),
    "flat arch, σc = 5 MPa, λ > 80": (arch(), 80.0),
}
MOST: Final = 30.0
"""Seconds a line may take."""

VARIANTS: Final[dict[str, dict[str, Any]]] = {
    "as shipped": {},
    "without neighbours": {"_NEIGHBOURS": 0},
    "six neighbours": {"_NEIGHBOURS": 6},
    "one drawn at a time": {"_DRAWN": 1},
    "as many dry as inner preferred": {"_DRY": 0.5},
    "inner faces not tried first": {"_INNER": False},
    "one single face tried in vain": {"_TRIES": 1},
    "eight": {"_TRIES": 8},
    "none of all that": {"_NEIGHBOURS": 0, "_DRAWN": 1, "_INNER": False, "_TRIES": 1},
}
FOUND: Final = {"6 × 8, s = 3, 20 kPa": wall(6, 8, 3, 2e4), "8 × 10, s = 3, 20 kPa": wall(8, 10, 3, 2e4)}
SECONDS: Final = 10.0
SEEDS: Final = 5
NOTE: Final = (
    f"Processor seconds of one process, at most {MOST:g}. Relaxations, and milliseconds each, with all that is done "
    "around them. Without the kernel labellings are drawn and shrunk one at a time by the conic solver, with two "
    "single faces tried in vain, and in the arch with dry and inner copies of its joints that share the forces.\n"
    "\nTried and not kept: a motion taken as soon as it refutes (fewer iterations each, and 1.8 times the conflicts on "
    "the 6 × 8 wall, since it frees fewer faces); motions that are not moved to the normals of the rows they lie at "
    "(2.3 times the conflicts of the weak wall); labellings drawn with half of the incumbent's labels, which changes "
    "nothing, or with more of them, which takes up to 1.6 times as long; two planes that stay where they are in place "
    "of the one in which shear and bending of crushing joints meet (87.99 at the root, and 1.1 to 1.3 times the "
    "conflicts of the arch)."
)
LOST: Final[dict[str, Any]] = {
    "as shipped": conflict_generation.ConflictGenerator,
    "translates of a conflict by a cell to either side, shrunk on": Translating,
    "labels that propagation derives from the others left out": Implying,
    "the same kept decided while single faces are tried": partial(Implying, kept=True),
    "cracks of one rigid motion as reachability": Reaching,
    "translates, derived labels left out, and reachability": Together,
}
"""What was tried and loses: how it hunts."""
LOST_AT: Final[dict[str, tuple[Scene, float]]] = {
    "6 × 8, s = 3, λ > 0.735": (wall(6, 8, 3, 2e4), 0.735),
    "6 × 8, s = 3, λ > 0.716415": (wall(6, 8, 3, 2e4), 0.716415),
    "8 × 10, s = 3, λ > 0.74": (wall(8, 10, 3, 2e4), 0.74),
    "5 × 7, 5 kPa, λ > 0.649483": (wall(5, 7, 3, 5e3), 0.649483),
}
LOST_MOST: Final = 10.0
LOST_HEAD: Final = "What loses"
LOST_WORDS: Final = (
    f"Conflicts, relaxations and processor seconds, at most {LOST_MOST:g}, all in one run of `python -m "
    "benchmarks.refuting lost`; `benchmarks/refuting_ways.py` hooks each onto the hunt that is shipped."
)
WHY_LOST: Final = (
    "Of the translates of a conflict a fifth still refute on the 6 × 8 wall, and most of those say what others have "
    "said. What propagation derives may stay decided and out of the conflict, which is then valid at its own "
    "threshold alone; that leaves out up to a third of the faces, for relaxations that are solved one after the other. "
    "Weighing a mechanism by the best choice of blocks instead of face by face frees one face in 20 and no conflict "
    "is saved: one inner face holds nearly every crack of strong walls, so that a conflict is a crack with all of its "
    "faces dry. All cracks of one rigid motion at once save half the conflicts of a high threshold, with 40 motions "
    "of 24 levels each, a third of them at the optimum, and take two to five times as long: a conflict costs half a "
    "millisecond in the kernel, and the clauses of motions slow every drawing. It is sound: of 1367 labellings of "
    "three walls that carry more than the threshold, none was ruled out by 325 motions in a trial apart. Most "
    "mechanisms are of several parts, each with a motion of its own."
)


@contextmanager
def changed(settings: dict[str, Any]) -> Iterator[None]:
    """With other numbers in the module that finds conflicts."""
    old = {name: getattr(conflict_generation, name) for name in settings}
    for name, value in settings.items():
        setattr(conflict_generation, name, value)
    try:
        yield
    finally:
        for name, value in old.items():
            setattr(conflict_generation, name, value)


def space_of(scene: Scene) -> tuple[SearchSpace, Relaxation]:
    """The search space of a scene and its relaxation."""
    assembly = build_assembly(scene)
    return search_space(scene, assembly), Relaxation(LimitAnalysis(assembly))


def refuted(
    scene: Scene,
    load: float,
    kind: Callable[..., conflict_generation.ConflictGenerator] = conflict_generation.ConflictGenerator,
    most: float = MOST,
) -> list[str]:
    """Conflicts, faces in one, relaxations, processor seconds and ms a relaxation until nothing is left above λ."""
    space, relaxation = space_of(scene)
    threshold = load / relaxation.template.scaling.load
    blocks = possible_blocks(space)
    free = space.candidates.copy()
    if blocks is not None:
        joined = {face for inside in blocks.inside for face in inside}
        free &= np.isin(np.arange(len(free)), list(joined))
    formula, hunt = Formula(space, blocks), kind(relaxation, free, 0)
    hunt.begin(formula)
    began, lengths, unrefuted = time.process_time(), [], 0
    while True:
        caught = hunt.step(threshold)
        lengths += [len(conflict.faces) for conflict in caught.conflicts]
        unrefuted += len(caught.unrefuted)
        spent = time.process_time() - began
        if caught.exhausted or spent > most:
            break
    end = "" if caught.exhausted else "more than "
    mean = float(np.mean(lengths)) if lengths else 0.0
    each = 1e3 * spent / relaxation.solves
    return [f"{end}{len(lengths)}", f"{mean:.1f}", str(relaxation.solves), f"{end}{spent:.1f}", f"{each:.2f}"]


def incumbents() -> list[list[str]]:
    """Rows of the table of what annealing finds."""
    rows = []
    for name, scene in {**FOUND, "flat arch, 67 faces, σc = 5 MPa": arch()}.items():
        found, counts = [], []
        for seed in range(SEEDS):
            facts = summary_of(scene, driver="anneal", seed=seed, seconds=SECONDS)
            found.append(facts["best"])
            counts.append(facts["evaluated"])
        row = [name, f"{statistics.median(found):.5g}", f"{min(found):.5g}", f"{max(found):.5g}"]
        rows.append([*row, f"{statistics.median(counts):.0f}"])
        print(rows[-1], flush=True)
    return rows


def lost() -> str:
    """The table of what loses."""
    rows = []
    for name, kind in LOST.items():
        row = [name]
        for scene, load in LOST_AT.values():
            conflicts, _, relaxations, seconds, _ = refuted(scene, load, kind, LOST_MOST)
            row.append(f"{conflicts}; {relaxations}; {seconds} s")
        rows.append(row)
        print(row, flush=True)
    return table(["how", *LOST_AT], rows)


HEAD: Final = "What annealing finds"


def main(*wanted: str) -> None:
    """Measure and write the tables; wanted: of which sections, the others stay as they are in the file."""
    path = RESULTS / "refuting.md"
    parts = sections(path.read_text(encoding="utf-8").rpartition("\n\n")[0]) if path.exists() else {}
    if not wanted or "ways" in wanted:
        rows = []
        for name, (scene, load) in CASES.items():
            for variant, settings in VARIANTS.items():
                with changed(settings):
                    rows.append([name, variant, *refuted(scene, load)])
                print(rows[-1], flush=True)
            with off():
                rows.append([name, "without the kernel", *refuted(scene, load)])
            print(rows[-1], flush=True)
        head = ["what is refuted", "how", "conflicts", "faces in one", "relaxations", "s", "ms a relaxation"]
        parts[""] = "\n\n".join(("# Ways of refuting", table(head, rows), NOTE.strip()))
    if not wanted or "lost" in wanted:
        parts[LOST_HEAD] = "\n\n".join((LOST_WORDS, lost(), WHY_LOST))
    if not wanted or "annealing" in wanted:
        head = ["scene", f"λ after {SECONDS:g} s of one processor, median of {SEEDS}", "least", "most", "labellings"]
        parts[HEAD] = table(head, incumbents())
    write("refuting", "\n\n## ".join([parts.pop(""), *(f"{head}\n\n{body}" for head, body in parts.items())]))


@contextmanager
def off() -> Iterator[None]:
    """Without the batch solver."""
    old = os.environ.get(library.SWITCH)
    os.environ[library.SWITCH] = "off"
    try:
        yield
    finally:
        if old is None:
            del os.environ[library.SWITCH]
        else:
            os.environ[library.SWITCH] = old


if __name__ == "__main__":
    main(*sys.argv[1:])
