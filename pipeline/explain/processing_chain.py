"""The stages of a trial with inputs that can be changed one by one, down to its residual.

The stages are those of `pipeline.trial.stages` and `pipeline.trial.ground.wrenches`; here are their
inputs, and what depends on which.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final, Self

import numpy as np

from compensation import PlatformPose
from hbm.body import FEET
from hbm.engines.engine import kernels_engine
from hbm.markers import Markers
from hbm.model import Body
from hbm.signals.filtering import Filtered, butterworth, low_pass
from hbm.spatial import Array, shift_wrench
from pipeline.config.schema import Settings
from pipeline.io.recording import Plate, Recording
from pipeline.trial.ground.corrected_plates import with_corrected_plates
from pipeline.trial.ground.laboratory import BoundLaboratory, Laboratory, bind
from pipeline.trial.ground.platform import in_lab
from pipeline.trial.ground.wrenches import ground_wrenches
from pipeline.trial.result import TrialResult
from pipeline.trial.stages import solve_pose

COMPUTED_FROM: Final[Mapping[str, frozenset[str]]] = {
    "motion": frozenset({"settings", "q"}),
    "needed": frozenset({"settings", "q", "body"}),
    "ground": frozenset({"settings", "wrenches", "pose", "lab"}),
}
"""What a chain computes when it is first asked for -> the fields on which it depends."""


@dataclass(frozen=True, eq=False)
class ProcessingChain:
    """What the residual of a trial is computed from, and the residual.

    Attributes
    ----------
    time
        Frame times, (T,) [s].
    settings
        Filter and cut-off frequency.
    body
        The subject's body.
    markers
        Trajectories as the inverse kinematics was given them, T frames.
    q
        Coordinates before the filter, (T, 46) [m and rad].
    wrenches
        Per plate, in its own axes about the centre of its surface, at the frames and before the
        filter, compensated where the trial is, (T, 6) [N, N·m].
    pose
        The platform's pose, T frames; None where it stands still.
    lab
        The laboratory in this recording: where the plates are with the platform in neutral, and the
        models by which they were compensated.
    felt
        Per plate what its inertia model takes of the accelerometers, (T, K) [m/s²]; empty without a
        calibration of the platform.
    belts
        Per plate the wrench of its accelerating belt that was subtracted, in its own axes, (T, 6)
        [N, N·m]; empty without a calibration of the belts.
    shoes_stated
        Whether the subject's shoes are stated, or what else the feet carry or weigh.
    soft_tissue
        What soft tissue adds to the wrench on the ground, as `ground`: nothing unless a cause does.
    """

    time: Array
    settings: Settings
    body: Body
    markers: Markers
    q: Array
    wrenches: tuple[Array, ...]
    pose: PlatformPose | None
    lab: BoundLaboratory
    felt: tuple[Array, ...] = ()
    belts: tuple[Array, ...] = ()
    shoes_stated: bool = False
    soft_tissue: Array = field(default_factory=lambda: np.zeros(6))

    @property
    def plates(self) -> tuple[Plate, ...]:
        """Where the plates are with the platform in neutral."""
        return self.lab.recording.plates

    @property
    def sensors_apart_s(self) -> float:
        """By how much the accelerometers' delays differ, one standard deviation [s].

        Accelerometers on one converter are equally late: where a platform bends, the calibration
        takes bending for delay.
        """
        delays = [sensor.correction_s for sensor in self.lab.sensors]
        return float(np.std(delays, ddof=1)) if len(delays) > 1 else 0.0

    @cached_property
    def motion(self) -> Filtered:
        """Filtered coordinates and their derivatives, (T, 46)."""
        return butterworth(self.q, self.time, self.settings.cutoff_hz, self.settings.filter)

    @cached_property
    def needed(self) -> Array:
        """Wrench that the motion needs, (T, 6) [N, N·m]: lab axes about the pelvis origin."""
        return needed_wrench(self.body, self.motion)

    @cached_property
    def ground(self) -> Array:
        """Filtered sum of the plates' wrenches, (T, 6) [N, N·m]: lab axes about the lab origin."""
        moved = in_lab(self.wrenches, self.plates, self.pose)
        return self.low_pass(sum(moved, start=np.zeros((len(self.time), 6))))

    @property
    def residual(self) -> Array:
        """Wrench on the pelvis that closes the equations of motion, (T, 6) [N, N·m].

        Lab axes (X forward, Y left, Z up) about the pelvis origin.
        """
        on_ground = self.ground + self.soft_tissue
        return self.needed - shift_wrench(on_ground, self.motion.value[:, :3])

    def changed(self, **fields: Any) -> Self:
        """Give the chain with other fields; what does not depend on them is not computed again."""
        other = replace(self, **fields)
        for name, inputs in COMPUTED_FROM.items():
            if name in self.__dict__ and inputs.isdisjoint(fields):
                other.__dict__[name] = self.__dict__[name]
        return other

    def low_pass(self, signal: Array) -> Array:
        """Pass a signal at the frames, (T, …), through the filter of the trial."""
        return low_pass(signal, self.time, self.settings.cutoff_hz, self.settings.filter)


def needed_wrench(body: Body, motion: Filtered) -> Array:
    """Give the wrench that a motion needs where gravity acts, (T, 6) [N, N·m].

    Lab axes about the pelvis origin.
    """
    state = motion.value, motion.velocity, motion.acceleration
    _, wrench, _ = kernels_engine().free_dynamics(body, *state, (), 1)
    return wrench


def processing_chain(
    recording: Recording,
    laboratory: Laboratory,
    result: TrialResult,
    frames: slice | None = None,
) -> ProcessingChain:
    """Pass a trial through the stages that its residual is computed in.

    Parameters
    ----------
    recording
        The trial as read.
    laboratory
        The treadmill and its calibrations, as when it was processed.
    result
        The processed trial.
    frames
        Frames of it, one after another; by default all.

    Returns
    -------
    ProcessingChain
        Of these frames. Its residual is that of the trial as reported, compensated where the trial
        is, but for the settling of the filter at the ends of `frames`.

    Examples
    --------
    >>> import numpy as np
    >>> import pipeline
    >>> from pipeline.config.schema import Treadmill
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> result = pipeline.process_recording(walk, pipeline.Subject(sex="male"), pipeline.Settings())
    >>> chain = processing_chain(walk, Laboratory(Treadmill()), result)
    >>> bool(np.nanmax(np.abs(chain.residual - result.measured.residual)) < 1e-6)
    True
    """
    frames = frames or slice(None)
    recording = with_corrected_plates(recording, laboratory.plates)
    settings, whole = result.settings, recording.markers
    cut = Markers(whole.time[frames], whole.names, whole.position[frames])
    pose = solve_pose(result.body, cut, settings, [])
    # of the whole trial: neutral is where the platform is at its start
    lab = bind(recording, laboratory, settings.plate_delay_s)
    times = result.motion.time
    ground = ground_wrenches(lab, times, [], settings.cutoff_hz, settings.filter)
    platform = ground.pose
    if platform is not None:
        platform = PlatformPose(platform.rotation[frames], platform.position[frames])
    return ProcessingChain(
        time=times[frames],
        settings=settings,
        body=result.body,
        markers=pose.markers,
        q=pose.solved.q,
        wrenches=tuple(wrench[frames] for wrench in ground.in_plates[ground.best]),
        pose=platform,
        lab=lab,
        felt=tuple(each[frames] for each in ground.felt),
        belts=tuple(each[frames] for each in ground.belts),
        shoes_stated=result.subject.shoe_mass_kg is not None
        or not set(FEET).isdisjoint(result.overridden_segments),
    )
