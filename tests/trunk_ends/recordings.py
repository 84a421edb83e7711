"""Real recordings with markers and plates: body, motion and wrenches of each."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from hbm.body import Body, build_body
from hbm.calibration_pose.anatomy import HipRule, Measures
from hbm.calibration_pose.functional import functional_hips
from hbm.dynamics import filter_motion, inverse_dynamics
from hbm.kinematics import solve_ik
from hbm.markers import Markers, MarkerSet, marker_sets, read_marker_set
from hbm.motion import Motion
from hbm.segments import Sex
from hbm.signals.filtering import butterworth
from hbm.signals.resampling import resample
from hbm.spatial import GRAVITY_MPS2, Array
from pipeline.io.c3d.read import read_c3d
from pipeline.io.opensim import read_opensim_trial, read_trc

HERE: Final = Path(__file__).resolve().parent
CUTOFF_HZ: Final = 6.0
OPENSIM_AXES: Final = "forward,up,right"


class Plate(Protocol):
    """What is needed of a force plate: ``wrench``, (N, 6) [N, N·m], at ``time``, (N,) [s]."""

    @property
    def time(self) -> Array: ...
    @property
    def wrench(self) -> Array: ...


@dataclass(frozen=True, slots=True)
class Case:
    """One recording, ready for inverse dynamics.

    Attributes
    ----------
    body
        The subject's.
    calibration
        The recording that the body was built from.
    measures
        What it was built with.
    markers
        The recording itself.
    motion
        Filtered motion.
    wrenches
        Foot -> filtered wrench on it, (T, 6).
    counted
        Frames that count, (T,): both feet on the plates, filter settled.
    """

    body: Body
    calibration: Markers
    measures: Measures
    markers: Markers
    motion: Motion
    wrenches: dict[str, Array]
    counted: Array

    def residual(self, body: Body) -> Array:
        """Pelvis residual with a body that differs in inertia alone, (frames that count, 6)."""
        return inverse_dynamics(body, self.motion, self.wrenches).residual[self.counted]


def treadmill(data: Path) -> Case:
    """Twelve seconds on a split-belt treadmill; no calibration pose, no head and arms."""
    recording = read_c3d(data / "treadmill_hbm2" / "treadmill_events.c3d")
    return _case(recording.markers, recording.plates, None, sex="female", height_m=1.72)


def quiet_standing(data: Path) -> Case:
    """Six seconds of quiet standing on two plates, arms and head shown."""
    recording = read_c3d(data / "full_body_standing" / "1min_CGM_HBM_static.c3d")
    return _case(recording.markers, recording.plates, _read(HERE / "quiet_standing.toml"))


def gait2354(data: Path) -> Case:
    """OpenSim's example: overground walking over two plates; C7, T10 and xiphoid are not shown."""
    folder = data / "opensim_subject01"
    static = read_trc(folder / "subject01_static.trc", OPENSIM_AXES).markers
    walk = read_opensim_trial(
        folder / "subject01_walk1.trc", folder / "subject01_walk1_grf.mot", OPENSIM_AXES
    )
    chosen = marker_sets()["gait2354"]
    window = (0.4, 1.6)  # that of OpenSim's own published residuals
    return _case(
        walk.markers, walk.plates[::-1], chosen, calibration=static, mass=72.6, window_s=window
    )


def two_plates(data: Path) -> Case:
    """Overground walking over two plates with trunk and legs; T10 is not shown."""
    recording = read_c3d(data / "c3d_samples" / "Gait.c3d")
    seen = np.flatnonzero(np.isfinite(recording.markers.position).all(axis=(1, 2)))
    inside = slice(seen[0], seen[-1] + 1)
    whole = recording.markers
    markers = Markers(whole.time[inside], whole.names, whole.position[inside])
    unloaded = 1000  # the first second, before anybody steps on the plates
    plates = [Zeroed(p.time, p.wrench - p.wrench[:unloaded].mean(axis=0)) for p in recording.plates]
    return _case(markers, plates, marker_sets()["helen_hayes_lower"], window_s=(2.2, 2.96))


def stairs(data: Path) -> Case:
    """Down four steps, each a plate, with Plug-in-Gait's markers; arms are not shown."""
    folder = data / "plug_in_gait"
    recording = read_c3d(folder / "Movement_trial.c3d")
    static = read_c3d(folder / "Static_trial.c3d").markers
    plates = recording.plates
    total = [Zeroed(plates[0].time, np.sum([p.wrench for p in plates], axis=0))]
    return _case(
        recording.markers,
        total,
        _read(HERE / "plug_in_gait.toml"),
        calibration=static,
        sex="male",
        height_m=1.679,
        window_s=(0.59, 2.41),
    )


def generated_walk(data: Path) -> Case:
    """A walk generated from an OpenSim model with rigid markers; T10 and xiphoid are not shown."""
    folder = data / "truth_walk"
    walk = read_opensim_trial(folder / "markers.trc", folder / "grf.mot", OPENSIM_AXES)
    chosen = marker_sets()["rajagopal"]
    return _case(
        walk.markers,
        walk.plates[::-1],
        chosen,
        mass=72.84,
        sex="male",
        height_m=1.808,
        hip=functional_hips(walk.markers, chosen),
    )


CASES: Final[dict[str, Callable[[Path], Case]]] = {
    "treadmill": treadmill,
    "quiet standing": quiet_standing,
    "OpenSim's example": gait2354,
    "two plates": two_plates,
    "stairs": stairs,
    "generated walk": generated_walk,
}
"""Title -> recording, from the folder of the real recordings."""


@dataclass(frozen=True, slots=True)
class Zeroed:
    time: Array
    wrench: Array


def _read(path: Path) -> MarkerSet:
    return read_marker_set(path.read_text(encoding="utf-8"), path.stem)


def _case(
    markers: Markers,
    plates: Sequence[Plate],
    marker_set: MarkerSet | None,
    *,
    calibration: Markers | None = None,
    mass: float | None = None,
    sex: Sex = "unspecified",
    height_m: float | None = None,
    hip: HipRule | dict[str, Array] = "harrington",
    window_s: tuple[float, float] = (-np.inf, np.inf),
) -> Case:
    """Build the body and follow it; plates in the order left, right.

    Without a stated mass, it is the mean vertical force in the frames that count.
    """
    time = markers.time
    settle = 0.5 if np.isinf(window_s).all() and time[-1] - time[0] > 2 else 0.1
    low, high = max(window_s[0], time[0] + settle), min(window_s[1], time[-1] - settle)
    counted = (time > low - 1e-3) & (time < high + 1e-3)
    feet = dict(zip(("left_foot", "right_foot"), plates, strict=False))
    wrenches = {foot: _filtered(plate, time) for foot, plate in feet.items()}
    if mass is None:
        mass = float(_vertical(wrenches.values())[counted].mean()) / GRAVITY_MPS2
    calibration = calibration or markers
    body = build_body(
        calibration, mass=mass, sex=sex, height_m=height_m, marker_set=marker_set, hip=hip
    )
    motion = filter_motion(solve_ik(body, markers), cutoff=CUTOFF_HZ, method="zero_phase")
    return Case(body, calibration, Measures(sex, hip), markers, motion, wrenches, counted)


def _filtered(plate: Plate, time: Array) -> Array:
    wrench = resample(plate.time, plate.wrench, time)
    return butterworth(wrench, time, CUTOFF_HZ, "zero_phase").value


def _vertical(wrenches: Iterable[Array]) -> Array:
    return np.sum([wrench[:, 2] for wrench in wrenches], axis=0)
