"""A study's trials on a Dask cluster."""

import time
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from typing import Any, Final

from pipeline.io.input_file import describe_error
from pipeline.run.job import WORKER_DIED, Job, Outcome, process_job, stored_outcome

POLL_S: Final = 10.0
"""How often to ask for workers and finished trials: short compared with a trial, long compared with
the network's delay."""
MAX_WITHOUT_WORKERS_S: Final = 300.0
"""A queue needs a minute or two to replace a worker; after this long it will not."""


def on_cluster(todo: list[Job], scheduler: str) -> Iterator[Outcome]:
    """Process trials on a Dask cluster, whose workers may start late and may be lost.

    Parameters
    ----------
    todo
        The trials, in this order.
    scheduler
        Address of the cluster's scheduler.

    Yields
    ------
    Outcome
        As trials finish.

    Raises
    ------
    ValueError
        If Dask is not installed.
    OSError
        If the scheduler does not answer.

    Notes
    -----
    No more trials are sent than the workers have threads, because when a worker dies, Dask blames
    every trial that waits for it. A cluster that has no workers yet is waited for. One that has
    lost its scheduler, or all workers for ``MAX_WITHOUT_WORKERS_S``, is abandoned; the trials that
    are left fail with that reason.
    """
    try:
        dask: Any = import_module("dask.distributed")
    except ImportError as missing:
        raise ValueError(
            "--scheduler needs Dask: pip install 'hbm-residuals[cluster]'"
        ) from missing
    waiting, sent = todo[::-1], dict[Any, Job]()
    with dask.Client(scheduler, timeout="10s") as client:
        for threads in _worker_threads(client):
            while waiting and len(sent) < max(1, threads):
                job = waiting.pop()
                sent[client.submit(process_job, job, pure=False)] = job
            if not sent:
                return
            with suppress(TimeoutError, dask.CancelledError):
                dask.wait(list(sent), timeout=POLL_S, return_when="FIRST_COMPLETED")
            for future in [future for future in sent if future.status != "pending"]:
                yield _outcome(future, sent.pop(future), dask)
    for job in [*sent.values(), *waiting]:
        yield Outcome(job, "failed", "the cluster is gone; run it again")


def _worker_threads(client: Any) -> Iterator[int]:
    """Count the workers' threads again and again, until the cluster is abandoned."""
    last_worker_at = float("inf")
    while time.monotonic() - last_worker_at < MAX_WITHOUT_WORKERS_S:
        try:
            threads = sum(client.nthreads().values())
        except OSError:
            return
        last_worker_at = time.monotonic() if threads else last_worker_at
        yield threads


def _outcome(future: Any, job: Job, dask: Any) -> Outcome:
    try:
        outcome: Outcome = future.result(timeout=POLL_S)
    except dask.KilledWorker:
        return Outcome(job, "failed", WORKER_DIED)
    except Exception as error:
        done = stored_outcome(job)
        return done or Outcome(job, "failed", f"on the cluster: {describe_error(error)}")
    return outcome
