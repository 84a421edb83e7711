"""Our reading of a C3D file against a second one: what both hold, and where they differ."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pipeline.io.c3d.data import Samples, read_samples
from pipeline.io.c3d.header import Header, Parameters, read_header
from pipeline.io.c3d.second_reader.disagreement import (
    Disagreement,
    parameters_that_differ,
    samples_that_differ,
)
from pipeline.io.c3d.second_reader.reading import Parameter, Reading, Refusal
from pipeline.io.c3d.second_reader.second_reading import second_reading

ROUNDING: Final = 4
"""Steps of floating point numbers by which programs differ that scale in another order."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """What a second reader says of a file that ours has read.

    Attributes
    ----------
    reader
        The library that read the file as a second one, with its version; None where none could.
    refusals
        Libraries that were asked first and could not, with their reasons.
    disagreements
        Where it differs from our reader.
    """

    reader: str | None
    refusals: tuple[Refusal, ...]
    disagreements: tuple[Disagreement, ...]

    def told(self) -> list[str]:
        """Say each disagreement in one line."""
        return [each.told("here", f"by {self.reader}") for each in self.disagreements]


def compare_readers(path: Path) -> Agreement:
    """Read a C3D file twice, by our reader and by a second one, and compare all of it.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Agreement
        Who read it, and every marker, channel, parameter and number of the header that differs.

    Raises
    ------
    ValueError
        Our reader refuses the file.
    OSError
        The file cannot be opened.

    Notes
    -----
    Compared are the samples before units and axes are settled, which follow from the parameters.
    A point is missing to our reader also where all its coordinates are zero; the same is applied
    to the second reading. Residuals of seen points are not compared, since our reader does not keep
    them, nor parameters of a group without a name, for which nobody can ask.
    """
    try:
        header, parameters = read_header(path)
        samples = read_samples(path, header, parameters)
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from error
    second = second_reading(path, header, parameters)
    if second.reading is None:
        return _without_reading(second.refusals)
    found = _compare(header, parameters, samples, second.reading)
    return Agreement(second.reading.reader, second.refusals, tuple(found))


def _without_reading(refusals: tuple[Refusal, ...]) -> Agreement:
    """Take a number as a disagreement that no other library corrects."""
    for refusal in refusals:
        if refusal.miscount is not None:
            name, read, held = refusal.miscount
            others = tuple(other for other in refusals if other is not refusal)
            found = Disagreement("number", f"of {name}", str(held), str(read))
            return Agreement(refusal.reader, others, (found,))
    return Agreement(None, refusals, ())


def _compare(
    header: Header, parameters: Parameters, samples: Samples, second: Reading
) -> list[Disagreement]:
    found = [
        Disagreement("header", name, str(ours), str(theirs))
        for name, ours, theirs in (
            ("first frame", header.first_frame, second.first_frame),
            ("frame rate", header.rate_hz, second.rate_hz),
            ("samples per frame", header.analog_per_frame, second.analog_per_frame),
            ("events", header.events, second.events),
        )
        if ours != theirs
    ]
    found += parameters_that_differ(
        _values(parameters),
        {
            key: values
            for key, values in second.parameters.items()
            if key[0] != ":" and (key not in second.assumed or _holds(parameters, key))
        },
    )
    coarse = second.points.dtype == np.float32 and header.scale > 0
    found += samples_that_differ(
        "marker",
        second.labels("POINT", header.n_points),
        samples.points,
        _seen(second),
        _Unequal(np.finfo(np.float32 if coarse else np.float64).eps),
        first_frame=header.first_frame,
    )
    found += samples_that_differ(
        "channel",
        second.labels("ANALOG", samples.analog.shape[1]),
        samples.analog,
        np.where(np.isfinite(second.analog), second.analog, np.nan),
        _Unequal(np.finfo(np.float64).eps),
        first_frame=header.first_frame,
        per_frame=header.analog_per_frame,
    )
    return found


def _values(parameters: Parameters) -> dict[str, Parameter]:
    return {
        f"{group}:{name}": tuple(
            value if isinstance(value, str) else float(value)
            for value in values.ravel(order="F").tolist()
        )
        for group, members in parameters.groups.items()
        if group
        for name, values in members.items()
    }


def _holds(parameters: Parameters, key: str) -> bool:
    group, _, name = key.partition(":")
    return name in parameters.groups.get(group, {})


def _seen(second: Reading) -> NDArray[np.floating]:
    """Give points with NaN wherever our reader takes them as missing."""
    missing = ~np.isfinite(second.points).all(axis=-1) | ~second.points.any(axis=-1)
    missing |= ~np.greater_equal(second.residuals, 0)
    return np.where(missing[..., np.newaxis], np.nan, second.points)


@dataclass(frozen=True, slots=True)
class _Unequal:
    """Whether samples differ by more than rounding, whose relative step is given."""

    step: np.floating[Any]

    def __call__(self, first: NDArray[Any], second: NDArray[Any]) -> NDArray[np.bool_]:
        close = np.abs(first - second) <= ROUNDING * self.step * np.abs(first)
        different = ~(close | (np.isnan(first) & np.isnan(second)))
        return np.asarray(different.any(axis=-1) if different.ndim == 3 else different)
