"""Evaluate labellings in worker processes and record the results on disk.

- `BOUND`: value of `Evaluation.settled` for a labelling settled by its upper bound alone
- `CERTIFICATE`: value of `Evaluation.settled` for a labelling settled by proofs of other solves
- `FAILED`: evaluation of a labelling whose worker died or hung twice
- `HANG`: seconds without any result after which workers count as hung
- `ORDER`: statuses, best first
- `RECORDS_FILE`: name of the SQLite file of records
- `Bounds`: lower and upper bounds on λ of several labellings
- `CertificateEvaluator`: evaluator that uses bounds from past solves before it solves
- `Envelope`: largest λ known among labellings with equal or better counts
- `Evaluating`: protocol of an evaluator as a study uses it
- `Evaluation`: result of evaluating one labelling
- `Evaluator`: evaluator of labellings of one assembly under one load
- `EvaluatorSettings`: settings of an evaluator
- `ForceMethod`: linear program (force method) that bounds λ from both sides at a vertex
- `Forces`: statically admissible forces as a lower bound on λ for many labellings
- `IncumbentFront`: largest λ known for each combination of front counts
- `MakeEvaluator`: type of a function that makes the evaluator of a worker
- `Mechanism`: mechanism as an upper bound on λ for many labellings
- `Pool`: bounds from past solves, limited in number
- `PoolWorker`: process or cluster worker that keeps state between its tasks
- `Proofs`: lower and upper bounds that one solve proves for other labellings
- `RecordedEvaluator`: evaluator that runs workers and writes a record
- `Records`: evaluations, proofs and conflicts on disk
- `Sent`: labellings under evaluation
- `Vertex`: result of the force method for one labelling
- `VoidCellsEvaluator`: evaluator of labellings that leave cells out (`space.void`)
- `WorkerPool`: pool of one `PoolWorker` per job or per worker of a cluster
- `WorkerSpec`: pickled data from which a worker makes its evaluator
- `Workers`: pool of threads, processes or cluster workers that evaluate batches
- `aims`: compute the objective that a driver maximises
- `batch_size`: compute the number of labellings per task
- `client_of_cluster`: return the dask client in use
- `evaluator_of`: make the evaluator of an assembly
- `front_counts`: compute the counts of the scene's front
- `is_lost`: return whether a task failed because its worker died or left
- `is_small`: return whether solving a labelling is faster than sending it to a worker
- `load_factors`: return λ of each row of a record
- `may_meet`: return whether a labelling can still reach the required load factor
- `meets`: return whether a labelling provably reaches the required load factor
- `objectives`: compute the objectives that a driver minimises
- `on_cluster`: use the workers of a dask scheduler within a context
- `places`: return the rank of each evaluation's status
- `proofs_of`: return the bounds that a finished limit analysis proves for other labellings
- `raise_deferred`: raise an error, or defer it to the end of a protected section
- `settled`: return how each row of a record was settled
- `standing`: return the sort key of an evaluation
- `statuses`: return the status of each row of a record
- `worth`: return the number by which a driver compares an evaluation
"""

from __future__ import annotations

from jld_explore.evaluation.cases import evaluator_of
from jld_explore.evaluation.certificates import Bounds, Forces, Mechanism, Pool, Proofs, proofs_of
from jld_explore.evaluation.cluster import client_of_cluster, on_cluster
from jld_explore.evaluation.deferred_signals import raise_deferred
from jld_explore.evaluation.evaluation import BOUND, CERTIFICATE, FAILED, Evaluation
from jld_explore.evaluation.evaluator import Evaluator, EvaluatorSettings
from jld_explore.evaluation.force_method import ForceMethod, Vertex
from jld_explore.evaluation.pruning import IncumbentFront
from jld_explore.evaluation.ranking import (
    ORDER,
    Envelope,
    aims,
    front_counts,
    may_meet,
    meets,
    objectives,
    places,
    standing,
    worth,
)
from jld_explore.evaluation.recorded import Evaluating, RecordedEvaluator, Sent
from jld_explore.evaluation.records import RECORDS_FILE, Records
from jld_explore.evaluation.rows import load_factors, settled, statuses
from jld_explore.evaluation.void_cells import VoidCellsEvaluator
from jld_explore.evaluation.with_certificates import CertificateEvaluator, is_small
from jld_explore.evaluation.worker_pool import PoolWorker, WorkerPool, is_lost
from jld_explore.evaluation.workers import HANG, MakeEvaluator, Workers, WorkerSpec, batch_size

__all__ = [
    "BOUND",
    "CERTIFICATE",
    "FAILED",
    "HANG",
    "ORDER",
    "RECORDS_FILE",
    "Bounds",
    "CertificateEvaluator",
    "Envelope",
    "Evaluating",
    "Evaluation",
    "Evaluator",
    "EvaluatorSettings",
    "ForceMethod",
    "Forces",
    "IncumbentFront",
    "MakeEvaluator",
    "Mechanism",
    "Pool",
    "PoolWorker",
    "Proofs",
    "RecordedEvaluator",
    "Records",
    "Sent",
    "Vertex",
    "VoidCellsEvaluator",
    "WorkerPool",
    "WorkerSpec",
    "Workers",
    "aims",
    "batch_size",
    "client_of_cluster",
    "evaluator_of",
    "front_counts",
    "is_lost",
    "is_small",
    "load_factors",
    "may_meet",
    "meets",
    "objectives",
    "on_cluster",
    "places",
    "proofs_of",
    "raise_deferred",
    "settled",
    "standing",
    "statuses",
    "worth",
]
