"""How large each cause usually is, before a trial is looked at: published sizes."""

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files


@dataclass(frozen=True, slots=True)
class Prior:
    """The usual size of a cause.

    Attributes
    ----------
    size
        One standard deviation.
    unit
        Of the size.
    source
        Where it is from.
    mean
        Its mean, where it is not zero.
    """

    size: float
    unit: str
    source: str
    mean: float = 0.0


@cache
def priors() -> dict[str, Prior]:
    """Give the usual sizes by kind of cause, as `priors.toml` lists them.

    Examples
    --------
    >>> priors()["delay"].unit
    's'
    """
    text = files("pipeline.explain").joinpath("priors.toml").read_text(encoding="utf-8")
    return {kind: Prior(**own) for kind, own in tomllib.loads(text).items()}
