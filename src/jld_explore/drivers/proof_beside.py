"""Proof in a process beside any search: the block relaxation of all layouts first, then the exact driver."""

from __future__ import annotations

import math
import os
import pickle
import threading
from concurrent.futures import Future
from contextlib import suppress
from typing import Final, NamedTuple

import cloudpickle
import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.limit.analysis import LimitAnalysis
from jld_core.limit.block_relaxation import applies_to
from jld_core.limit.case_relaxation import AnyRelaxation, NormalCaps, relaxation_of
from jld_core.limit.options import SolveOptions, Status
from jld_core.threads import memory_limit, one_thread
from jld_explore.drivers.exact.block_bounds import BlockSpace, sides_of
from jld_explore.drivers.exact.context import listed_blocks
from jld_explore.drivers.exact.driver import Exact
from jld_explore.evaluation import EvaluatorSettings, Pool, evaluator_of
from jld_explore.evaluation.cases import Standing
from jld_explore.evaluation.pool import done_in, is_lost
from jld_explore.evaluation.protocol import Evaluation
from jld_explore.space.search_space import SearchSpace

LEAST_SECONDS: Final = 5.0  # shortest time of a search with a proof beside it; its process takes two seconds to start
_SIDE_SECONDS: Final = 6e-4  # time of the program for each side of a block; 40 000 to 77 000 sides took 24 to 48 s
_SIDE_MEMORY: Final = 16e3  # memory of the program for each side of a block, bytes
_CAPPED: Final = 0.1  # share of the time left for the second program, of normal forces that are bounded
_MEMORY_SHARE: Final = 0.4  # largest share of the memory for the program
_LISTED_WITHIN: Final = 0.3  # share of the time that is open to listing the possible blocks
_CLOSE: Final = 1.0  # time before the deadline at which the process ends, s
_TURN: Final = 1.0  # time after which the exact driver reports, s
_NICE: Final = 5  # the search goes first where it uses every core


class ProofStatus(NamedTuple):
    """What the process has proven, scene units, and the strongest layout (m,) it knows, with its lower bound."""

    bound: float = math.inf
    by: str = ""
    labels: Bits | None = None
    low: float = -math.inf
    done: bool = False


class ProofBeside:
    """Proof in a process of its own; `status` is what it has sent."""

    def __init__(self, space: SearchSpace, model: SolveOptions, blocks: BlockSpace | None, until: Deadline) -> None:
        self.status = ProofStatus()
        self._pool, self._until = Pool(1), until
        work = cloudpickle.dumps((space, model, blocks))
        self._future: Future[ProofStatus] | None = self._pool.submit(_begin_proof, work, self._left)
        self.first = True  # while the bound at the root may still come

    @classmethod
    def of(cls, space: SearchSpace, model: SolveOptions, deadline: Deadline) -> ProofBeside | None:
        """Start the process for a search; None where nothing can be proven in its time."""
        seconds = deadline.remaining()
        if not LEAST_SECONDS <= seconds < math.inf or space.void is not None:
            return None
        if not model.supports_bounds_over_labellings:
            return None
        return cls(space, model, _blocks(space, deadline), deadline.earlier(_CLOSE))

    @property
    def _left(self) -> float:
        return self._until.remaining()

    def poll(self, best: Bits | None, seconds: float = 0.0) -> ProofStatus:
        """Return what is proven, after waiting for the next message up to some seconds; best (m,): of the search."""
        future = self._future
        if future is None or not done_in([future], seconds):
            return self.status
        self._future, self.first = None, False
        try:
            self.status = future.result()
            if not self.status.done and self._left > _TURN:
                self._future = self._pool.submit(_continue_proof, best, self._left)
        except Exception as error:
            if not is_lost(error):  # a process that is killed costs its proof alone
                raise
        return self.status

    def close(self) -> None:
        """End the process; what has not come is lost."""
        self._future = None
        self._pool.close()


def _blocks(space: SearchSpace, deadline: Deadline) -> BlockSpace | None:
    """List the possible blocks in a share of the time; None where their program does not exist or takes too much."""
    if not all(applies_to(LimitAnalysis(case)) for case in space.assembly.by_case):
        return None
    with Deadline(_LISTED_WITHIN * deadline.remaining()).enforced():
        blocks = listed_blocks(space)
    if blocks is None or not len(blocks):
        return None
    sides = sides_of(space, blocks)
    if sides * _SIDE_SECONDS > deadline.remaining() or sides * _SIDE_MEMORY > _MEMORY_SHARE * memory_limit():
        return None
    return BlockSpace(space, blocks)


class _Proof:
    current: _Proof | None = None

    def __init__(self, space: SearchSpace, model: SolveOptions, blocks: BlockSpace | None) -> None:
        self.space, self.model, self.blocks = space, model, blocks
        self.status = ProofStatus()
        self.driver: Exact | None = None
        self.search_best: Bits | None = None
        self._thread: threading.Thread | None = None

    def at_root(self, deadline: Deadline) -> ProofStatus:
        """Solve the block relaxation of all possible blocks; below normal forces that no stronger layout exceeds."""
        by_faces = relaxation_of(self.space.assembly)
        if self.blocks is None or by_faces is None:
            return self.status
        most = min(by_faces.bound(self.space.fixed, self.space.candidates), self.status.bound / by_faces.unit)
        least = max(self.status.low / by_faces.unit, 0.0)
        if least > 0.0 and _SIDE_SECONDS * sides_of(self.space, self.blocks.blocks) > _CAPPED * deadline.remaining():
            return self.status
        caps = self._caps(by_faces, least, most, deadline) if least > 0.0 else []
        if caps is not None:
            relaxation = self.blocks.relaxation((), deadline.remaining(), caps)
            every = np.ones(len(self.blocks.blocks), dtype=bool)
            bound = float(relaxation.bound_all([(every, 0.0, most)])[0].bound * by_faces.unit)
            if math.isfinite(bound) and bound < self.status.bound:
                self.status = self.status._replace(bound=max(bound, self.status.low), by="block by block")
        return self.status

    def _caps(self, by_faces: AnyRelaxation, least: float, most: float, deadline: Deadline) -> list[Floats] | None:
        """Bound the normal forces (m,) of layouts from `least` to `most`, for each case; None where that gives none."""
        limits = []
        for case, required in zip(self.space.assembly.by_case, self.space.assembly.required, strict=True):
            try:
                caps = NormalCaps(LimitAnalysis(case), self.space.fixed, self.space.candidates)
            except TypeError:
                return None
            unit = caps.unit / (float(required) if self.space.assembly.cases else 1.0)
            caps.tighten(
                least * by_faces.unit / unit * (1.0 - 1e-12), most * by_faces.unit / unit * (1.0 + 1e-12), deadline
            )
            limits.append(caps.caps)
        return limits

    def prove(self, deadline: Deadline) -> None:
        """Run the exact driver until it ends or the deadline passes, in a thread that `_continue_proof` looks at."""
        driver = self.driver = Exact(self.space)
        evaluator = evaluator_of(self.space.assembly, EvaluatorSettings(self.model))
        standing = Standing(self.space.assembly, self.model)

        def evaluate(labellings: Bits) -> tuple[Bits, list[Evaluation]]:
            """Evaluate labellings (k, m) as far as time allows, and keep the strongest."""
            evaluations = evaluator.evaluate_all(labellings, deadline=deadline)
            labellings = labellings[: len(evaluations)]
            judged = standing.told(labellings, evaluations)
            for labels, evaluation in zip(labellings, judged, strict=True):
                if evaluation.status is Status.COLLAPSE and evaluation.low > self.status.low:
                    self.status = self.status._replace(labels=labels.copy(), low=evaluation.low)
            return labellings, judged

        with suppress(DeadlinePassed), deadline.enforced():
            best, self.search_best = self.search_best, None
            if best is not None:
                evaluate(best[None])
                self.at_root(deadline)
            self.blocks = None  # its memory goes to the driver
            driver.start(deadline, lambda: None)
            while len(proposed := driver.ask()):
                driver.tell(*evaluate(proposed))
                best, self.search_best = self.search_best, None
                if best is not None:
                    driver.restore(*evaluate(best[None]))

    def poll(self, best: Bits | None, seconds: float) -> ProofStatus:
        """Return what is known after some seconds, or once the exact driver has ended; best (m,): of the search."""
        self.search_best = best
        if self._thread is None:
            deadline = Deadline(seconds)
            self._thread = threading.Thread(target=self.prove, args=(deadline,), daemon=True)
            self._thread.start()
        self._thread.join(min(_TURN, seconds))
        status, done = self.status, not self._thread.is_alive()
        bound = None if self.driver is None else self.driver.bound
        if self.driver is not None and bound is not None and bound < status.bound:
            status = status._replace(bound=bound, by=self.driver.name)
        return status._replace(done=done)


@one_thread()
def _begin_proof(work: bytes, seconds: float) -> ProofStatus:
    os.nice(_NICE)
    _Proof.current = _Proof(*pickle.loads(work))
    return _Proof.current.at_root(Deadline(seconds))


@one_thread()
def _continue_proof(best: Bits | None, seconds: float) -> ProofStatus:
    """Go on with the proof for a while, of the seconds that are left."""
    if _Proof.current is None:
        raise RuntimeError("the process has not begun")
    return _Proof.current.poll(best, seconds)
