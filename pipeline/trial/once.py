"""Results of pure functions, computed once where several ways of processing need the same."""

import copyreg
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from types import MappingProxyType
from typing import ParamSpec, TypeVar

import joblib

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
_results: ContextVar[dict[str, object] | None] = ContextVar("results", default=None)


def _view(content: dict[object, object]) -> MappingProxyType[object, object]:
    return MappingProxyType(content)


copyreg.pickle(MappingProxyType, lambda view: (_view, (dict(view),)))  # to be hashed


@contextmanager
def computing_once() -> Iterator[None]:
    """Keep the results of `once` until the block ends: variants of a trial share what is equal."""
    token = _results.set({})
    try:
        yield
    finally:
        _results.reset(token)


def once(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Let a pure function give the same result for equal arguments within `computing_once`.

    Arguments are compared by their content.
    """

    @wraps(function)
    def result(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        results = _results.get()
        if results is None:
            return function(*args, **kwargs)
        key = joblib.hash((function.__module__, function.__qualname__, args, kwargs))
        if key not in results:
            results[key] = function(*args, **kwargs)
        return results[key]  # type: ignore[return-value]

    return result
