"""Labelling → Evaluation, in workers, with records on disk.

- `BOUND`: settled by an upper bound alone
- `CERTIFICATE`: settled by what other solves prove
- `FAILED`: an evaluation that broke down
- `HANG`: seconds without any result after which workers are taken to hang
- `ORDER`: statuses, the best first
- `RECORDS_FILE`: name of the file of records
- `Bounds`: what the pool knows of labellings
- `CertificateEvaluator`: evaluates with a pool of certificates
- `Envelope`: the largest λ known for what counts as well or better
- `Evaluating`: what a study asks for evaluations
- `Evaluation`: what is known of one labelling
- `Evaluator`: evaluates labellings of one assembly
- `EvaluatorSettings`: what an evaluator is asked for
- `ForceMethod`: both sides of λ at a vertex
- `Forces`: a certificate from below
- `IncumbentFront`: the largest λ known for each count
- `VoidCellsEvaluator`: evaluates labellings of an assembly with a sink (`space.void`), each on the structure that …
- `MakeEvaluator`: makes what evaluates in a worker
- `Mechanism`: a certificate from above
- `Pool`: certificates that are worth their place
- `Proofs`: what one solve leaves behind
- `RecordedEvaluator`: workers with a record
- `Records`: evaluations, proofs and conflicts on disk
- `PoolWorker`: a process that is given task after task
- `WorkerPool`: as many of them as there are jobs, or workers of a cluster
- `Sent`: labellings on their way
- `Vertex`: what was found at a vertex
- `WorkerSpec`: what a worker needs
- `Workers`: a pool of processes
- `aims`: the number to be made large
- `batch_size`: labellings per task
- `client_of_cluster`: the client of the cluster that is used
- `raise_deferred`: raise an error, or after what is undisturbed
- `evaluator_of`: what evaluates labellings of an assembly
- `front_counts`: counts of the scene's front
- `is_small`: whether a solve takes less than to send it
- `load_factors`: λ of each record
- `may_meet`: whether a labelling is not proven to carry less than is required
- `meets`: whether it carries what is required
- `objectives`: what is minimised
- `on_cluster`: workers of a scheduler, on other machines
- `places`: place of each status
- `proofs_of`: what a finished solve proves of others
- `settled`: how each record was settled
- `standing`: what sorts evaluations
- `statuses`: status of each record
- `worth`: what a driver goes by
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
from jld_explore.evaluation.worker_pool import PoolWorker, WorkerPool
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
