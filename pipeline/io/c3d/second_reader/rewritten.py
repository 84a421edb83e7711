"""A C3D file written again: nothing differs from its original but what was to change."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.io.c3d.header import read_header
from pipeline.io.c3d.second_reader.disagreement import (
    Disagreement,
    parameters_that_differ,
    samples_that_differ,
)
from pipeline.io.c3d.second_reader.process import read_with
from pipeline.io.c3d.second_reader.reading import Reading, Refusal
from pipeline.io.c3d.second_reader.same_bytes import bytes_that_differ
from pipeline.io.c3d.second_reader.second_reading import miscount, second_reading

DATA_START: Final = "POINT:DATA_START"


@dataclass(frozen=True, slots=True)
class Verification:
    """Which second reader found that a rewritten file differs only where it was meant to.

    Attributes
    ----------
    reader
        The library other than ours that read both files, with its version; None where none could.
    refusals
        Libraries that were asked first and could not read the original, with their reasons.
    """

    reader: str | None
    refusals: tuple[Refusal, ...]


def check_rewritten(
    original: Path,
    written: Path,
    *,
    changed_channels: Collection[int],
    added_group: str | None = None,
    changed_parameters: Collection[str] = (),
) -> Verification:
    """Check that a rewritten C3D file differs from its original only where it was to.

    Parameters
    ----------
    original, written
        Both files.
    changed_channels
        Indices from 0 of the analog channels whose samples may differ.
    added_group
        Parameter group that only the written file has.
    changed_parameters
        Parameters that may differ, such as ``"FORCE_PLATFORM:CORNERS"``; POINT:DATA_START always
        may.

    Returns
    -------
    Verification
        The library other than ours that agrees.

    Raises
    ------
    ValueError
        Something else differs: what, where, and both values.
    OSError
        A file cannot be opened.

    Notes
    -----
    Our reader compares the header, all parameters and the data section byte by byte. Then
    ezc3d, or c3d where ezc3d cannot read the original, reads both files in a process of its own,
    and what it reads is compared: points, residuals, cameras, channels, rotations, events, rates,
    parameters and their descriptions.
    """
    allowed = {DATA_START, *(name.upper() for name in changed_parameters)}
    group = added_group.upper() if added_group else None
    header, _ = read_header(original)
    try:
        found = bytes_that_differ(original, written, changed_channels, allowed, group)
        _require_none(found, "as this project reads them")
        second = second_reading(original, header)
        if second.reading is None:
            return Verification(None, second.refusals)
        again = read_with(second.reading.reader.split()[0], written)
        if isinstance(again, Refusal):
            raise ValueError(f"{again}, but read the original")
        if wrong := miscount(again, header):
            raise ValueError("{3} reads {1} of {2} {0}".format(*wrong, again.reader))
        found = _differences_of_readings(second.reading, again, changed_channels, allowed, group)
        _require_none(found, f"as {again.reader} reads them")
    except ValueError as error:
        raise ValueError(f"the copy is not {original.name} written again: {error}") from error
    return Verification(second.reading.reader, second.refusals)


def _require_none(found: list[Disagreement], reader: str) -> None:
    if found:
        more = f"; {len(found) - 1} more of them" if len(found) > 1 else ""
        raise ValueError(f"{found[0].line('in the original', 'as written')}, {reader}{more}")


def _differences_of_readings(
    original: Reading,
    written: Reading,
    changed: Collection[int],
    allowed: set[str],
    group: str | None,
) -> list[Disagreement]:
    found = [
        Disagreement("header", name, str(first), str(second))
        for name in ("first_frame", "rate_hz", "analog_per_frame", "events")
        if (first := getattr(original, name)) != (second := getattr(written, name))
    ]
    for name in ("parameters", "descriptions"):
        first, second = (
            {
                key: value if isinstance(value, tuple) else (value,)
                for key, value in getattr(side, name).items()
                if key not in allowed and key.partition(":")[0] != group
            }
            for side in (original, written)
        )
        found += parameters_that_differ(first, second)
    markers = original.labels("POINT", original.points.shape[1])
    for name in ("points", "residuals", "cameras"):
        found += samples_that_differ(
            "marker",
            markers,
            getattr(original, name),
            getattr(written, name),
            _unequal,
            first_frame=original.first_frame,
        )
    channels = original.labels("ANALOG", original.analog.shape[1])
    kept = [k for k in range(len(channels)) if k not in changed]
    found += samples_that_differ(
        "channel",
        [channels[k] for k in kept],
        original.analog[:, kept],
        written.analog[:, kept],
        _unequal,
        first_frame=original.first_frame,
        per_frame=original.analog_per_frame,
    )
    if not np.array_equal(original.rotations, written.rotations, equal_nan=True):
        found.append(Disagreement("rotation", "matrices", "those", "others"))
    return found


def _unequal(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.bool_]:
    different = (first != second) & ~(np.isnan(first) & np.isnan(second))
    return np.asarray(different.any(axis=-1) if different.ndim == 3 else different)
