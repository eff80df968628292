"""Evaluate one batch of labellings in a worker, by the evaluator of its thread."""

from __future__ import annotations

import hashlib
import os
import pickle
import signal
import threading
from dataclasses import dataclass
from typing import Final

import cloudpickle

from jld_core._version import __version__
from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.batch import chosen
from jld_core.deadline import Deadline, DeadlinePassed
from jld_core.errors import ParameterError
from jld_core.threads import one_thread
from jld_explore.evaluation.cases import evaluator_of
from jld_explore.evaluation.evaluation import Evaluation
from jld_explore.evaluation.protocol import EvaluatorSettings, LabellingEvaluator, MakeEvaluator, SharedEvaluator

_of_thread = threading.local()  # An evaluator is for one thread, but workers of a cluster may run several threads.

_of_process: Final[
    dict[str, SharedEvaluator]
] = {}  # Last evaluator of this process by digest; other threads make twins of it.


@dataclass(frozen=True)
class WorkerSpec:
    """Pickled data from which a worker makes its evaluator.

    content: pickle of the function that makes the evaluator, the assembly and the settings. digest: SHA-256 of the
    content and the name of the batch solver. parent: process id of the process that made this specification. version:
    version of jld that made it; a worker of a cluster may have another one.
    """

    content: bytes
    digest: str
    parent: int
    version: str = __version__

    @classmethod
    def of(cls, assembly: Assembly, settings: EvaluatorSettings, make: MakeEvaluator = evaluator_of) -> WorkerSpec:
        """Make the specification that workers need to evaluate labellings of an assembly.

        make: function of the assembly and the settings that returns an evaluator; it is pickled with both.
        """
        content = cloudpickle.dumps((make, assembly, settings))  # pickle refuses functions defined in a program
        # Include the batch solver in the digest, since results depend on it.
        kernel = (chosen() or "none").encode()
        return cls(content, hashlib.sha256(kernel + content).hexdigest(), os.getpid())

    def evaluator(self) -> LabellingEvaluator:
        """Return the evaluator of this thread, made at the first call and kept.

        Another specification replaces it. If another thread of the process has one that can be shared, a twin is made.

        Raises InputError if the worker has another version of jld.
        """
        if getattr(_of_thread, "digest", None) != self.digest:
            other = _of_process.get(self.digest)
            if other is None:
                if self.version != __version__:
                    raise ParameterError(
                        "cluster", f"a worker has jld {__version__}", f"jld {self.version} on every one"
                    )
                make, assembly, settings = pickle.loads(self.content)
                evaluator = make(assembly, settings)
                _of_process.clear()
                if isinstance(evaluator, SharedEvaluator):
                    _of_process[self.digest] = evaluator
            else:
                evaluator = other.twin()
            _of_thread.evaluator, _of_thread.digest = evaluator, self.digest
        found: LabellingEvaluator = _of_thread.evaluator
        return found

    @property
    def settles_nearly_all(self) -> bool:
        """Return True if the batch solver settles nearly all labellings.

        See `SharedEvaluator`.
        """
        evaluator = self.evaluator()
        return isinstance(evaluator, SharedEvaluator) and evaluator.settles_nearly_all


@one_thread()
def evaluate_batch(
    spec: WorkerSpec,
    number: int,
    labellings: Bits,
    deadline: Deadline | None = None,
    thresholds: Floats | None = None,
    required: bool = False,
) -> tuple[int, list[Evaluation]]:
    """Evaluate one batch in this process with the evaluator of this thread.

    spec: specification of the evaluator. labellings: (k, m) True = dry. deadline: time after which no further labelling
    is begun. thresholds: (k,) pruning thresholds (see `LabellingEvaluator.evaluate`). required: evaluate all labellings
    regardless of the deadline. The deadline then limits only the search without dilation, whose result so far is used.
    If nothing is known by the deadline, the batch is evaluated without a limit. Result: number: number of the batch;
    evaluations: evaluations of all k labellings, or of those finished by the deadline.
    """
    if os.getpid() != spec.parent and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # The parent process handles Ctrl-C.
    evaluator = spec.evaluator()
    if required and deadline is not None:
        try:
            # Use the results known when the deadline passes.
            with deadline.enforced():
                return number, evaluator.evaluate_all(labellings, thresholds)
        except DeadlinePassed:
            deadline = None
    return number, evaluator.evaluate_all(labellings, thresholds, deadline)
