"""Our reading of a C3D file against a second one: what both hold, and where they differ."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pipeline.io.c3d.counts import MAX_COUNT
from pipeline.io.c3d.data import Samples, analog_scaling, read_samples
from pipeline.io.c3d.header import Header, read_header
from pipeline.io.c3d.parameters import Parameters
from pipeline.io.c3d.second_reader.disagreement import (
    SMALLEST,
    Disagreement,
    parameters_that_differ,
    samples_that_differ,
)
from pipeline.io.c3d.second_reader.reading import Parameter, Reading, Refusal
from pipeline.io.c3d.second_reader.second_reading import LIBRARIES, second_reading

FRAMES: Final = "POINT:FRAMES"
FROM_HEADER: Final = {
    *(f"POINT:{name}" for name in ("USED", "SCALE", "RATE", "DATA_START")),
    *(f"ANALOG:{name}" for name in ("USED", "RATE")),
}
"""Parameters that ezc3d makes from the header where the file has none."""
ROUNDING: Final = 4
"""Steps of floating point numbers by which programs differ that scale in another order."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """Whether a second reader reads a file as ours does.

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

    def lines(self) -> list[str]:
        """Say each disagreement in one line."""
        return [each.line("here", f"by {self.reader}") for each in self.disagreements]


def compare_readers(path: Path) -> Agreement:
    """Read a C3D file twice, by our reader and by a second one, and compare all of it.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    Agreement
        Which library read it, and every marker, channel, parameter and number of the header that
        differs.

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
    them, nor parameters of a group without a name, which no program can look up, nor POINT:FRAMES,
    in whose place the frames are counted, nor counts and rates that other libraries make from the
    header where the file contradicts itself.
    """
    try:
        header, parameters = read_header(path)
        samples = read_samples(path, header, parameters)
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from error
    second = second_reading(path, header)
    if second.reading is None:
        contradictory = bool(header.notes or samples.notes)
        return _without_reading(second.refusals, contradictory=contradictory)
    reading, refusals = second.reading, second.refusals
    found = _compare(header, parameters, samples, reading)
    if found and _takes_offsets_without_sign(found, header, parameters, samples, reading):
        refusals += (Refusal(reading.reader, "it takes ANALOG:OFFSET without its sign"),)
        other = second_reading(path, header, LIBRARIES[1:])
        refusals += other.refusals
        if other.reading is None:
            return Agreement(None, refusals, ())
        reading = other.reading
        found = _compare(header, parameters, samples, reading)
    return Agreement(reading.reader, refusals, tuple(found))


def _takes_offsets_without_sign(
    found: list[Disagreement],
    header: Header,
    parameters: Parameters,
    samples: Samples,
    second: Reading,
) -> bool:
    """Whether that alone explains all that differs.

    ezc3d 1.7.2 subtracts the magnitude of ANALOG:OFFSET. The C3D user guide defines it as signed,
    or with the samples as unsigned where ANALOG:FORMAT is UNSIGNED.
    """
    if any(each.kind != "channel" for each in found):
        return False
    unsigned = parameters.text("ANALOG", "FORMAT").upper() == "UNSIGNED"
    stored, scale, _ = analog_scaling(header, parameters)
    offset = np.where(stored < 0, stored + 65536, stored) if unsigned else stored
    shift = offset - np.abs(np.where(stored > 32767, stored - 65536, stored))
    differ = _Unequal(_analog_step(header, parameters, samples), np.abs(shift * scale))
    unexplained = differ(samples.analog + shift * scale, second.analog)
    if unsigned and header.scale > 0:
        unexplained &= differ(samples.analog + (shift - 65536) * scale, second.analog)
    return not unexplained.any()


def _without_reading(refusals: tuple[Refusal, ...], *, contradictory: bool) -> Agreement:
    """Take a number as a disagreement that no other library corrects.

    None is that a library takes the wrong one of a file's contradictory counts or rates, which our
    reader notes, nor that it counts frames in 16 bits: ezc3d 1.7.2 does so in files with a group
    ROTATION, c3d 0.6 where no parameter holds the true number.
    """
    for refusal in refusals:
        if refusal.miscount is not None and not contradictory:
            name, read, held = refusal.miscount
            if name != "frames" or not read <= MAX_COUNT < held:
                others = tuple(other for other in refusals if other is not refusal)
                found = Disagreement("number", f"of {name}", str(held), str(read))
                return Agreement(refusal.reader, others, (found,))
    return Agreement(None, refusals, ())


def _compare(
    header: Header, parameters: Parameters, samples: Samples, second: Reading
) -> list[Disagreement]:
    contradictory = bool(header.notes or samples.notes)
    settled = {"frame rate", "samples per frame"} if contradictory else set()
    settled |= set() if header.channels else {"samples per frame"}
    found = [
        Disagreement("header", name, str(mine), str(other))
        for name, mine, other in (
            ("first frame", header.first_frame, second.first_frame),
            ("frame rate", samples.rate_hz, second.rate_hz),
            ("samples per frame", header.analog_per_frame, second.analog_per_frame),
            ("events", tuple(e for e in header.events if e[0]), second.events),
        )
        if mine != other and name not in settled
    ]
    theirs = {key: values for key, values in second.parameters.items() if key[0] != ":"}
    for key in second.assumed | FROM_HEADER:
        if not _holds(parameters, key):
            theirs.pop(key, None)
    ours = _values(parameters) | {FRAMES: theirs.get(FRAMES, ())}
    if contradictory:
        ours |= {key: theirs.get(key, ()) for key in FROM_HEADER}
    found += parameters_that_differ(ours, theirs)
    coarse = second.points.dtype == np.float32 and header.scale > 0
    found += samples_that_differ(
        "marker",
        second.labels("POINT", header.n_points),
        _seen(samples.points),
        _seen(np.where((second.residuals >= 0)[..., np.newaxis], second.points, np.nan)),
        _Unequal(np.finfo(np.float32 if coarse else np.float64).eps),
        first_frame=header.first_frame,
    )
    found += samples_that_differ(
        "channel",
        second.labels("ANALOG", samples.analog.shape[1]),
        samples.analog,
        np.where(np.isfinite(second.analog), second.analog, np.nan),
        _Unequal(_analog_step(header, parameters, samples)),
        first_frame=header.first_frame,
        per_frame=header.analog_per_frame,
    )
    return found


def _analog_step(header: Header, parameters: Parameters, samples: Samples) -> NDArray[np.float64]:
    """Give how finely each channel is compared: ezc3d subtracts offsets in single precision."""
    offset, _, _ = analog_scaling(header, parameters)
    single = (offset != 0) & (header.scale < 0)
    kinds = np.finfo(np.float32).eps / ROUNDING, np.finfo(np.float64).eps
    return np.where(single, *kinds)


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


def _seen(points: NDArray[np.floating]) -> NDArray[np.floating]:
    """Give points with NaN where none was seen: a coordinate is no number, or all are zero."""
    missing = ~np.isfinite(points).all(axis=-1) | ~(np.abs(points) > SMALLEST).any(axis=-1)
    return np.where(missing[..., np.newaxis], np.nan, points)


@dataclass(frozen=True, slots=True)
class _Unequal:
    """Whether samples differ by more than rounding of numbers of at least a size."""

    step: np.floating[Any] | NDArray[np.float64]
    least: float | NDArray[np.float64] = 0.0

    def __call__(self, first: NDArray[Any], second: NDArray[Any]) -> NDArray[np.bool_]:
        size = np.maximum(np.abs(first), self.least)
        close = np.abs(first - second) <= np.maximum(ROUNDING * self.step * size, SMALLEST)
        different = ~(close | (np.isnan(first) & np.isnan(second)))
        return np.asarray(different.any(axis=-1) if different.ndim == 3 else different)
