"""Where the plates lie: as streams state it, or as a static recording has it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from hbm.notes import Note
from hbm.spelling import listed, short
from pipeline.config.live import Live
from pipeline.io.recording import Plate, Recording
from pipeline.live.stream import StatedPlate

MAX_DISTANCE_M: Final = 0.003
"""Between the centres of one plate: 3 mm change moments by 2 N·m under a body of 75 kg."""
MAX_ANGLE_DEG: Final = 0.5
"""Between its axes: half a degree turns 6 N of the body weight into a horizontal force."""


@dataclass(frozen=True, slots=True)
class PlacedPlates:
    """The plates of a session.

    Attributes
    ----------
    plates
        Where they lie, without samples, in the order of their numbers.
    live
        Which streams and channels are what, with the channels that the streams state.
    notes
        ``live_plate_elsewhere`` for each plate that streams and static recording have at different
        places.
    """

    plates: tuple[Plate, ...]
    live: Live
    notes: tuple[Note, ...] = ()


def place_plates(
    stated: Sequence[StatedPlate], static: Recording | None, live: Live
) -> PlacedPlates:
    """Find out where the plates lie, and which channels are theirs.

    Parameters
    ----------
    stated
        As the streams describe them.
    static
        Recording of the calibration pose, if there is one.
    live
        As the study states it; what it states of channels counts more than what streams state.

    Returns
    -------
    PlacedPlates
        A place that a stream states counts more than that of the static recording: it is of now,
        and of the axes in which the stream's own channels are. Where the study names other channels
        for the plate, it does not count.

    Raises
    ------
    ValueError
        Neither knows a place, or several streams state one plate's.

    Examples
    --------
    >>> time, still = np.empty(0), np.empty((0, 6))
    >>> corners = np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) / 4
    >>> plate = Plate(1, time, still, np.eye(3), np.zeros(3), corners)
    >>> channels = ("Fx1", "Fy1", "Fz1", "Mx1", "My1", "Mz1")
    >>> found = place_plates([StatedPlate("1", channels, plate)], None, Live())
    >>> found.plates[0].center.tolist(), found.live.channels_of(1)[2]
    ([0.0, 0.0, 0.0], 'Fz1')
    """
    used = [each for each in stated if live.plates.get(each.number, each.channels) == each.channels]
    placed = [each.number for each in used if each.place is not None]
    if several := sorted({number for number in placed if placed.count(number) > 1}):
        raise ValueError(f"several streams state the place of plate {listed(several)}")
    recorded = {str(plate.number): plate.place for plate in static.plates} if static else {}
    received = {each.number: each.place for each in used if each.place is not None}
    places = recorded | received
    if not places:
        raise ValueError(_unknown(stated, static))
    channels = {each.number: each.channels for each in stated if each.channels}
    file = static.source.name if static is not None else ""
    return PlacedPlates(
        tuple(sorted(places.values(), key=lambda plate: plate.number)),
        live.model_copy(update={"plates": channels | live.plates}),
        _elsewhere(received, recorded, file),
    )


def _elsewhere(
    received: Mapping[str, Plate], recorded: Mapping[str, Plate], file: str
) -> tuple[Note, ...]:
    """Compare the places of plates that are stated twice."""
    notes = []
    for number in sorted(received.keys() & recorded.keys()):
        now, then = received[number], recorded[number]
        if not (np.isfinite(now.corners).all() and np.isfinite(then.corners).all()):
            continue  # of one only the wrench about the lab's origin is known, not its place
        distance_m = float(np.linalg.norm(now.center - then.center))
        cosine = (np.trace(now.rotation.T @ then.rotation) - 1) / 2
        angle_deg = float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
        if distance_m > MAX_DISTANCE_M or angle_deg > MAX_ANGLE_DEG:
            values = {"distance_m": distance_m, "angle_deg": angle_deg}
            notes.append(Note.of("live_plate_elsewhere", plate=number, **values, file=file))
    return tuple(notes)


def _unknown(stated: Sequence[StatedPlate], static: Recording | None) -> str:
    """Say why no place is known, and what to do."""
    why = [f"plate {short(each.number)}: {each.problem}" for each in stated if each.problem]
    streams = "; ".join(why) or "the streams state none (desc/plates/plate)"
    file = "no static file is stated" if static is None else f"{static.source.name} has none"
    return (
        f"the places of the plates are not known: {streams}; {file}; state a recording that has "
        "them: --static FILE, or static in the subject's file"
    )
