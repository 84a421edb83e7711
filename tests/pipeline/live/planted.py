"""The most frequent faults of a session, planted in a virtual laboratory's recording."""

from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from hbm.markers import Markers
from pipeline.config.schema import Platform, Settings, Subject, Treadmill
from pipeline.live.chain import LiveFrame
from pipeline.live.monitor import Monitor
from pipeline.live.replay import recorded_streams
from pipeline.live.session import rehearse
from pipeline.trial.ground.calibrations import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.viewer.live import Board
from tests.pipeline import lab
from tests.pipeline.live.playing import body_of

SECONDS = 13.0
FAULT_S = SECONDS - 4.0
REQUIRED = 6
PERSON = Subject(sex="male", mass_kg=74.6)
REALTIME = Settings(filter="realtime")
EXPECTED = {
    "none": ("good", "gait cycles used: end with Ctrl-C"),
    "marker lost": ("look", "LASIS is hidden: turn a camera or re-attach the marker"),
    "plate not zeroed": ("stop", "Plate 1 reads 15 N without load: step off and zero it"),
    "plates late": ("look", "ms later than the markers: set plate_delay_s = 0.0"),
    "foot beside the plate": (
        "stop",
        "A foot is beside its plate: ask the subject to walk on the plates",
    ),
    "forward force doubled": ("look", "Fx, My, Mz above healthy walking: check markers"),
    "platform sensor dead": (
        "stop",
        "Platform sensor front_right is dead: check its power and its cable",
    ),
}
"""Fault -> the light's colour, and what its sentence says."""


@dataclass(frozen=True)
class Played:
    """A session at its end, all of whose samples have arrived."""

    monitor: Monitor
    frames: list[LiveFrame]
    board: Board


def planted(walk, fault):
    """Give the walk with a fault."""
    plates, markers, analog = walk.plates, walk.markers, walk.analog
    if fault == "marker lost":
        position = markers.position.copy()
        position[markers.time > FAULT_S, markers.names.index("LASIS")] = np.nan
        markers = Markers(markers.time, markers.names, position)
    elif fault == "plate not zeroed":
        up = np.r_[15.0 * plates[0].rotation[2], np.zeros(3)]
        plates = (replace(plates[0], wrench_in_plate=plates[0].wrench_in_plate + up), plates[1])
    elif fault == "plates late":
        plates = tuple(replace(plate, time=plate.time + 0.015) for plate in plates)
    elif fault == "foot beside the plate":
        on = (plates[1].time < FAULT_S)[:, None]
        plates = (plates[0], replace(plates[1], wrench_in_plate=plates[1].wrench_in_plate * on))
    elif fault == "forward force doubled":
        gain = 1 + np.abs(plates[0].rotation[0] @ np.eye(3, 6))
        scaled = (replace(p, wrench_in_plate=p.wrench_in_plate * gain) for p in plates)
        plates = tuple(scaled)
    elif fault == "platform sensor dead":
        values = analog.values.copy()
        columns = [analog.names.index(name) for name in lab.CHANNELS["front_right"]]
        values[np.ix_(analog.time > FAULT_S - 8, columns)] = 0.0
        analog = replace(analog, values=values)
    return replace(walk, plates=plates, markers=markers, analog=analog)


class VirtualLaboratory:
    """A walk on a treadmill that stands still, and on one that pitches with two accelerometers."""

    def __init__(self, folder):
        self.walk = lab.walk(folder, duration_s=SECONDS)
        self.body = body_of(self.walk, PERSON)
        platform = Platform(markers=tuple(lab.PLATFORM_MARKERS_M))
        treadmill = Treadmill(accelerometers=lab.CHANNELS, platform=platform)
        empty = lab.on_platform(lab.without_people(20.0), lab.shaken(20.0))
        self.moving = Laboratory(treadmill, fit_calibration(empty, treadmill))
        self._played = {}

    def played(self, fault):
        """Play the walk with a fault to its end, once; the monitor is the caller's own."""
        if fault not in self._played:
            self._played[fault] = self._play(fault)
        played = self._played[fault]
        chain = played.monitor.chain
        return replace(played, monitor=deepcopy(played.monitor, {id(chain): chain}))

    def _play(self, fault):
        recording, laboratory = self.walk, Laboratory(Treadmill())
        if fault == "platform sensor dead":
            laboratory = self.moving
            recording = lab.on_platform(recording, lab.pitching(SECONDS, degrees=5.0))
        recording = planted(recording, fault)
        frames, monitor = rehearse(recording, self.body, REALTIME, laboratory, REQUIRED)
        streams = [stream.description for stream in recorded_streams(recording)]
        return Played(monitor, frames, monitor.board(streams))
