"""Motek's .mox files (XML)."""

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import printable, short
from pipeline.io.columns import PlateColumns, dflow_plates, file_markers, recording_of, vectors
from pipeline.io.input_file import open_file
from pipeline.io.labels import told_apart
from pipeline.io.recording import Analog, Fact, Recording
from pipeline.io.stated import Stated
from pipeline.io.text_table import decoded, read_number
from pipeline.io.units import MAX_VALUE

ROOT: Final = "moxie_viewer_datafile"
MAX_RATE_HZ: Final = 1e6
"""Beyond it nothing was measured: the file is damaged."""
MARKER: Final = re.compile(
    r"(?:(?:Marker|Position)[ -]+(?P<a>\S+) |(?P<b>\S+)\.Pos)(?P<axis>[XYZ])"
)
PLATE: Final = re.compile(
    r"FP(?P<number>\d*)(?: - |\.)(?P<what>For|Mom|Cop)(?:ce|ent|)? ?(?P<axis>[XYZ])", re.IGNORECASE
)


Channel = tuple[float, Array]
"""Rate [Hz] and samples."""


def read_mox(path: Path, stated: Stated) -> Recording:
    """Read a .mox file.

    Parameters
    ----------
    path
        The file.
    stated
        What is stated about it, as for `pipeline.io.c3d.read.read_c3d`. Units are by default m, N
        and N·m.

    Returns
    -------
    Recording
        Channels named ``LASIS.PosX``, ``Marker LASIS X`` or ``Position LASIS X`` are markers [m];
        ``FP - Force X`` or ``FP1.ForX``, with Moment and Cop, are plates [N, N·m, m]. All others
        are analog channels without a unit, since the format states none. Times start at 0.

    Raises
    ------
    ValueError
        The file is damaged, holds no markers, or contradicts itself or the axes. One line.
    OSError
        The file cannot be opened.

    Notes
    -----
    No sample of the format is public; the structure is that of two programs which read it. They
    do not agree on the sign of horizontal forces. Here force acts on the subject and the moment is
    about the origin of the file's axes, checked against Cop channels where there are any; a note
    of the recording states that this is unconfirmed.
    """
    with open_file(path) as file:
        channels = _channels(file.read())
    marked, on_plates = ({k: m for k in channels if (m := p.fullmatch(k))} for p in (MARKER, PLATE))
    stems = list(dict.fromkeys(m["a"] or m["b"] for m in marked.values()))
    if not stems:
        raise ValueError("no markers: no channel such as LASIS.PosX")
    parts = {f"{m['a'] or m['b']} {m['axis']}": channels[k] for k, m in marked.items()}
    rate, columns = _on_one_clock(parts)
    position = vectors(columns, (f"{stem} " for stem in stems))
    markers = file_markers(stems, "m", lambda kept: position[:, kept], stated)
    of_plates: dict[int, dict[str, Channel]] = {}
    for k, m in on_plates.items():
        number = int(m["number"] or 1)
        name = f"FP{number}.{m['what'].capitalize()}{m['axis'].upper()}"
        of_plates.setdefault(number, {})[name] = channels[k]
    plates: list[PlateColumns | Fact] = []
    for parts in of_plates.values():
        its_rate, columns = _on_one_clock(parts)
        time = np.arange(len(next(iter(columns.values())))) / its_rate
        plates += dflow_plates(columns, time)
    rest = {k: channel for k, channel in channels.items() if k not in {*marked, *on_plates}}
    analog, notes = _analog(rest, (rate, len(position)))
    if plates:
        notes.append(Note.of("force_sign_unconfirmed"))
    return recording_of(
        path, stated, markers, np.arange(len(position)) / rate, plates, notes=notes, analog=analog
    )


def _channels(content: bytes) -> dict[str, Channel]:
    """Give the channels by their names."""
    decoded(content)
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, LookupError) as error:
        raise ValueError(f"the XML is broken or truncated: {error}") from error
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    if root.tag != ROOT:
        raise ValueError(f"not a .mox file: its root is {short(root.tag)!r}, expected {ROOT!r}")
    count = printable(root.findtext("viewer_header/nr_of_samples", "").strip())
    channels: dict[str, Channel] = {}
    elements = root.findall("viewer_data/viewer_channel")
    labels = [printable(e.findtext("channel_label", "").strip()) for e in elements]
    for element, name in zip(elements, told_apart(labels, MARKER), strict=True):
        if name in channels:
            raise ValueError(f"several channels have the label {short(name)!r}")
        words = element.findtext("raw_channel_data/channel_data", "").split()
        text = element.findtext("raw_channel_data/sampling_frequency", "")
        rate = read_number(text, f"sampling_frequency of channel {short(name)!r}")
        try:
            samples = np.array(words, float)
        except ValueError:
            samples = np.array([read_number(word, f"channel {short(name)!r}") for word in words])
        if not 0 < rate < MAX_RATE_HZ or not (np.abs(samples) < MAX_VALUE).all():
            raise ValueError(
                f"channel {short(name)!r} holds a rate or value that cannot be measured"
            )
        channels[name] = rate, samples
    if not channels:
        raise ValueError("it holds no channels (viewer_data/viewer_channel)")
    if count and all(str(len(samples)) != count for _, samples in channels.values()):
        raise ValueError(f"its header says nr_of_samples {count}, but no channel holds as many")
    return channels


def _on_one_clock(parts: Mapping[str, Channel]) -> tuple[float, dict[str, Array]]:
    """Give rate [Hz] and samples of channels that belong together."""
    if len(clocks := {(rate, len(samples)) for rate, samples in parts.values()}) > 1:
        raise ValueError(
            f"{short(next(iter(parts)))!r} and the like differ in rate or number of samples; the "
            "file is truncated or mixed"
        )
    ((rate, count),) = clocks
    if count < 2:
        raise ValueError(f"{short(next(iter(parts)))!r} holds {count} samples, expected at least 2")
    return rate, {name: samples for name, (_, samples) in parts.items()}


def _analog(
    channels: Mapping[str, Channel], of_markers: tuple[float, int]
) -> tuple[Analog | None, list[Note]]:
    """Give the channels of the commonest rate and length, and note which are left out."""
    clocks = {name: (rate, len(samples)) for name, (rate, samples) in channels.items()}
    if not clocks:
        return None, []
    counts = Counter(clocks.values())
    rate, count = clock = max(sorted(counts), key=lambda c: (counts[c], c == of_markers))
    kept = tuple(name for name in channels if clocks[name] == clock)
    left = [name for name in channels if clocks[name] != clock]
    values = np.column_stack([channels[name][1] for name in kept])
    notes = [Note.of("parts_left_out", parts=left)] if left else []
    return Analog(np.arange(count) / rate, kept, ("",) * len(kept), values), notes
