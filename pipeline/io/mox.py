"""Motek's .mox files (XML)."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np

from hbm.markers import Markers
from hbm.notes import Note
from hbm.spatial import Array
from hbm.spelling import printable, short
from pipeline.io.axes import mean_force, parse_axes, settle_axes
from pipeline.io.input_file import naming, open_file
from pipeline.io.labels import marker_columns
from pipeline.io.moment_reference import PlateColumns, plates_about_origin
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
        header, channels, rates = _channels(file.read())
    marked = {k: m for k in channels if (m := MARKER.fullmatch(k))}
    stems = dict.fromkeys(m["a"] or m["b"] for m in marked.values())
    if not stems:
        raise ValueError("no markers: no channel such as LASIS.PosX")
    metre, unit_notes = stated.marker_unit("m")
    markers, subject, label_notes = marker_columns(list(stems), stated)
    rate, position = _vectors(
        {(m["a"] or m["b"], m["axis"]): k for k, m in marked.items()},
        [list(stems)[k] for k in markers.values()],
        channels,
        rates,
    )
    position *= metre
    position[~np.isfinite(position).all(axis=-1) | ~position.any(axis=-1)] = np.nan
    stated.check_span(position, "m")
    on_plates = {k: m for k in channels if (m := PLATE.fullmatch(k))}
    parts = {
        (f"{int(m['number'] or 1)} {m['what'].lower()}", m["axis"].upper()): k
        for k, m in on_plates.items()
    }
    numbers = dict.fromkeys(int(m["number"] or 1) for m in on_plates.values())
    columns, plate_notes = _plates(parts, numbers, channels, rates, stated)
    settled, axes_notes = settle_axes(
        stated.axes,
        position,
        tuple(markers),
        marker_set=stated.marker_set,
        plate_forces=[mean_force(plate.force) for plate in columns],
    )
    to_lab = parse_axes(settled)
    plates, moment_notes = plates_about_origin(columns, to_lab)
    rest = [k for k in channels if k not in marked and k not in on_plates]
    analog, analog_notes = _analog(rest, channels, rates, rate, len(position))
    if plates:
        moment_notes.append(Note.of("force_sign_unconfirmed"))
    return Recording(
        source=path,
        markers=Markers(np.arange(len(position)) / rate, tuple(markers), position @ to_lab.T),
        plates=plates,
        analog=analog,
        metadata=replace(header, subject=header.subject or subject),
        stated=stated,
        notes=(
            *axes_notes,
            *unit_notes,
            *label_notes,
            *plate_notes,
            *moment_notes,
            *analog_notes,
        ),
    )


def _channels(content: bytes) -> tuple[Metadata, dict[str, Array], dict[str, float]]:
    """Give what the header says, and each channel's samples and rate [Hz]."""
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
    channels: dict[str, Array] = {}
    rates: dict[str, float] = {}
    for element in root.iterfind("viewer_data/viewer_channel"):
        name = printable(element.findtext("channel_label", "").strip())
        if name in channels:
            raise ValueError(f"several channels have the label {short(name)!r}")
        words = element.findtext("raw_channel_data/channel_data", "").split()
        rate = element.findtext("raw_channel_data/sampling_frequency", "")
        rates[name] = read_number(rate, f"sampling_frequency of channel {short(name)!r}")
        try:
            channels[name] = np.array(words, float)
        except ValueError:
            channels[name] = np.array(
                [read_number(word, f"channel {short(name)!r}") for word in words]
            )
        if not 0 < rates[name] < MAX_RATE_HZ or not (np.abs(channels[name]) < MAX_VALUE).all():
            raise ValueError(
                f"channel {short(name)!r} holds a rate or value that cannot be measured"
            )
    if not channels:
        raise ValueError("it holds no channels (viewer_data/viewer_channel)")
    if count and all(str(len(samples)) != count for samples in channels.values()):
        raise ValueError(f"its header says nr_of_samples {count}, but no channel holds as many")
    return Metadata(subject=subject, date=date, comments=comments), channels, rates


def _vectors(
    parts: Mapping[tuple[str, str], str],
    stems: list[str],
    channels: Mapping[str, Array],
    rates: Mapping[str, float],
) -> tuple[float, Array]:
    """Stack channels of one clock: rate, and (samples, stems, 3)."""
    if absent := [f"{s} {a}" for s in stems for a in "XYZ" if (s, a) not in parts]:
        raise ValueError(f"there is no channel for {short(absent[0])}")
    used = [parts[stem, axis] for stem in stems for axis in "XYZ"]
    if len(clocks := {(rates[k], len(channels[k])) for k in used}) > 1:
        raise ValueError(
            f"the channels of {short(stems[0])} and the like differ in rate or number of samples; "
            "the file is truncated or mixed"
        )
    ((rate, count),) = clocks
    if count < 2:
        raise ValueError(f"{short(used[0])!r} holds {count} samples, expected at least 2")
    stacked = np.stack([channels[k] for k in used], axis=1)
    return rate, stacked.reshape(count, len(stems), 3)


def _plates(
    parts: Mapping[tuple[str, str], str],
    numbers: Iterable[int],
    channels: Mapping[str, Array],
    rates: Mapping[str, float],
    stated: Stated,
) -> tuple[list[PlateColumns], list[Note]]:
    """Give the channels of the plates that have all of them, and notes on units and the others."""
    units = {
        "for": stated.force_unit("N"),
        "mom": stated.moment_unit("Nm"),
        "cop": stated.pressure_unit("m"),
    }
    found, notes = [], [*stated.plate_notes(["N"], ["Nm"], ["m"])]
    for number in numbers:
        name = f"plate {number}"
        present = [q for q in units if q != "cop" or (f"{number} cop", "X") in parts]
        needed = [(f"{number} {quantity}", axis) for quantity in present for axis in "XYZ"]
        if absent := [" ".join(part) for part in needed if part not in parts]:
            reason = f"there is no channel for {absent[0]}"
            notes.append(Note.of("plate_left_out", plate=name, reason=reason))
            continue
        rate, vectors = _vectors(parts, [f"{number} {q}" for q in present], channels, rates)
        scaled = (
            vector * units[quantity]
            for quantity, vector in zip(present, vectors.transpose(1, 0, 2), strict=True)
        )
        force, moment, *pressure = scaled
        time = np.arange(len(force)) / rate
        found.append(PlateColumns(number, name, time, force, moment, next(iter(pressure), None)))
    return found, notes


def _analog(
    names: list[str],
    channels: Mapping[str, Array],
    rates: Mapping[str, float],
    marker_rate: float,
    frames: int,
) -> tuple[Analog | None, list[Note]]:
    """Give the channels of the commonest rate and length, and note which are left out."""
    clocks = Counter((rates[k], len(channels[k])) for k in names)
    if not clocks:
        return None, []
    clock = max(sorted(clocks), key=lambda c: (clocks[c], c == (marker_rate, frames)))
    kept: list[str] = []
    left: list[str] = []
    for name in names:
        (kept if (rates[name], len(channels[name])) == clock else left).append(name)
    time = np.arange(clock[1]) / clock[0]
    values = np.column_stack([channels[k] for k in kept])
    notes = [Note.of("channels_left_out", channels=left)] if left else []
    return Analog(time, tuple(kept), ("",) * len(kept), values), notes
