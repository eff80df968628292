"""Evaluate on the workers of a dask scheduler, on all machines that have joined it.

joblib sends the cluster the same tasks as local processes (`workers`).
The scheduler gives the tasks of a worker that dies or leaves to other workers, and gives tasks to new workers.
Finished evaluations are recorded on the machine that runs the study.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import joblib

from jld_core._version import __version__
from jld_core.errors import ParameterError

_ANSWER: Final = 10.0  # seconds in which a scheduler must answer

_WORKERS: Final = 60.0  # seconds in which a first worker must join, and a new one after all workers have left


@contextmanager
def on_cluster(url: str | None) -> Iterator[None]:
    """Use the workers of a dask scheduler for all `Workers` made within this context.

    url: address of the scheduler, for example tcp://host:8786. None changes nothing. Yields: the context has no value.
    Raises InputError if the extra `cluster` is not installed, no scheduler answers, it has no workers, or their version
    differs.
    """
    if url is None:
        yield
        return
    try:
        import distributed  # An optional dependency that is slow to import.
    except ImportError:
        raise ParameterError(
            "cluster", "distributed is not installed", 'the extra: pip install "jld[cluster]"'
        ) from None
    library: Any = distributed  # The library has no type hints.
    try:
        client = library.Client(url, timeout=_ANSWER)
    except (OSError, ValueError, TypeError) as error:
        problem = f"no scheduler answers at {url!r} ({type(error).__name__})"
        raise ParameterError("cluster", problem, "the address of a running one, tcp://host:8786") from None
    try:
        try:
            client.wait_for_workers(1, timeout=_WORKERS)
        except TimeoutError:
            problem = f"the scheduler at {url!r} has no workers"
            raise ParameterError("cluster", problem, f"at least one within {_WORKERS:g} s: dask worker URL") from None
        _require_version(client)
        with joblib.parallel_config(backend="dask", wait_for_workers_timeout=_WORKERS):
            yield
    finally:
        client.close()


def _require_version(client: Any) -> None:
    """Raise InputError if a worker runs another version of jld, whose λ may differ."""
    # A lambda is sent as code, so that workers with any version of jld can answer.
    found = client.run(lambda: str(__import__("jld_core").__version__), on_error="return")
    for worker, version in sorted(found.items()):
        if version != __version__:
            has = f"jld {version}" if isinstance(version, str) else f"no jld ({type(version).__name__})"
            raise ParameterError("cluster", f"the worker {worker} has {has}", f"jld {__version__} on every worker")


def client_of_cluster() -> Any | None:
    """Return the dask client in use, None outside `on_cluster` with a URL."""
    return getattr(joblib.parallel.get_active_backend()[0], "client", None)
