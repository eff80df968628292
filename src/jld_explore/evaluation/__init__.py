"""Labelling → Evaluation, in workers, with records on disk."""

from __future__ import annotations

from jld_explore.evaluation.certificates import Bounds, Forces, Mechanism, Pool, Proofs, proofs_of
from jld_explore.evaluation.evaluation import BOUND, CERTIFICATE, FAILED, Evaluation
from jld_explore.evaluation.evaluator import Evaluator, EvaluatorSettings, kernel_settles
from jld_explore.evaluation.force_method import ForceMethod, Vertex
from jld_explore.evaluation.pruning import IncumbentFront
from jld_explore.evaluation.ranking import ORDER, front_counts, objectives, places, standing, worth
from jld_explore.evaluation.records import STORE_FILE, Store, record_type, settled, statuses
from jld_explore.evaluation.with_certificates import CERTIFICATES_FILE, Archive, CertificateEvaluator
from jld_explore.evaluation.workers import Run, Workers, WorkerSpec, batch_size

__all__ = [
    "BOUND",
    "CERTIFICATE",
    "CERTIFICATES_FILE",
    "FAILED",
    "ORDER",
    "STORE_FILE",
    "Archive",
    "Bounds",
    "CertificateEvaluator",
    "Evaluation",
    "Evaluator",
    "EvaluatorSettings",
    "ForceMethod",
    "Forces",
    "IncumbentFront",
    "Mechanism",
    "Pool",
    "Proofs",
    "Run",
    "Store",
    "Vertex",
    "WorkerSpec",
    "Workers",
    "batch_size",
    "front_counts",
    "kernel_settles",
    "objectives",
    "places",
    "proofs_of",
    "record_type",
    "settled",
    "standing",
    "statuses",
    "worth",
]
