"""XDF files, as LabRecorder writes them from streams of Lab Streaming Layer."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, printable, short
from pipeline.io.columns import (
    FileMarkers,
    PlateColumns,
    lab_axes,
    plates_about_origin,
    plates_in_si,
)
from pipeline.io.input_file import naming, open_file
from pipeline.io.recording import Analog, Metadata, Plate, Recording
from pipeline.io.stated import Stated, as_stated
from pipeline.io.xdf.channels import Channel, has_markers, marker_layout, parse_channels, si_units
from pipeline.io.xdf.chunks import Stream, read_streams
from pipeline.io.xdf.clock import Clock, find_clock
from pipeline.io.xdf.plates import DFLOW_PLATE, PlateChannels, dflow_plates, find_plates

SAME_CLOCK_S: Final = 1e-4
"""Streams whose samples are at the same times within it need no interpolation."""


@dataclass(frozen=True, slots=True)
class _Signals:
    """One stream of signals at a constant rate."""

    name: str
    channels: tuple[Channel, ...]
    time: Array
    values: Array
    plates: tuple[PlateChannels, ...]
    columns: tuple[PlateColumns, ...]

    @property
    def of_no_plate(self) -> list[int]:
        """Columns of the channels that are no plate's."""
        used = {k for plate in self.plates for k in plate.columns}
        return [
            k
            for k, channel in enumerate(self.channels)
            if k not in used and not DFLOW_PLATE.fullmatch(channel.label)
        ]


def read_xdf(path: str | Path, stated: Stated | str | None = None) -> Recording:
    """Read an XDF file: one stream of markers, and any of plates and other signals.

    Parameters
    ----------
    path
        The file (.xdf).
    stated
        What is stated about it, as for `pipeline.io.c3d.read.read_c3d`. Axes are by default those
        of the markers' stream (``desc/axes``), or inferred.

    Returns
    -------
    Recording
        SI units, lab axes; times start at 0 at the first frame of the markers. All streams are on
        the recorder's clock and at constant rates; samples that were lost are gaps (NaN). Analog
        channels are at the times of the fastest stream that has some.

    Raises
    ------
    ValueError
        The file is damaged, no stream holds markers or several do and none is stated, or the file
        contradicts its units or axes. One line.
    OSError
        The file cannot be opened.

    Notes
    -----
    The stream of markers has the content type MoCap or channels of type PositionX, PositionY and
    PositionZ. Plates are channels of the types ForceX … MomentZ with the plate's number, whose
    stream states their place, or channels that are named as D-Flow names them, such as FP1.ForX,
    about the origin of the markers' axes.
    """
    path = Path(path)
    with naming(path):
        return _read(path, as_stated(stated))


def _read(path: Path, stated: Stated) -> Recording:
    with open_file(path) as file:
        streams, texts, whole = read_streams(file.read())
    streams = [s for s in streams if len(s.stamps) > 1]
    if twice := [name for name, n in Counter(s.name for s in streams).items() if n > 1]:
        raise ValueError(f"several streams are called {listed(map(repr, twice))}")
    channels = {s.name: _of(s, parse_channels, s.info, s.values.shape[1]) for s in streams}
    with_markers = [s for s in streams if has_markers(s.content_type, channels[s.name])]
    regular = [
        s for s in streams if s.rate_hz > 0 or s.name == stated.marker_stream or s in with_markers
    ]
    left = [s.name for s in streams if s not in regular] + texts
    stream = _of_markers(regular, with_markers, stated.marker_stream, list(channels))
    layout = marker_layout(channels[stream.name], stated)
    clock: Clock = _of(stream, find_clock, stream.stamps, stream.rate_hz)
    position = layout.positions(clock.on_frames(stream.values)).reshape(clock.frames, -1, 3)
    stated.check_span(position, layout.unit)
    markers = FileMarkers(layout.names, position, layout.subject, layout.notes)
    notes = [*layout.notes, *_clock_notes(stream, clock)]
    signals = []
    for other in regular:
        if other is not stream:
            found, more = _signals(other, channels[other.name], clock.start_s, stated)
            signals.append(found)
            notes += more
    columns = [plate for s in signals for plate in s.columns]
    written = printable((stream.info.findtext("desc/axes") or "").strip())
    to_lab, axes_notes = lab_axes(
        markers,
        [plate.force for plate in columns],
        stated,
        written or None,
        "the stream's description",
    )
    about_origin, moment_notes = plates_about_origin(columns, to_lab)
    plates = [p.plate(s.time, s.values, to_lab) for s in signals for p in s.plates]
    analog, analog_notes = _analog(signals)
    if left:
        notes.append(Note.of("streams_left_out", streams=left))
    if not whole:
        notes.append(Note.of("recording_unended"))
    return Recording(
        source=path,
        markers=markers.in_lab(clock.time - clock.start_s, to_lab),
        plates=tuple(_in_order([*plates, *about_origin])),
        analog=analog,
        metadata=Metadata(subject=layout.subject, software="LabRecorder"),
        stated=stated,
        notes=(*axes_notes, *notes, *moment_notes, *analog_notes),
    )


def _of(stream: Stream, find: Callable[..., Any], *given: Any) -> Any:
    """Find something in a stream; what is wrong is said with its name."""
    try:
        return find(*given)
    except ValueError as error:
        raise ValueError(f"stream {short(stream.name)!r}: {error}") from error


def _of_markers(
    streams: Sequence[Stream], found: Sequence[Stream], wanted: str | None, names: Sequence[str]
) -> Stream:
    """Give the stream that holds the markers: the one of the wanted name, or the only one."""
    there = f"streams there: {listed(map(repr, names))}"
    if wanted is not None:
        found = [s for s in streams if s.name == wanted]
        if not found:
            raise ValueError(
                f"no stream is called {short(wanted)!r} as marker_stream states; {there}"
            )
    if not found:
        raise ValueError(
            "no stream holds markers: none has the content type MoCap or channels of type "
            f"PositionX; {there}"
        )
    if len(found) > 1:
        several = [s.name for s in found]
        raise ValueError(
            f"{len(found)} streams hold markers ({listed(map(repr, several))}): choose one, for "
            f"example --marker-stream {short(several[0])!r}, or marker_stream = "
            f"{short(several[0])!r} in study.toml"
        )
    return found[0]


def _clock_notes(stream: Stream, clock: Clock) -> list[Note]:
    dropped = clock.frames - len(stream.stamps)
    name = short(stream.name)
    notes = [
        Note.of(
            "stream_clock",
            stream=name,
            rate_hz=clock.rate_hz,
            nominal_hz=stream.rate_hz,
            scatter_s=clock.scatter_s,
        )
    ]
    if dropped:
        notes.append(Note.of("samples_dropped", stream=name, dropped=dropped, samples=clock.frames))
    return notes


def _signals(
    stream: Stream, channels: tuple[Channel, ...], start_s: float, stated: Stated
) -> tuple[_Signals, list[Note]]:
    clock: Clock = _of(stream, find_clock, stream.stamps, stream.rate_hz)
    time, values = clock.time - start_s, clock.on_frames(stream.values)
    plates, left_out = find_plates(stream.info, channels)
    notes = [
        Note.of("plate_left_out", plate=f"plate {short(number)}", reason=why)
        for number, why in left_out.items()
    ]
    placed = {plate.number for plate in plates}
    columns, more = plates_in_si(dflow_plates(channels, time, values, placed), stated)
    found = _Signals(stream.name, channels, time, values, tuple(plates), tuple(columns))
    return found, [*_clock_notes(stream, clock), *notes, *more]


def _in_order(plates: list[Plate]) -> list[Plate]:
    numbers = [plate.number for plate in plates]
    if len(set(numbers)) < len(numbers):
        raise ValueError(f"several plates have the same number: {listed(sorted(numbers))}")
    return sorted(plates, key=lambda plate: plate.number)


def _analog(signals: Sequence[_Signals]) -> tuple[Analog | None, list[Note]]:
    """Give all channels that are not a plate's at the times of the fastest stream with some."""
    rest = [(stream, columns) for stream in signals if (columns := stream.of_no_plate)]
    if not rest:
        return None, []
    fastest, _ = max(rest, key=lambda each: (len(each[0].time) - 1) / np.ptp(each[0].time))
    time = fastest.time
    units: list[str] = []
    values, interpolated = [], []
    for stream, columns in rest:
        si, factors = si_units([stream.channels[k] for k in columns])
        own = stream.values[:, columns] * factors
        units += si
        if len(own) != len(time) or np.abs(stream.time - time).max() > SAME_CLOCK_S:
            own = np.stack([np.interp(time, stream.time, c, np.nan, np.nan) for c in own.T], 1)
            interpolated.append(stream.name)
        values.append(own)
    labels = [(stream.name, stream.channels[k].label) for stream, of in rest for k in of]
    counts = Counter(label for _, label in labels)
    names = tuple(
        f"{stream}.{label}" if counts[label] > 1 or label.isdecimal() else label
        for stream, label in labels
    )
    if twice := sorted(name for name, count in Counter(names).items() if count > 1):
        raise ValueError(f"several channels have the same label: {listed(twice)}")
    notes = [
        Note.of("streams_interpolated", streams=interpolated, fastest=short(fastest.name))
    ] * bool(interpolated)
    return Analog(time, names, tuple(units), np.hstack(values)), notes
