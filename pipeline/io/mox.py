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
from pipeline.io.columns import dflow_plates, file_markers, recording_of, vectors
from pipeline.io.input_file import open_file
from pipeline.io.labels import require_unique, told_apart
from pipeline.io.read_options import ReadOptions
from pipeline.io.recording import Analog, Recording
from pipeline.io.text_table import TextTable, decoded, read_number, read_rate

ROOT: Final = "moxie_viewer_datafile"
MARKER: Final = re.compile(
    r"(?:(?:Marker|Position)[ -]+(?P<a>\S+) |(?P<b>\S+)\.Pos)(?P<axis>[XYZ])"
)
PLATE: Final = re.compile(
    r"FP(?P<number>\d*)(?: - |\.)(?P<what>For|Mom|Cop)(?:ce|ent|)? ?(?P<axis>[XYZ])", re.IGNORECASE
)


Channel = tuple[float, Array]
"""Rate [Hz] and samples."""


def read_mox(path: Path, options: ReadOptions) -> Recording:
    """Read a .mox file.

    Parameters
    ----------
    path
        The file.
    options
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
        channels, header = _channels(file.read())
    marked, on_plates = ({k: m for k in channels if (m := p.fullmatch(k))} for p in (MARKER, PLATE))
    stems = list(dict.fromkeys(m["a"] or m["b"] for m in marked.values()))
    if not stems:
        raise ValueError("no markers: no channel such as LASIS.PosX")
    parts = {f"{m['a'] or m['b']} {m['axis']}": channels[k] for k, m in marked.items()}
    columns, time = _on_one_clock(parts)
    table = TextTable(path, [], [])
    table.check_counts(header, {"nr_of_samples": len(time)})
    position = vectors(columns, (f"{stem} " for stem in stems))
    markers = file_markers(stems, "m", lambda kept: position[:, kept], options)
    of_plates = {
        f"FP{int(m['number'] or 1)}.{m['what'].capitalize()}{m['axis'].upper()}": channels[k]
        for k, m in on_plates.items()
    }
    plates = list(dflow_plates(*_on_one_clock(of_plates)))
    rest = {k: channel for k, channel in channels.items() if k not in {*marked, *on_plates}}
    # those of the commonest rate and length
    clocks = {name: (rate, len(samples)) for name, (rate, samples) in rest.items()}
    commonest = [clock for clock, _ in Counter(clocks.values()).most_common(1)]
    signals, times = _on_one_clock({k: rest[k] for k in rest if clocks[k] in commonest})
    analog = None
    if signals:
        values = np.column_stack([*signals.values()])
        analog = Analog(times, tuple(signals), ("",) * len(signals), values)
    if left_out := [name for name in rest if name not in signals]:
        table.remarks.append(Note.of("parts_left_out", parts=left_out))
    if plates:
        table.remarks.append(Note.of("force_sign_unconfirmed"))
    return recording_of(path, options, markers, time, plates, notes=table.remarks, analog=analog)


def _channels(content: bytes) -> tuple[dict[str, Channel], dict[str, str]]:
    """Give the channels by their names, and the header."""
    decoded(content)
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, LookupError) as error:
        raise ValueError(f"the XML is broken or truncated: {error}") from error
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    if root.tag != ROOT:
        raise ValueError(f"not a .mox file: its root is {short(root.tag)!r}, expected {ROOT!r}")
    elements = root.findall("viewer_data/viewer_channel")
    labels = [printable(e.findtext("channel_label", "").strip()) for e in elements]
    labels = told_apart(labels, MARKER)
    require_unique(labels, "several channels have the same label")
    channels: dict[str, Channel] = {}
    for element, name in zip(elements, labels, strict=True):
        text = element.findtext("raw_channel_data/channel_data", "")
        rate = element.findtext("raw_channel_data/sampling_frequency", "")
        where = f"channel {short(name)!r}"
        samples = np.array([read_number(word, where) for word in text.split()])
        channels[name] = read_rate(rate, f"sampling_frequency of {where}"), samples
    return channels, {e.tag: e.text or "" for e in root.findall("viewer_header/*")}


def _on_one_clock(parts: Mapping[str, Channel]) -> tuple[dict[str, Array], Array]:
    """Give samples and times, (N,) [s], of channels that belong together."""
    clocks = {(rate, len(samples)) for rate, samples in parts.values()}
    if len(clocks) > 1:
        raise ValueError(
            f"{short(next(iter(parts)))!r} and the like differ in rate or number of samples; the "
            "file is truncated or mixed"
        )
    ((rate, count),) = clocks or {(1.0, 0)}
    return {name: samples for name, (_, samples) in parts.items()}, np.arange(count) / rate
