"""Motek's .mox files (XML)."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np

from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import printable, short
from pipeline.io.columns import PlateColumns, file_markers, left_out, recording_of
from pipeline.io.input_file import naming, open_file
from pipeline.io.recording import Analog, Metadata, Recording
from pipeline.io.stated import Stated, as_stated
from pipeline.io.text_table import decoded, read_number

ROOT: Final = "moxie_viewer_datafile"
MAX_RATE_HZ: Final = 1e6
MAX_VALUE: Final = 1e9
"""Beyond these nothing was measured: the file is damaged."""
MARKER: Final = re.compile(
    r"(?:(?:Marker|Position)[ -]+(?P<a>\S+) |(?P<b>\S+)\.Pos)(?P<axis>[XYZ])"
)
PLATE: Final = re.compile(
    r"FP(?P<number>\d*)(?: - |\.)(?P<what>For|Mom|Cop)(?:ce|ent|)? ?(?P<axis>[XYZ])", re.IGNORECASE
)


Channel = tuple[float, Array]
"""Rate [Hz] and samples."""


def read_mox(path: str | Path, stated: Stated | str | None = None) -> Recording:
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
    path = Path(path)
    with naming(path):
        return _read(path, as_stated(stated))


def _read(path: Path, stated: Stated) -> Recording:
    with open_file(path) as file:
        header, channels = _channels(file.read())
    marked, on_plates = ({k: m for k in channels if (m := p.fullmatch(k))} for p in (MARKER, PLATE))
    stems = list(dict.fromkeys(m["a"] or m["b"] for m in marked.values()))
    if not stems:
        raise ValueError("no markers: no channel such as LASIS.PosX")
    parts = {f"{m['a'] or m['b']} {m['axis']}": channels[k] for k, m in marked.items()}
    rate, position = _vectors(parts, stems)
    markers = file_markers(stems, "m", lambda kept: position[:, kept], stated)
    parts = {
        f"{int(m['number'] or 1)} {m['what'].lower()} {m['axis'].upper()}": channels[k]
        for k, m in on_plates.items()
    }
    numbers = dict.fromkeys(int(m["number"] or 1) for m in on_plates.values())
    plates = [_plate(number, parts) for number in numbers]
    rest = {k: channel for k, channel in channels.items() if k not in {*marked, *on_plates}}
    analog, notes = _analog(rest, (rate, len(position)))
    if plates:
        notes.append(Note.of("force_sign_unconfirmed"))
    return recording_of(
        path,
        stated,
        markers,
        np.arange(len(position)) / rate,
        plates,
        notes=notes,
        analog=analog,
        metadata=replace(header, subject=header.subject or markers.subject),
    )


def _channels(content: bytes) -> tuple[Metadata, dict[str, Channel]]:
    """Give what the header says, and each channel's rate [Hz] and samples."""
    decoded(content)
    try:
        root = ElementTree.fromstring(content)
    except (ElementTree.ParseError, LookupError) as error:
        raise ValueError(f"the XML is broken or truncated: {error}") from error
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    if root.tag != ROOT:
        raise ValueError(f"not a .mox file: its root is {short(root.tag)!r}, expected {ROOT!r}")
    subject, date, comments, count = (
        printable(root.findtext(f"viewer_header/{tag}", "").strip())
        for tag in ("patient_id", "trial_date", "comments", "nr_of_samples")
    )
    channels: dict[str, Channel] = {}
    for element in root.iterfind("viewer_data/viewer_channel"):
        name = printable(element.findtext("channel_label", "").strip())
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
    return Metadata(subject=subject, date=date, comments=comments), channels


def _vectors(parts: Mapping[str, Channel], stems: Sequence[str]) -> tuple[float, Array]:
    """Stack channels "stem X", "stem Y", "stem Z" of one clock: rate and (samples, stems, 3)."""
    names = [f"{stem} {axis}" for stem in stems for axis in "XYZ"]
    if absent := [name for name in names if name not in parts]:
        raise ValueError(f"there is no channel for {short(absent[0])}")
    if len(clocks := {(parts[name][0], len(parts[name][1])) for name in names}) > 1:
        raise ValueError(
            f"the channels of {short(stems[0])} and the like differ in rate or number of samples; "
            "the file is truncated or mixed"
        )
    ((rate, count),) = clocks
    if count < 2:
        raise ValueError(f"{short(names[0])!r} holds {count} samples, expected at least 2")
    stacked = np.stack([parts[name][1] for name in names], axis=1)
    return rate, stacked.reshape(count, len(stems), 3)


def _plate(number: int, parts: Mapping[str, Channel]) -> PlateColumns | Note:
    """Give the channels of a plate, or why it is left out."""
    stems = [f"{number} for", f"{number} mom"]
    stems += [f"{number} cop"] * (f"{number} cop X" in parts)
    needed = [f"{stem} {axis}" for stem in stems for axis in "XYZ"]
    if absent := [name for name in needed if name not in parts]:
        return left_out(f"plate {number}", f"there is no channel for {absent[0]}")
    rate, vectors = _vectors(parts, stems)
    time = np.arange(len(vectors)) / rate
    return PlateColumns(number, f"plate {number}", time, *vectors.transpose(1, 0, 2))


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
