"""Processes that work in parallel and end with the one that started them."""

import atexit
import gc
import multiprocessing
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, closing, contextmanager
from functools import cache
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any, Final

from threadpoolctl import threadpool_limits

from pipeline.io.write import remove_leftovers, remove_unfinished

MIN_TASKS: Final = 5
"""For each process, which takes as long to start as to work on so many."""
Task = tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any]]
"""What `joblib.delayed` makes of a call."""


def in_processes(
    tasks: Iterable[Task],
    workers: int | None = None,
    written: Iterable[Path] = (),
    *,
    ordered: bool = False,
    least: int = MIN_TASKS,
) -> Iterator[Any]:
    """Work on tasks in processes of their own; with one worker, in this process.

    Parameters
    ----------
    tasks
        Calls wrapped by `joblib.delayed`.
    workers, least
        How many at a time; by default as many as there are processors, each for ``least`` tasks or
        more.
    written
        Folders into which they write; files that stopped processes left there are removed.
    ordered
        Whether results come in the order of the tasks; by default as tasks finish.

    Yields
    ------
    Any
        The result of each task.

    Raises
    ------
    concurrent.futures.process.BrokenProcessPool
        If a process dies.

    Notes
    -----
    Where this process is interrupted, its workers are killed at once; they see no interrupt
    themselves, although a terminal sends it to all. Where it is killed, they end within a second.

    Linear algebra uses one thread, in other processes and in this one: several would sum in another
    order, and results would differ in their last digits with the number of workers.
    """
    from joblib import Parallel, cpu_count  # of one trial it is not needed

    if workers is None:
        tasks = [*tasks]
        workers = max(1, min(cpu_count(), len(tasks) // least))
    if workers == 1:
        with one_thread():
            for function, arguments, options in tasks:
                yield function(*arguments, **options)
        return
    parallel = Parallel(
        workers,
        backend="loky",
        inner_max_num_threads=1,
        batch_size=1,
        return_as="generator" if ordered else "generator_unordered",
        initializer=_begin,
    )
    _ignore_failing_manager()  # where this process is stopped, its workers are killed
    with warnings.catch_warnings(), ExitStack() as started:
        for folder in written:
            started.callback(remove_leftovers, folder)
        # a process whose memory has grown is replaced; where this one is stopped, tasks are left
        warnings.filterwarnings("ignore", "A worker stopped|.* tasks", UserWarning)
        with _requests_held(), _interrupts_blocked():
            results = started.enter_context(closing(parallel(tasks)))
        yield from results


@cache
def _ignore_failing_manager() -> None:
    """Print no traceback of loky's thread that manages workers, some of which are killed; once."""
    report = threading.excepthook

    def of_others(failure: threading.ExceptHookArgs) -> None:
        # so loky names the thread that manages workers
        manager = "ExecutorManagerThread"
        if failure.thread is None or not failure.thread.name.startswith(manager):
            report(failure)

    threading.excepthook = of_others


@contextmanager
def recorded_requests() -> Iterator[list[int]]:
    """Give a list that requests to stop append their signals to; only a kill interrupts the work.

    An exception could come while an earlier one is handled, when nothing would wait for the end. A
    signal that this thread blocks reaches its handler by way of another thread, so handlers are
    replaced.
    """
    requests: list[int] = []
    before = {
        number: signal.signal(number, lambda number, frame: requests.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield requests
    finally:
        for number, handler in before.items():
            signal.signal(number, handler or signal.SIG_DFL)  # of no Python code, it is unknown


@contextmanager
def _requests_held() -> Iterator[None]:
    """Hold requests to stop back until all is done; then the first of them acts."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    requests: list[int] = []
    try:
        with recorded_requests() as requests:
            yield
    finally:
        if requests:
            signal.raise_signal(requests[0])


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block interrupts, as processes that start here inherit it; Windows cannot."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # where it has to be started, that ends the block
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def one_thread() -> Any:
    """Limit linear algebra to one thread until what this gives is left."""
    import scipy.linalg  # noqa: F401 - only what is loaded can be limited

    return threadpool_limits(1)


def _begin() -> None:
    """Prepare a process that works on tasks.

    It ignores interrupts, uses one thread for linear algebra, and ends at once when
    there is nothing left to do, or when the process that started it has ended.
    """
    gc.set_threshold(50_000)  # as in `pipeline.cli.app.main`
    atexit.register(gc.freeze)
    one_thread()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_wait_for_end_of_parent, daemon=True).start()


def _wait_for_end_of_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    if os.name == "nt":
        parent.join()
    else:
        while os.getppid() == parent.pid:
            time.sleep(0.5)
    remove_unfinished()
    os._exit(1)
