"""Evaluations on the workers of a dask scheduler, on as many machines as have joined it.

joblib sends the same tasks there as to processes of its own (`workers`). A worker that dies, or leaves, gives its tasks
back to the scheduler, which sends them to others; one that joins is given some. What is finished is on record here.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import joblib

from jld_core import __version__
from jld_core.errors import InputError

_ANSWER: Final = 10.0
"""Seconds in which a scheduler has to answer."""

_WORKERS: Final = 60.0
"""Seconds in which a first worker has to be there, and in which another has to be where all have left."""


@contextmanager
def on_cluster(url: str | None) -> Iterator[None]:
    """Have `Workers` that are made inside use the workers of a scheduler; without a URL nothing changes.

    url: of a dask scheduler, tcp://host:8786. Raises InputError where the extra is not installed, where no scheduler
    answers, and where it has no workers.
    """
    if url is None:
        yield
        return
    try:
        import distributed  # an extra, and slow to import
    except ImportError:
        raise InputError("--cluster", "distributed is not installed", 'the extra: pip install "jld[cluster]"') from None
    library: Any = distributed  # without types of its own
    try:
        client = library.Client(url, timeout=_ANSWER)
    except (OSError, ValueError, TypeError) as error:
        problem = f"no scheduler answers at {url!r} ({type(error).__name__})"
        raise InputError("--cluster", problem, "the address of a running one, tcp://host:8786") from None
    try:
        try:
            client.wait_for_workers(1, timeout=_WORKERS)
        except TimeoutError:
            problem = f"the scheduler at {url!r} has no workers"
            raise InputError("--cluster", problem, f"at least one within {_WORKERS:g} s: dask worker URL") from None
        _require_version(client)
        with joblib.parallel_config(backend="dask", wait_for_workers_timeout=_WORKERS):
            yield
    finally:
        client.close()


def _require_version(client: Any) -> None:
    """Raise InputError where a worker has another version of this program, or none: its λ may be another."""
    # a lambda is sent as code, so that a version that knows nothing of this question answers it as well
    found = client.run(lambda: str(__import__("jld_core").__version__), on_error="return")
    for worker, version in sorted(found.items()):
        if version != __version__:
            has = f"jld {version}" if isinstance(version, str) else f"no jld ({type(version).__name__})"
            raise InputError("--cluster", f"the worker {worker} has {has}", f"jld {__version__} on every worker")


def client_of_cluster() -> Any | None:
    """The client of the cluster whose workers are used, None outside `on_cluster` with a URL."""
    return getattr(joblib.parallel.get_active_backend()[0], "client", None)
