"""A C3D file written again: nothing differs from its original but what was to change."""

from collections.abc import Collection
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.io.c3d.byte_order import BLOCK_BYTES, floats, integer_type
from pipeline.io.c3d.data import bytes_per_frame, count_frames
from pipeline.io.c3d.header import Header, read_header
from pipeline.io.c3d.parameters import Parameters
from pipeline.io.c3d.second_reader.disagreement import (
    Disagreement,
    parameters_that_differ,
    samples_that_differ,
    shown,
)
from pipeline.io.c3d.second_reader.process import read_with
from pipeline.io.c3d.second_reader.reading import Parameter, Reading, Refusal, numbered
from pipeline.io.c3d.second_reader.second_reading import miscount, second_reading

DATA_BLOCK_BYTES: Final = slice(16, 18)
"""Of the header block: where the data section begins."""
DATA_START: Final = "POINT:DATA_START"
POINT_WORDS: Final = ("x", "y", "z", "residual")


@dataclass(frozen=True, slots=True)
class Verification:
    """Who found that a rewritten file differs only where it was to.

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
    Our reader compares the header block, all parameters and all words of the data section. Then
    ezc3d, or c3d where ezc3d cannot read the original, reads both files in a process of its own,
    and what it reads is compared: points, residuals, cameras, channels, rotations, events, rates,
    parameters and their descriptions.
    """
    allowed = {DATA_START, *(name.upper() for name in changed_parameters)}
    group = (added_group or "").upper()
    header, parameters = read_header(original)
    try:
        found = _differences_in_bytes(original, written, changed_channels, allowed, group)
        _require_none(found, "as this project reads them")
        second = second_reading(original, header, parameters)
        if second.reading is None:
            return Verification(None, second.refusals)
        again = read_with(second.reading.reader.split()[0], written)
        if isinstance(again, Refusal):
            raise ValueError(f"{again}, but read the original")
        if wrong := miscount(again, header, count_frames(original, header, parameters)):
            raise ValueError("{3} reads {1} of {2} {0}".format(*wrong, again.reader))
        found = _differences_of_readings(second.reading, again, changed_channels, allowed, group)
        _require_none(found, f"as {again.reader} reads them")
    except ValueError as error:
        raise ValueError(f"{written.name} is not {original.name} written again: {error}") from error
    return Verification(second.reading.reader, second.refusals)


def _require_none(found: list[Disagreement], reader: str) -> None:
    if found:
        more = f"; {len(found) - 1} more of them" if len(found) > 1 else ""
        raise ValueError(f"{found[0].told('in the original', 'as written')}, {reader}{more}")


def _differences_in_bytes(
    original: Path, written: Path, changed: Collection[int], allowed: set[str], group: str
) -> list[Disagreement]:
    (header, parameters), (header_again, parameters_again) = map(read_header, (original, written))
    blocks = []
    for path in (original, written):
        with path.open("rb") as file:
            block = bytearray(file.read(BLOCK_BYTES))
        block[DATA_BLOCK_BYTES] = bytes(2)
        blocks.append(np.frombuffer(bytes(block), np.uint8))
    found = [
        Disagreement("header", f"byte {k + 1}", str(blocks[0][k]), str(blocks[1][k]))
        for k in np.flatnonzero(blocks[0] != blocks[1])[:1]
    ]
    found += parameters_that_differ(
        _flat(parameters, allowed, group), _flat(parameters_again, allowed, group)
    )
    first, second = (
        np.memmap(path, np.uint8, "r", offset=(own.data_block - 1) * BLOCK_BYTES)
        for path, own in ((original, header), (written, header_again))
    )
    if len(first) != len(second):
        sizes = f"{len(first)} bytes", f"{len(second)} bytes"
        return [*found, Disagreement("bytes", "of the data section", *sizes)]
    return found + _differences_of_words(
        first, second, header, parameters, count_frames(original, header, parameters), changed
    )


def _flat(parameters: Parameters, allowed: set[str], group: str) -> dict[str, Parameter]:
    """Give all parameters but those that may differ, with their dimensions in the name."""
    flat: dict[str, Parameter] = {}
    for name, members in parameters.groups.items():
        for member, values in members.items():
            if name != group and f"{name}:{member}" not in allowed:
                flat[f"{name}:{member} {list(values.shape)}"] = tuple(
                    text if isinstance(text, str) else float(text)
                    for text in values.ravel(order="F").tolist()
                )
    return flat


def _differences_of_words(
    first: NDArray[np.uint8],
    second: NDArray[np.uint8],
    header: Header,
    parameters: Parameters,
    frames: int,
    changed: Collection[int],
) -> list[Disagreement]:
    end, words = frames * bytes_per_frame(header), 4 * header.n_points
    channels = header.n_analog // max(header.analog_per_frame, 1)
    kept = [k for k in range(channels) if k not in changed]
    points = numbered(parameters.texts("POINT", "LABELS"), header.n_points)
    labels = numbered(parameters.texts("ANALOG", "LABELS"), channels)
    one, other = (
        side[:end].view("u4" if header.scale < 0 else "u2").reshape(frames, -1)
        for side in (first, second)
    )
    found = samples_that_differ(
        "marker",
        [f"{point} {word}" for point in points for word in POINT_WORDS],
        one[:, :words],
        other[:, :words],
        np.not_equal,
        first_frame=header.first_frame,
        show=partial(_shown_word, header),
    )
    if kept:
        found += samples_that_differ(
            "channel",
            [labels[k] for k in kept],
            one[:, words:].reshape(-1, channels)[:, kept],
            other[:, words:].reshape(-1, channels)[:, kept],
            np.not_equal,
            first_frame=header.first_frame,
            per_frame=header.analog_per_frame,
            show=partial(_shown_word, header),
        )
    rest = np.flatnonzero(first[end:] != second[end:])
    if rest.size:
        at = end + int(rest[0])
        values = str(first[at]), str(second[at])
        found.append(Disagreement("bytes", f"{at + 1} of the data section", *values))
    return found


def _shown_word(header: Header, word: np.generic) -> str:
    data = word.tobytes()
    if header.scale < 0:
        return shown(floats(data, header.byte_order)[0])
    return shown(np.frombuffer(data, integer_type(header.byte_order))[0])


def _differences_of_readings(
    original: Reading, written: Reading, changed: Collection[int], allowed: set[str], group: str
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
