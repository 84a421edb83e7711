"""Which engine runs: Pinocchio where it can be imported, else the kernels, or the stated one."""

from functools import cache
from importlib.metadata import version

from hbm.engines.engine import ENGINES, Engine, EngineName


def choose_engine(stated: EngineName | None = None) -> Engine:
    """Give the engine to run.

    Parameters
    ----------
    stated
        Which; None for Pinocchio where it can be imported, else the kernels.

    Returns
    -------
    Engine
        Ready to run.

    Raises
    ------
    ValueError
        If there is no such engine, or it cannot be imported.

    Examples
    --------
    >>> choose_engine("kernels").name
    'kernels'
    """
    if stated is not None and stated not in ENGINES:
        raise ValueError(f"engine must be one of {', '.join(ENGINES)}, got {stated!r}")
    engine = _available(stated)
    if engine is not None:
        return engine
    raise ValueError(
        'engine = "pinocchio" is stated, but Pinocchio cannot be imported here; install it (pip '
        'install pin), leave engine out, or state engine = "kernels"'
    )


def other_engine(engine: Engine) -> Engine | None:
    """Give the engine that can check another one; None where it cannot be imported."""
    return _kernels() if engine.name == "pinocchio" else _pinocchio()


def engine_identity(stated: EngineName | None = None) -> str:
    """Name the engine that would run, and its version, without an error where it is missing."""
    engine = _available(stated)
    return f"{engine.name} {engine.version}" if engine is not None else "pinocchio, missing"


def _available(stated: EngineName | None) -> Engine | None:
    if stated == "kernels":
        return _kernels()
    return _pinocchio() or (_kernels() if stated is None else None)


def _pinocchio() -> Engine | None:
    try:
        import pinocchio

        from hbm.engines.pinocchio import free_dynamics
    except ImportError:
        return None
    return Engine("pinocchio", pinocchio.__version__, free_dynamics)


@cache
def _kernels() -> Engine:
    from hbm.engines.kernels import free_dynamics

    return Engine("kernels", f"casadi {version('casadi')}", free_dynamics)
