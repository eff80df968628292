"""Tasks of a proof by fields that worker processes carry out.

They find conflicts on the meshes of all labellings, and on meshes refined for one labelling. The result of a task
depends on its arguments alone, so that a proof does not depend on the number of processes.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools
from jld_core.fields.adaptive import Fields, FieldSetting
from jld_core.fields.mesh import Mesh
from jld_core.fields.transfer import weighed
from jld_core.threads import one_thread
from jld_explore.drivers.exact.conflict_generation import conflict_of
from jld_explore.drivers.exact.proof_state import Conflict, Mechanism
from jld_explore.drivers.field_relaxation import FieldProblem, FieldRelaxation, raised
from jld_explore.evaluation.field_pool import FieldStep, step_of

_KEPT: Final = 4  # number of meshes whose programs a process keeps

# Single faces tried in vain on each mesh before a conflict is accepted. With three on the finest mesh alone the 4 × 6
# wall of 20 kPa takes over 168 s of processor time instead of 131 s.
_TRIES: Final = 1

_SHORT: Final = 5  # number of faces of a conflict up to which finer meshes are not tried to shorten it


class _Kept(threading.local):
    """Relaxations that a thread keeps, by proof and level; the one used last is at the end."""

    def __init__(self) -> None:
        self.relaxations: OrderedDict[tuple[str, int], FieldRelaxation] = OrderedDict()


_kept = _Kept()


@dataclass(frozen=True)
class ProofSetup:
    """Data that all tasks of a proof share.

    name: name of the proof, unlike that of any other; each process keeps relaxations by it. settings: setting of each
    load case. required: required factor of each load case. free: (m,) faces that may take either label. levels: meshes
    that all labellings share, from coarse to fine: each level has one mesh for each load case.
    """

    name: str
    settings: tuple[FieldSetting, ...]
    required: tuple[float, ...]
    free: Bools
    levels: tuple[tuple[Mesh, ...], ...]

    def problems(self, level: int) -> list[FieldProblem]:
        """Return one problem for each load case, on the meshes of `levels[level]`."""
        triples = zip(self.settings, self.levels[level], self.required, strict=True)
        return [FieldProblem(*one) for one in triples]


@dataclass(frozen=True)
class LevelConflict:
    """Result of refuting one labelling on the meshes that all labellings share.

    first: level (position in `ProofSetup.levels`) that refutes the labelling first, −1 for none. level: level whose
    meshes the mechanism of the conflict belongs to, −1 for none. conflict: the conflict; `Mechanism.case` is the load
    case. None where no level refutes the labelling. solves: programs solved.
    """

    first: int
    level: int
    conflict: Conflict | None
    solves: int


@one_thread()
def level_conflict(setup: ProofSetup, labels: Bits, threshold: float, levels: tuple[int, ...]) -> LevelConflict:
    """Refute a factor for a labelling, and minimise the labelling to a conflict.

    The first level that refutes it gives a conflict; finer levels then try to shorten it.

    setup: the proof. labels: (m,) True = dry. threshold: governing factor to refute. levels: levels of `setup.levels`
    to try until one refutes the labelling, from coarse to fine. Result: the last conflict that has fewer faces than the
    one before.
    """
    solves, last = 0, len(setup.levels) - 1
    first, level, found = -1, -1, None
    for place in range(last + 1):
        if (found is None and place not in levels) or (found is not None and len(found.faces) <= _SHORT):
            continue
        relaxation = _relaxation(setup, place)
        before = relaxation.solves
        decided = None if found is None else np.isin(np.arange(len(labels)), found.faces)
        one = conflict_of(relaxation, labels, setup.free, threshold, _TRIES, decided)
        solves += relaxation.solves - before
        if one is not None and (found is None or len(one.faces) < len(found.faces)):
            first, level, found = (place if found is None else first), place, one
    return LevelConflict(first, level, found, solves)


def _relaxation(setup: ProofSetup, level: int) -> FieldRelaxation:
    """Return the relaxation on the meshes of a level, which this thread keeps for a while.

    Its order of problems is reset, so that results do not depend on earlier tasks.
    """
    name, known = (setup.name, level), _kept.relaxations
    if name not in known:
        known[name] = FieldRelaxation(setup.problems(level))
        while len(known) > _KEPT:
            known.popitem(last=False)
    known.move_to_end(name)
    known[name].restart()
    return known[name]


@one_thread()
def refuting_step(
    setting: FieldSetting, labels: Bits, mesh: Mesh, required: float, enough: float, free: Bools, over: float
) -> FieldStep:
    """Bound a labelling on one mesh, and minimise it if its velocity field refutes a factor.

    labels: (m,) True = dry. mesh: the mesh, scene units. required: required factor of the load case. enough: governing
    factor: where the upper bound is below it, no lower bound is computed. free: (m,) faces that may take either label.
    over: governing factor to refute. Result: as of `refined_step`, with a conflict in `more`: that of a refuted
    labelling, else the bound of the labelling alone, or None.
    """
    start = time.perf_counter()
    fields = Fields.on(setting, mesh, labels, enough * required)
    conflict = None
    if fields.bounds[1] < over * required:
        relaxation = FieldRelaxation([FieldProblem(setting, mesh, required)])
        conflict = conflict_of(relaxation, labels, free, over, tries=0)
    return step_of(fields, start, _whole_conflict(fields, required, free) if conflict is None else conflict)


def _whole_conflict(fields: Fields, required: float, free: Bools) -> Conflict | None:
    """Return the bound of a velocity field on its labelling, as a conflict of all free faces.

    None without a field or a finite bound. required: factor of the load case.
    """
    if fields.velocity is None:
        return None
    found = weighed(fields.upper, fields.velocity.velocity)
    bound = np.inf if found is None else found.bound_of(fields.labels, np.zeros_like(free)) / required
    if not np.isfinite(bound):
        return None
    faces = np.flatnonzero(free)
    return Conflict(faces, fields.labels[faces], raised(bound), mechanism=Mechanism(0, fields.velocity.velocity))
