"""One walk in a folder, the same for every implementation: body, markers and forces."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hbm.body import Body
from hbm.coordinates import COORDINATES
from hbm.dynamics import filter_motion, inverse_dynamics
from hbm.ik.tracking import solve_ik
from hbm.markers import Markers
from hbm.motion import Motion
from hbm.poses import marker_positions
from hbm.spatial import Array
from pipeline.export.models import write_osim, write_urdf
from pipeline.export.tables import write_coordinates, write_external_loads, write_trc
from tests.benchmarks.walker import TRANSLATIONS, Walk
from tests.synthetic import synthetic_body

TIGHT = 1e-12


@dataclass(frozen=True)
class Trial:
    """A walk with its optimum and its forces; ``markers`` are the measured ones."""

    folder: Path
    body: Body
    markers: Markers
    optimum: Motion
    motion: Motion
    tau: Array

    def marker_rms(self, q: Array) -> float:
        """RMS distance of the measured markers from the model [m]."""
        columns = [self.body.markers.index(name) for name in self.markers.names]
        error = marker_positions(self.body, q)[:, columns] - self.markers.position
        return float(np.sqrt(np.nanmean(np.sum(error**2, axis=-1))))

    def from_optimum(self, q: Array) -> Array:
        """Distance of all observed coordinates from the optimum [rad or m]; NaN elsewhere."""
        return np.where(self.optimum.observed, np.abs(q - self.optimum.q), np.nan)


def write_trial(folder: Path, walk: Walk) -> Trial:
    """Solve a walk and write what our own worker reads."""
    folder.mkdir(exist_ok=True)
    body, markers = synthetic_body(), walk.markers
    raw = solve_ik(body, markers, tolerance=TIGHT)
    motion = filter_motion(raw)
    np.savez(
        folder / "trial.npz",
        time=walk.time,
        coordinates=COORDINATES,
        translations=TRANSLATIONS,
        markers=markers.names,
        position=markers.position,
        start=raw.q[0],
        raw=[raw.q, raw.v, raw.a],
        motion=[motion.q, motion.v, motion.a],
        **walk.wrenches,
    )
    tau = inverse_dynamics(body, motion, walk.wrenches).tau
    return Trial(folder, body, markers, raw, motion, tau)


def export_trial(trial: Trial, walk: Walk) -> None:
    """Write what the other programs read."""
    write_osim(trial.body, trial.folder / "body.osim")
    write_urdf(trial.body, trial.folder / "body.urdf")
    write_trc(trial.markers, trial.folder / "markers.trc")
    write_coordinates(trial.motion, trial.folder / "coordinates.mot")
    write_external_loads(walk.time, walk.wrenches, trial.folder / "grf.mot")
