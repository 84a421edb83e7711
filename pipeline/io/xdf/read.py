"""XDF files, as LabRecorder writes them from streams of Lab Streaming Layer."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import listed, printable, short
from pipeline.io.columns import FileMarkers, PlateColumns, left_out, recording_of
from pipeline.io.input_file import naming, open_file
from pipeline.io.labels import require_unique
from pipeline.io.recording import Analog, Metadata, Recording
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
    plates: list[PlateChannels]

    def dflow_plates(self) -> Iterator[PlateColumns | Note]:
        """Give the plates that are named as D-Flow names them."""
        described = {plate.number for plate in self.plates}
        return dflow_plates(self.channels, self.time, self.values, described)

    @property
    def of_no_plate(self) -> list[int]:
        """Columns of the channels that are no plate's."""
        used = {k for plate in self.plates for k in plate.columns}
        named = (bool(DFLOW_PLATE.fullmatch(channel.label)) for channel in self.channels)
        return [k for k, of_plate in enumerate(named) if k not in used and not of_plate]


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
    require_unique([s.name for s in streams], "several streams have the same name")
    channels = {s.name: _of(s, parse_channels, s.info, s.values.shape[1]) for s in streams}
    with_markers = [s for s in streams if has_markers(s.content_type, channels[s.name])]
    regular = [
        s for s in streams if s.rate_hz > 0 or s.name == stated.marker_stream or s in with_markers
    ]
    stream = _of_markers(regular, with_markers, stated.marker_stream, list(channels))
    layout = marker_layout(channels[stream.name], stated)
    clocks: dict[str, Clock] = {s.name: _of(s, find_clock, s.stamps, s.rate_hz) for s in regular}
    clock = clocks[stream.name]
    position = layout.positions(clock.on_frames(stream.values)).reshape(clock.frames, -1, 3)
    stated.check_span(position, layout.unit)
    markers = FileMarkers(layout.names, position, layout.unit, layout.subject, layout.notes)
    signals = []
    notes = []
    for other in regular:
        own = clocks[other.name]
        notes += _clock_notes(other, own)
        if other is not stream:
            time, values = own.time - clock.start_s, own.on_frames(other.values)
            plates, absent = find_plates(other.info, channels[other.name])
            notes += [left_out(f"plate {short(number)}", why) for number, why in absent.items()]
            signals.append(_Signals(other.name, channels[other.name], time, values, plates))
    analog, interpolated = _analog(signals)
    if left := [s.name for s in streams if s not in regular] + texts:
        notes.append(Note.of("parts_left_out", parts=left))
    if not whole:
        notes.append(Note.of("cut_short", file=path.name, sign="the recorder did not end it"))
    return recording_of(
        path,
        stated,
        markers,
        clock.time - clock.start_s,
        [plate for s in signals for plate in s.dflow_plates()],
        axes=printable((stream.info.findtext("desc/axes") or "").strip()),
        program="the stream's description",
        placed=lambda to_lab: [
            plate.plate(s.time, s.values, to_lab) for s in signals for plate in s.plates
        ],
        analog=analog,
        metadata=Metadata(subject=layout.subject, software="LabRecorder"),
        notes=[*notes, *interpolated],
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
    of = f"stream {short(stream.name)}"
    notes = [
        Note.of("sample_clock", of=of, rate_hz=clock.rate_hz, scatter_s=clock.scatter_s),
    ]
    if dropped := clock.frames - len(stream.stamps):
        notes.append(Note.of("samples_dropped", of=of, dropped=dropped, samples=clock.frames))
    return notes


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
    require_unique(names, "several channels have the same label")
    notes = [Note.of("signals_interpolated", signals=interpolated, fastest=short(fastest.name))]
    analog = Analog(time, names, tuple(units), np.hstack(values))
    return analog, notes if interpolated else []
