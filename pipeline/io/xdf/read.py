"""XDF files, as LabRecorder writes them from streams of Lab Streaming Layer."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from hbm.markers import Markers
from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, printable, short
from pipeline.io.axes import mean_force, parse_axes, settle_axes
from pipeline.io.columns import PlateColumns, plates_about_origin
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
    channels = {s.name: _channels(s) for s in streams}
    regular = [
        s
        for s in streams
        if s.rate_hz > 0 or s.name == stated.marker_stream or _has_markers(s, channels[s.name])
    ]
    left = [s.name for s in streams if s not in regular] + texts
    stream = _of_markers(regular, channels, stated)
    layout = marker_layout(channels[stream.name], stated)
    clock = _clock(stream)
    position = layout.positions(clock.on_frames(stream.values)).reshape(clock.frames, -1, 3)
    stated.check_span(position, layout.unit)
    notes = [*layout.notes, *_clock_notes(stream, clock)]
    signals = []
    for other in regular:
        if other is stream:
            continue
        found, more = _signals(other, channels[other.name], clock.start_s, stated)
        signals.append(found)
        notes += more
    columns = [plate for s in signals for plate in s.columns]
    written = printable((stream.info.findtext("desc/axes") or "").strip())
    settled, axes_notes = settle_axes(
        stated.axes or written or None,
        position,
        layout.names,
        marker_set=stated.marker_set,
        plate_forces=[mean_force(plate.force) for plate in columns],
    )
    if written and stated.axes is None:
        told = Note.of(
            "axes_of_format", axes=settled.split(","), program="the stream's description"
        )
        axes_notes = (told, *axes_notes[1:])
    to_lab = parse_axes(settled)
    about_origin, moment_notes = plates_about_origin(columns, to_lab)
    plates = [p.plate(s.time, s.values, to_lab) for s in signals for p in s.plates]
    analog, analog_notes = _analog(signals)
    if left:
        notes.append(Note.of("streams_left_out", streams=left))
    if not whole:
        notes.append(Note.of("recording_unended"))
    return Recording(
        source=path,
        markers=Markers(clock.time - clock.start_s, layout.names, position @ to_lab.T),
        plates=tuple(_in_order([*plates, *about_origin])),
        analog=analog,
        metadata=Metadata(subject=layout.subject, software="LabRecorder"),
        stated=stated,
        notes=(*axes_notes, *notes, *moment_notes, *analog_notes),
    )


def _of_markers(
    streams: Sequence[Stream], channels: Mapping[str, Sequence[Channel]], stated: Stated
) -> Stream:
    """Give the stream that holds the markers."""
    if stated.marker_stream is not None:
        streams = [s for s in streams if s.name == stated.marker_stream]
        if not streams:
            raise ValueError(
                f"no stream is called {short(stated.marker_stream)!r} as marker_stream states; "
                f"streams there: {listed(map(repr, channels))}"
            )
        return streams[0]
    found = [s for s in streams if _has_markers(s, channels[s.name])]
    if not found:
        raise ValueError(
            "no stream holds markers: none has the content type MoCap or channels of type "
            f"PositionX; streams there: {listed(map(repr, channels))}"
        )
    if len(found) > 1:
        names = [s.name for s in found]
        raise ValueError(
            f"{len(found)} streams hold markers ({listed(map(repr, names))}): choose one, for "
            f"example --marker-stream {short(names[0])!r}, or marker_stream = {short(names[0])!r} "
            "in study.toml"
        )
    return found[0]


def _has_markers(stream: Stream, channels: Sequence[Channel]) -> bool:
    return has_markers(stream.content_type, channels)


def _channels(stream: Stream) -> tuple[Channel, ...]:
    try:
        return parse_channels(stream.info, stream.values.shape[1])
    except ValueError as error:
        raise ValueError(f"stream {short(stream.name)!r}: {error}") from error


def _clock(stream: Stream) -> Clock:
    try:
        return find_clock(stream.stamps, stream.rate_hz)
    except ValueError as error:
        raise ValueError(f"stream {short(stream.name)!r}: {error}") from error


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
    clock = _clock(stream)
    time, values = clock.time - start_s, clock.on_frames(stream.values)
    plates, left_out = find_plates(stream.info, channels)
    notes = [
        Note.of("plate_left_out", plate=f"plate {short(number)}", reason=why)
        for number, why in left_out.items()
    ]
    placed = {plate.number for plate in plates}
    columns, more = dflow_plates(channels, time, values, stated, placed)
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
