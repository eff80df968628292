"""Prove the strongest layout of blocks that crack anywhere, to a gap, without enumeration.

A velocity field bounds λ of every labelling by a sum over faces. A labelling that is proven too weak is therefore
minimised to a conflict, as by rigid blocks (`drivers.exact`), and a formula is asked for labellings that no conflict
rules out. On the coarsest mesh a labelling costs some hundredths of a second. One that this mesh does not refute is
evaluated and joins a pool, whose meshes are refined until its own velocity field refutes it, or its own stress field
makes it the strongest. A labelling whose bracket is as narrow as the gap is always refuted above best / (1 − gap), so
that a formula without a model there proves the best to the gap. The proof is checked when it ends (`proof_check`).
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.deadline import Deadline, DeadlinePassed, time_left
from jld_core.errors import InputError, ParameterError
from jld_core.fields.mesh import Mesh
from jld_core.files import whole_file
from jld_core.limit import Status
from jld_explore.drivers.anneal import Anneal
from jld_explore.drivers.base import Aim, Driver
from jld_explore.drivers.exact.driver import ExactOptions
from jld_explore.drivers.exact.possible_blocks import PossibleBlocks, possible_blocks
from jld_explore.drivers.exact.proof_state import Conflict, Mechanism
from jld_explore.drivers.field_aims import ProofAim, aim_of
from jld_explore.drivers.field_proof import FieldProof
from jld_explore.drivers.genetic import Genetic
from jld_explore.evaluation import Evaluation, Records
from jld_explore.evaluation.field_pool import FieldPool
from jld_explore.space import SearchSpace

if TYPE_CHECKING:
    import pandas as pd


CONFLICTS_FILE: Final = "conflicts.npz"
"""Name of the file of conflicts in the folder of a study."""

_MESH: Final = [one.name for one in fields(Mesh)]  # arrays of a mesh


def save_conflicts(folder: Path, proof: FieldProof) -> None:
    """Write the conflicts of a proof with their velocity fields and meshes to one file."""
    # The file `CONFLICTS_FILE` is replaced as a whole. Conflicts without a velocity field in memory are left out.
    # Without any conflict nothing is written.
    conflicts = [one for one in proof.state.conflicts if one.mechanism is not None]
    if not conflicts:
        return
    problems, shared = proof.refuter.relaxation.problems, proof.refuter.cases
    mechanisms = [one.mechanism for one in conflicts if one.mechanism is not None]
    own = sorted({one.case for one in mechanisms if one.case >= shared})
    number = {case: shared + place for place, case in enumerate(own)}
    content: dict[str, Any] = {
        "shared": np.array(shared),
        "case": np.array([number.get(one.case, one.case) for one in mechanisms], dtype=np.int64),
        "load": np.array([proof.refuter.load_case(problems[case]) for case in own], dtype=np.int64),
        **_joined("faces", [one.faces for one in conflicts]),
        **_joined("labels", [one.labels for one in conflicts]),
        **_joined("velocity", [one.velocity.ravel() for one in mechanisms]),
    }
    for name in _MESH:
        arrays = [getattr(problems[case].mesh, name) for case in own]
        content |= _joined(f"mesh_{name}", [array.ravel() for array in arrays])
    with whole_file(folder / CONFLICTS_FILE) as fresh, fresh.open("wb") as file:
        np.savez(file, **content)


def load_conflicts(folder: Path, proof: FieldProof) -> list[Conflict]:
    """Read the conflicts that an earlier run of a study stored, and compute their bounds again.

    Result: conflicts with the bounds that weighing gives; those without a finite bound are left out. Empty without a
    file, or where it has another number of load cases. Raises InputError if the file cannot be read.
    """
    # The meshes of the file are added to the proof. The caller adds the conflicts.
    path = folder / CONFLICTS_FILE
    if not path.exists():
        return []
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
        found = _conflicts_in(content, proof)
    except (OSError, ValueError, KeyError, IndexError, zipfile.BadZipFile) as error:
        told = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(str(path), f"it is damaged ({told})", "a file as jld explore left it, or none") from None
    return found


def _conflicts_in(content: dict[str, Any], proof: FieldProof) -> list[Conflict]:
    """Compute the bounds of the conflicts of a file again, and return those with finite bounds.

    Adds the meshes of the file to `proof`. Empty where the number of load cases differs.
    """
    if int(content["shared"]) != proof.refuter.cases:
        return []
    cases = content["case"].tolist()
    parts = {name: _parted(content, f"mesh_{name}") for name in _MESH}
    for place, load in enumerate(content["load"].tolist()):
        shapes = {"points": (-1, 2), "simplices": (-1, 3), "tagged": (-1, 2)}
        arrays: dict[str, Any] = {name: parts[name][place].reshape(shapes.get(name, (-1,))) for name in _MESH}
        proof.refuter.add_problem(load, Mesh(**arrays))
    triples = zip(
        _parted(content, "faces"), _parted(content, "labels"), _parted(content, "velocity"), cases, strict=True
    )
    found = []
    for faces, labels, velocity, case in triples:
        mechanism = Mechanism(case, velocity.reshape(-1, 3, 2))
        one = Conflict(faces.astype(np.int64), labels.astype(bool), np.inf, mechanism=mechanism)
        bound = proof.refuter.weigh(one)
        if np.isfinite(bound):
            found.append(replace(one, bound=bound))
    return found


def _joined(name: str, arrays: list[Any]) -> dict[str, Any]:
    """Return arrays (j,) of different lengths as one array `name`, with lengths `name_sizes`."""
    sizes = np.array([len(array) for array in arrays], dtype=np.int64)
    return {name: np.concatenate(arrays) if arrays else np.empty(0), f"{name}_sizes": sizes}


def _parted(content: dict[str, Any], name: str) -> list[Floats]:
    """Return the arrays that `_joined` joined under a name."""
    return np.split(content[name], np.cumsum(content[f"{name}_sizes"])[:-1]) if len(content[f"{name}_sizes"]) else []


# Largest share of the time left for listing the possible blocks; the formula works without the list
_LISTING: Final = 0.3

_ANNEALED: Final = 0.25  # largest share of a time limit for the labellings evaluated before the proof


class FieldExact(Driver):
    """Driver that proves, to a gap, the largest λ of a space whose blocks crack anywhere.

    space: the search space, of a planar assembly. aim: prove the strongest layout, or that of every count of the front.
    Where the scene requires a load factor the best count among layouts that carry it is proven instead. gap: relative
    distance between the best lower bound and the bound on all labellings at which the proof ends. search: labellings
    evaluated before the proof, per face that can change. Raises InputError if cells may be left out, a front is aimed
    at beside a required factor, or no formula expresses the count of the front or one that the scene limits.
    """

    name = "exact"
    remembers = True
    checks = True
    Options = ExactOptions

    def __init__(
        self, space: SearchSpace, seed: int = 0, aim: Aim = "best", *, gap: float = 0.05, search: int = 30
    ) -> None:
        super().__init__(space, seed)
        aimed = aim_of(space, aim, gap)
        blocks = _listed(space)
        _require_formula(space, blocks, aimed)
        self._proof, self._aim = FieldProof(space, blocks, seed, aimed), aim
        self._search = Anneal(space, seed) if aimed.count is None else Genetic(space, seed, aim=aim)
        self._left = search * int(space.candidates.sum())
        self._heartbeat: Callable[[], None] = lambda: None
        self._before = Deadline()
        self._folder: Path | None = None
        self._asked = False
        self._contradictions: list[str] = []

    @classmethod
    def to_gap(cls, gap: float, space: SearchSpace, seed: int, given: Mapping[str, Any]) -> FieldExact:
        """Make a driver that proves to a gap.

        Raises InputError if an option is unknown or has a wrong value, and as the class.
        """
        options = {key: value for key, value in given.items() if value is not None}
        for key in options:
            if key not in cls.Options.model_fields:
                raise ParameterError(key, "the driver exact has no such option", "an option that it has")
        driver = cls.made(space, seed, options)
        driver._proof.aim.gap = gap
        return driver

    # --- what is known ----------------------------------------------------------------------------------

    @property
    def pool(self) -> FieldPool:
        """Labellings that are refined one by one, with their bounds; see `FieldPool`."""
        return self._proof.pool

    @property
    def best(self) -> float:
        """Largest governing factor that a layout is proven to carry; −inf without a layout."""
        return self._proof.best

    def bounds_above(self, labellings: Bits) -> Floats:
        """Return upper bounds on the governing factor of labellings that conflicts prove, (k,).

        labellings: (k, m), True = dry. inf where nothing is proven, and for all where the proof was contradicted or
        failed its check.
        """
        if self.complaints:
            return np.full(len(labellings), np.inf)
        return self._proof.bounds_above(labellings)

    @property
    def bound(self) -> float | None:
        """Proven upper bound on the governing factor of all labellings, scene units.

        None before there is one, after a failed check, and after a second contradiction.
        """
        failed = self._proof.check is not None and not self._proof.check.passed
        return None if failed or self._given_up or not math.isfinite(self._proof.bound) else self._proof.bound

    @property
    def finished(self) -> bool:
        """True if the proof ended and passed its check."""
        return self._proof.check is not None and self._proof.check.passed

    @property
    def open_layouts(self) -> int:
        """Number of layouts of better count whose refinement ended without a decision.

        They may carry the required factor, so the best count is not proven. 0 for other aims.
        """
        return int(self._proof.aim.facts({}, False).get("open_layouts", 0))

    @property
    def settings(self) -> dict[str, Any]:
        """{"aim": "front"} where a front is proven, else empty."""
        return {"aim": self._aim} if self._aim == "front" else {}

    @property
    def working(self) -> bool:
        """True until the proof has ended or was contradicted twice."""
        return not self._proof.settled and not self._given_up

    @property
    def _given_up(self) -> bool:
        """True if the proof was contradicted again after its restart."""
        return len(self._contradictions) > 1

    @property
    def complaints(self) -> list[str]:
        """Contradictions, then the problem of a failed check, a line each; empty for none."""
        check = self._proof.check
        return [*self._contradictions, *([] if check is None or check.passed else [f"not proven: {check.problem}"])]

    def facts(self, results: pd.DataFrame, complete: bool) -> dict[str, Any]:
        """Return entries of the summary: cost of the proof, facts of its aim, and its check."""
        # "conflicts": number of conflicts. "relaxations": number of programs solved. "proof_check": result of the
        # check, only after the proof has ended.
        proof = self._proof
        found: dict[str, Any] = {
            "conflicts": len(proof.state.conflicts),
            "relaxations": proof.refuter.programs + proof.pool.programs,
        }
        sure = not self.complaints
        found |= proof.aim.facts(proof.incumbents.best(), sure)
        return found if proof.check is None else {**found, "proof_check": proof.check.to_dict()}

    def withdraw(self, reason: str) -> None:
        """Note a contradiction, forget all conflicts and start the proof again.

        Evaluations are kept. After a second contradiction the proof is given up.
        """
        self._contradictions.append(reason)
        self._proof.restart()

    def set_workers(self, jobs: int) -> None:
        """Set the number of processes that refute and refine."""
        self._proof.pool.tasks.jobs = jobs

    def start(self, deadline: Deadline | None, heartbeat: Callable[[], None], records: Records | None = None) -> None:
        """Set deadline and heartbeat, and load the conflicts of a resumed study.

        The driver stops a little before the deadline. Raises InputError for a damaged file of conflicts.
        """
        own = Deadline() if deadline is None else deadline.earlier(0.3)
        self._proof.deadline = self._proof.pool.deadline = own
        self._before = own.within(_ANNEALED * own.remaining())
        self._heartbeat = heartbeat
        if records is not None:
            self._folder = records.folder
            self._proof.take(load_conflicts(self._folder, self._proof))

    def close(self) -> None:
        """Stop the worker processes, and save the conflicts in the folder of the study."""
        self._proof.pool.tasks.close()
        if self._folder is not None and self._folder.is_dir():
            save_conflicts(self._folder, self._proof)

    def restore(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take over the bounds of evaluations of a resumed study."""
        self._learn(labellings, evaluations)

    # --- ask and tell -----------------------------------------------------------------------------------

    def ask(self, limit: int | None = None) -> Bits:
        """Return the next labellings to evaluate, (k, m), True = dry.

        Empty if the proof ended, was given up, or has no time left.
        """
        # The first labellings come from a search. Later calls continue the proof until it needs evaluations.
        if not self._asked:
            self._asked = True
            self._proof.bound_all()
            if self._proof.reached:
                self._left = 1  # a study has one result
        elif self._proof.reached:
            self._left = 0
        if self._left > 0 and not self._before.passed():
            found = self._search.ask(self._left if limit is None else min(limit, self._left))
            self._left = self._left - len(found) if len(found) else 0
            if len(found):
                return found
        self._left = 0
        proof = self._proof
        while not proof.waiting and self.working and not proof.stopped and not proof.deadline.passed():
            proof.work()
            self._heartbeat()
        count = len(proof.waiting) if limit is None else limit
        given, proof.waiting = proof.waiting[:count], proof.waiting[count:]
        return np.array(given, dtype=bool).reshape(len(given), len(self.space.fixed))

    def tell(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Take in evaluations of labellings (k, m), for the search and as bounds for the proof.

        The evaluations hold both bounds on the coarsest mesh.
        """
        self._search.tell(labellings, evaluations)
        self._learn(labellings, evaluations)

    def _learn(self, labellings: Bits, evaluations: Sequence[Evaluation]) -> None:
        """Keep the bounds of evaluated labellings."""
        low = [found.low if found.status is Status.COLLAPSE else -math.inf for found in evaluations]
        high = [found.high if math.isfinite(found.high) else math.inf for found in evaluations]
        self._proof.learn(labellings, low, high)


def _listed(space: SearchSpace) -> PossibleBlocks | None:
    """List the possible blocks of a space; None if they are too many, or listing takes too long."""
    try:
        with Deadline(_LISTING * time_left()).enforced():
            return possible_blocks(space)
    except DeadlinePassed:
        return None


def _require_formula(space: SearchSpace, blocks: PossibleBlocks | None, aim: ProofAim) -> None:
    """Raise InputError if cells may be left out, or if no formula expresses a count.

    The limited counts and the count of the aim must have a formula.
    """
    if space.void is not None:
        raise ParameterError("driver", "exact proves nothing where cells may be left out", "enumeration or genetic")
    for count in [count for count, _ in space.limits.on_counts] + ([] if aim.count is None else [aim.count]):
        terms = count.terms(space.assembly) if count.terms else None
        if terms is None or (terms.blocks and blocks is None):
            raise ParameterError("driver", f"exact by fields has no formula for the count {count.name}", "enumeration")
