"""Evaluate labellings in worker processes and record the results on disk.

- `BOUND`: value of `Evaluation.settled` for a labelling settled by its upper bound alone
- `FAILED`: evaluation of a labelling whose worker died or hung twice
- `HANG`: seconds without any result after which workers count as hung
- `ORDER`: statuses, best first
- `RECORDS_FILE`: name of the SQLite file of records
- `CellEvaluator`: evaluator of labellings of the joint grid on finer cells
- `Envelope`: largest λ known among labellings with equal or better counts
- `Evaluation`: result of evaluating one labelling
- `Evaluator`: evaluator of labellings of one assembly under one load
- `EvaluatorSettings`: settings of an evaluator
- `FieldEvaluator`: evaluator of labellings by fields on the coarsest mesh
- `FieldRace`: race of layouts whose blocks crack anywhere
- `IncumbentFront`: largest λ known for each combination of front counts
- `MakeCellEvaluator`: maker of evaluators on finer cells
- `MakeEvaluator`: type of a function that makes the evaluator of a worker
- `OwnObjective`: type of a function of the user that replaces λ as the objective
- `OwnObjectiveEvaluator`: evaluator whose load factors are the values of such a function
- `PoolWorker`: process or cluster worker that keeps state between its tasks
- `RaceResult`: bounds of raced layouts
- `RecordedEvaluator`: evaluator that runs workers and writes a record
- `Records`: evaluations and conflicts on disk
- `Sent`: labellings under evaluation
- `VoidCellsEvaluator`: evaluator of labellings that leave cells out (`space.void`)
- `WorkerPool`: pool of one `PoolWorker` per job or per worker of a cluster
- `WorkerSpec`: pickled data from which a worker makes its evaluator
- `Workers`: pool of threads, processes or cluster workers that evaluate batches
- `aims`: compute the objective that a driver maximises
- `batch_size`: compute the number of labellings per task
- `client_of_cluster`: return the dask client in use
- `evaluator_of`: make the evaluator of an assembly
- `field_evaluation`: return the evaluation of a labelling from its bounds by fields
- `front_counts`: compute the counts of the scene's front
- `is_lost`: return whether a task failed because its worker died or left
- `load_factors`: return λ of each row of a record
- `may_meet`: return whether a labelling can still reach the required load factor
- `meets`: return whether a labelling provably reaches the required load factor
- `objectives`: compute the objectives that a driver minimises
- `on_cluster`: use the workers of a dask scheduler within a context
- `places`: return the rank of each evaluation's status
- `raise_deferred`: raise an error, or defer it to the end of a protected section
- `settled`: return how each row of a record was settled
- `standing`: return the sort key of an evaluation
- `statuses`: return the status of each row of a record
- `worth`: return the number by which a driver compares an evaluation
"""

from __future__ import annotations

from jld_explore.evaluation.cases import evaluator_of
from jld_explore.evaluation.cluster import client_of_cluster, on_cluster
from jld_explore.evaluation.deferred_signals import raise_deferred
from jld_explore.evaluation.evaluation import BOUND, FAILED, Evaluation
from jld_explore.evaluation.evaluator import Evaluator, EvaluatorSettings
from jld_explore.evaluation.field_evaluator import (
    CellEvaluator,
    FieldEvaluator,
    MakeCellEvaluator,
    field_evaluation,
)
from jld_explore.evaluation.field_race import FieldRace, RaceResult
from jld_explore.evaluation.own_objective import OwnObjective, OwnObjectiveEvaluator
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
from jld_explore.evaluation.recorded import RecordedEvaluator, Sent
from jld_explore.evaluation.records import RECORDS_FILE, Records
from jld_explore.evaluation.rows import load_factors, settled, statuses
from jld_explore.evaluation.void_cells import VoidCellsEvaluator
from jld_explore.evaluation.worker_pool import PoolWorker, WorkerPool, is_lost
from jld_explore.evaluation.workers import HANG, MakeEvaluator, Workers, WorkerSpec, batch_size

__all__ = [
    "BOUND",
    "FAILED",
    "HANG",
    "ORDER",
    "RECORDS_FILE",
    "CellEvaluator",
    "Envelope",
    "Evaluation",
    "Evaluator",
    "EvaluatorSettings",
    "FieldEvaluator",
    "FieldRace",
    "IncumbentFront",
    "MakeCellEvaluator",
    "MakeEvaluator",
    "OwnObjective",
    "OwnObjectiveEvaluator",
    "PoolWorker",
    "RaceResult",
    "RecordedEvaluator",
    "Records",
    "Sent",
    "VoidCellsEvaluator",
    "WorkerPool",
    "WorkerSpec",
    "Workers",
    "aims",
    "batch_size",
    "client_of_cluster",
    "evaluator_of",
    "field_evaluation",
    "front_counts",
    "is_lost",
    "load_factors",
    "may_meet",
    "meets",
    "objectives",
    "on_cluster",
    "places",
    "raise_deferred",
    "settled",
    "standing",
    "statuses",
    "worth",
]
