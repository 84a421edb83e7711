"""A trial from its inputs to what counts of it: each stage is computed when it is asked for.

A chain with other inputs, settings or stages, `Chain.changed`, shares all that does not depend on
them: variants of a study, the mass by steps, corrections that are tried, and explanations are
chains that were changed.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import cache, cached_property
from typing import Any, Final, NamedTuple, Self

import numpy as np

from compensation import PlatformPose
from hbm.body import FEET, Body
from hbm.kernels.native import kernels
from hbm.markers import Markers, MarkerSet, marker_sets, recognise_marker_set
from hbm.motion import Motion
from hbm.notes import Note
from hbm.plausibility.motion import held_coordinates
from hbm.plausibility.outliers import solve_motion
from hbm.signals.filtering import Filtered, butterworth, low_pass
from hbm.spatial import GRAVITY_MPS2, Array, Indices, Mask, shift_wrench
from pipeline.config.schema import Settings
from pipeline.io.mended_plates import mended_plates
from pipeline.io.read_options import parse_mending
from pipeline.io.recording import Event, Plate, Recording
from pipeline.trial.checks import MarkerChecks, check_markers
from pipeline.trial.findings.drift import Zero, following, with_followed_zeros, zeros_of
from pipeline.trial.findings.evidence import Evidence, weight_of_steps
from pipeline.trial.findings.judge import Fitted, judge_plates
from pipeline.trial.findings.raw import RawFault, raw_faults
from pipeline.trial.findings.zeros import readings_without_load
from pipeline.trial.gait.detection import detect_events, foot_motion, plate_events
from pipeline.trial.gait.events import FoundEvents, Swings, choose_method, foot_swings
from pipeline.trial.ground.laboratory import (
    BoundLaboratory,
    bind,
    corrections_used,
    with_corrected_plates,
)
from pipeline.trial.ground.platform import in_lab, uncompensated_motion
from pipeline.trial.ground.wrenches import Ground, ground_wrenches, plate_loads
from pipeline.trial.inputs import Inputs
from pipeline.trial.quality import NO_SUPPORT, free_of, settling_s
from pipeline.trial.result import EventOrigin, Procedure
from pipeline.trial.stages import (
    Loads,
    PlateDelay,
    Pose,
    dynamics_under_feet,
    filtered_pose,
    frame_quality,
    plate_delay,
)
from pipeline.trial.subject import (
    BodyMass,
    MassUnknownError,
    body_mass,
    roughly_weighed,
    subject_body,
)
from pipeline.trial.window import Counted, what_counts

FILTER: Final = "settings.cutoff_hz settings.filter"
OF_FEET: Final = "static.markers marker_set laboratory settings.marker_set"
DEPENDS_ON: Final[Mapping[str, str]] = {
    "trial": f"recording {OF_FEET} settings.filter",
    "standing": "static trial",
    "zeros": f"trial {OF_FEET}",
    "mass": (
        "recording static subject segments marker_set static_window_s laboratory contacts"
        " settings.marker_set settings.filter"
    ),
    "body": (
        "mass static.markers static.metadata recording.markers recording.metadata subject segments"
        " marker_set static_window_s hip_trial settings.hip settings.marker_set"
        " settings.marker_offset_m"
    ),
    "solved": "body recording.markers settings.filter",
    "pose": f"solved {FILTER}",
    "lab": "trial laboratory settings.plate_delay_s",
    "ground": f"lab recording.markers {FILTER}",
    "moves": "trial body laboratory",
    "loads": f"body pose ground contacts settings.contact_threshold_n {FILTER}",
    "settling": f"laboratory {FILTER}",
    "unloaded": "body ground recording.markers",
    "quality": f"body pose ground loads unloaded settling settings.contact_threshold_n {FILTER}",
    "labels": "body trial static.markers",
    "delay": f"loads ground quality {FILTER}",
    "evidence": f"body pose ground loads unloaded quality {FILTER}",
    "raw_faults": "recording.plates",
    "judged": "mass evidence ground moves labels raw_faults",
    "carried_kg": "judged evidence",
    "gait": "trial lab body pose ground loads quality settings.events",
    "window": "trial gait quality condition settling ground settings.min_valid_share",
    "markers": "solved",
    "q": "pose",
    "wrenches": "ground",
    "platform": "ground",
    "accelerations": "ground",
    "belts": "ground",
    "soft_tissue": "",
    "filtered": f"q recording.markers {FILTER}",
    "needed": "body filtered",
    "on_ground": f"wrenches platform lab {FILTER}",
}
"""Stage -> the stages, inputs (some with a field), and settings that it is computed from."""


class Solved(NamedTuple):
    """What inverse kinematics found: the markers that it used, the motion, and what it left out."""

    markers: Markers
    motion: Motion
    outliers: tuple[Note, ...]


class Gait(NamedTuple):
    """Gait events, what shows them, where the feet are from the pelvis, (T, 2, 3) [m], doubts."""

    found: FoundEvents
    origin: EventOrigin
    feet: Array
    doubts: tuple[Note, ...]

    @property
    def events(self) -> tuple[Event, ...]:
        """In order of time."""
        return self.found.events


class Chain:
    """A trial and its stages.

    Parameters
    ----------
    inputs, settings
        What is processed, and how.
    jobs
        Threads.

    Raises
    ------
    ValueError
        From a stage that is asked for: what it lacks, or what is wrong with its inputs.

    Examples
    --------
    >>> import pipeline
    >>> from pipeline.trial.inputs import Inputs
    >>> from pipeline.virtual_lab.protocol.walking_trial import simulate_trial
    >>> _ = simulate_trial("walk.c3d", duration_s=8.0)
    >>> walk = pipeline.read_c3d("walk.c3d")
    >>> chain = Chain(Inputs(recording=walk, subject=pipeline.Subject(sex="male")), Settings())
    >>> body, pose = chain.body, chain.pose
    >>> higher = chain.changed(settings=Settings(cutoff_hz=8.0))
    >>> higher.body is body, higher.pose is pose
    (True, False)
    """

    def __init__(self, inputs: Inputs, settings: Settings, *, jobs: int = 1) -> None:
        self.inputs, self.settings, self.jobs = inputs, settings, jobs
        self._given = frozenset[str]()

    def changed(self, **changes: Any) -> Self:
        """Give the chain with other inputs, settings or stages.

        A stage that is given stays as it is, whatever it depended on.
        """
        # what is given is a stage, the settings, or an input
        stages = {name: value for name, value in changes.items() if name in DEPENDS_ON}
        others = {name: changes[name] for name in changes.keys() - stages.keys() - {"settings"}}
        settings = changes.get("settings", self.settings)
        other = type(self)(replace(self.inputs, **others), settings, jobs=self.jobs)
        # stages, inputs and settings that differ from those of this chain
        altered = {name for name in stages if stages[name] is not self.__dict__.get(name)}
        altered |= {*_differing(self.inputs, other.inputs)}
        before = dict(self.settings)
        altered |= {f"settings.{name}" for name, value in settings if value != before[name]}
        other._given = self._given.union(stages)
        # a stage that was computed is kept where nothing that it depends on is altered
        for name in DEPENDS_ON.keys() & self.__dict__.keys():
            if name in self._given or altered.isdisjoint(_all_of(name, other._given)):
                other.__dict__[name] = self.__dict__[name]
        other.__dict__.update(stages)
        return other

    def mended(self, mendings: Sequence[str]) -> Self:
        """Give the chain with mended plates, in the trial and where the subject was weighed."""
        recording, static = self.inputs.recording, self.inputs.static
        # a calibration pose on the same plates has the same faults
        numbers = {plate.number for plate in recording.plates}
        recording = _mended(recording, mendings)
        if static is not None and numbers <= {plate.number for plate in static.plates}:
            static = _mended(static, mendings)
        mended = self.changed(recording=recording, static=static)
        # the body does not depend on plates but for the mass that they weigh
        if mended.mass.mass_kg != self.mass.mass_kg:
            return mended
        return self.changed(recording=recording, static=static, body=self.body)

    # What the trial is of: mass and body

    @cached_property
    def trial(self) -> Recording:
        """The recording with corrected plates, whose zeros are followed where that is stated."""
        return self._followed(self.inputs.recording)

    @cached_property
    def standing(self) -> Recording:
        """The recording of the calibration pose, with corrected plates."""
        return self.trial if self.inputs.static is None else self._followed(self.inputs.static)

    @cached_property
    def zeros(self) -> tuple[Zero | None, ...]:
        """What each plate reads over time while no foot is on it; None where that is not seen."""
        return zeros_of(self.trial, self._marker_set, self.inputs.laboratory)

    def _followed(self, recording: Recording) -> Recording:
        """Correct plates, then subtract zeros that are followed."""
        laboratory = self.inputs.laboratory
        corrected = with_corrected_plates(recording, laboratory.plates)
        if not (corrected.plates and following(corrected)):
            return corrected
        return with_followed_zeros(corrected, self._marker_set, laboratory, self.settings.filter)

    @property
    def _marker_set(self) -> MarkerSet:
        """The subject's marker set, as it is stated, else that of the calibration pose."""
        inputs, named = self.inputs, marker_sets().get(self.settings.marker_set or "")
        standing = inputs.static or inputs.recording
        return inputs.marker_set or named or recognise_marker_set(standing.markers.names)

    @cached_property
    def mass(self) -> BodyMass:
        """Body mass as stated, weighed standing, of the file, or, without these, by steps."""
        try:
            return body_mass(self.inputs.subject, self.standing, self.trial)
        except MassUnknownError as unknown:
            # a body of about the right mass finds the steps; these weigh it
            roughly = BodyMass.rough(roughly_weighed(self.trial, unknown))
            marker_set = self.settings.marker_set
            rough = self.changed(mass=roughly, settings=Settings(marker_set=marker_set))
            return BodyMass.by_steps(rough.carried_kg, unknown)

    @cached_property
    def body(self) -> Body:
        """Segments and joints from the calibration pose, scaled by mass and stature."""
        inputs = self.inputs
        return subject_body(
            self.standing,
            inputs.subject,
            self.settings,
            self.mass.mass_kg,
            window_s=inputs.static_window_s,
            marker_set=inputs.marker_set,
            hip_trial=inputs.hip_trial,
            segments=inputs.segments,
        )

    @cached_property
    def labels(self) -> MarkerChecks:
        """What is wrong with the labels of trial and calibration pose."""
        return check_markers(self.body, self.trial, self.standing)

    # How it moved

    @cached_property
    def solved(self) -> Solved:
        """The coordinates that the markers show, without outliers."""
        markers, method = self.inputs.recording.markers, self.settings.filter
        return Solved(*solve_motion(self.body, markers, method, self.jobs))

    @cached_property
    def pose(self) -> Pose:
        """The motion before and after the low-pass."""
        return filtered_pose(self.solved.markers, self.solved.motion, self.settings)

    # What carried it

    @cached_property
    def lab(self) -> BoundLaboratory:
        """The laboratory in this recording."""
        return bind(self.trial, self.inputs.laboratory, self.settings.plate_delay_s)

    @cached_property
    def ground(self) -> Ground:
        """The plates at the markers' times, compensated in their own frames, then in the lab."""
        cutoff_hz, method = self.settings.cutoff_hz, self.settings.filter
        return ground_wrenches(self.lab, self.time, cutoff_hz, method)

    @cached_property
    def moves(self) -> tuple[Note, ...]:
        """Signs of a platform that moves without being stated."""
        laboratory = self.inputs.laboratory
        if laboratory.treadmill.platform is not None or laboratory.calibration is not None:
            return ()
        return uncompensated_motion(self.trial, self.body.markers)

    @property
    def stands_still(self) -> bool:
        """Whether the ground stands still, as far as it is known."""
        return self.ground.pose is None and not self.moves

    @cached_property
    def loads(self) -> Loads:
        """Joint forces and pelvis residual of every variant, with each plate under its foot."""
        contacts = self.inputs.contacts
        return dynamics_under_feet(
            self.body, self.pose, self.ground, self.settings, contacts, self.jobs
        )

    @cached_property
    def unloaded(self) -> tuple[Array | None, ...]:
        """What each plate reads when nobody is on it, (6,), lab axes about its centre."""
        ground, weight_n = self.ground, self.body.mass * GRAVITY_MPS2
        best = ground.variants[ground.best]
        return readings_without_load(ground.plates, best, self.time, weight_n)

    # What of it is known

    @cached_property
    def settling(self) -> tuple[float, float]:
        """The time that filters need at the start and at the end of the recording [s]."""
        return settling_s(self.inputs.laboratory.filters(self.settings))

    @cached_property
    def quality(self) -> Indices:
        """In which frames pose and support are known and filters have settled, (T,)."""
        stages = self.body, self.pose, self.ground, self.loads, self.unloaded
        return frame_quality(*stages, self.settings, self.settling)

    @property
    def counts(self) -> Mask:
        """Frames that count, (T,)."""
        return free_of(self.quality)

    @property
    def uncertainty(self) -> Array | None:
        """What the compensation makes uncertain of the residuals, (T, 6); None without one."""
        return self.ground.uncertainty(self.pose.motion.q[:, :3])

    @cached_property
    def delay(self) -> PlateDelay:
        """How much later the plates are than the markers."""
        return plate_delay(self.loads, self.ground.best, self.counts, self.settings)

    @cached_property
    def evidence(self) -> Evidence:
        """What motion and feet say about the load of the plates."""
        ground, pose = self.ground, self.pose
        residual = self.loads.dynamics[ground.best].residual
        return Evidence.of(
            self.body,
            pose.motion,
            self.loads.places,
            ground.plates,
            ground.variants[ground.best],
            self.unloaded,
            residual,
            self.counts,
            self.settings,
        )

    @cached_property
    def raw_faults(self) -> tuple[RawFault, ...]:
        """What raw samples of the plates show, before a calibration mixes channels."""
        return raw_faults(self.inputs.recording.plates)

    @property
    def lost_load(self) -> bool:
        """Whether plates that carry somebody lost a part of the load; not those without signal."""
        # a plate of which all six channels are dead carries nobody
        channels = Counter(f.plate for f in self.raw_faults if f.kind == "dead")
        return any(f.kind != "dead" or channels[f.plate] < 6 for f in self.raw_faults)

    @cached_property
    def judged(self) -> tuple[Fitted, ...]:
        """What motion and feet say is wrong with the plates, or what it may also be.

        Nothing where they cannot judge.
        """
        if not self.stands_still or self.labels.doubtful or self.lost_load:
            return ()
        return judge_plates(self.evidence, mass_is_stated=self.mass.is_stated)

    @cached_property
    def carried_kg(self) -> float | None:
        """Body mass by steps; None where plates carry none, or do not measure it."""
        misweigh = any(fitted.hypothesis.misweighs for fitted in self.judged)
        return None if misweigh or self.lost_load else weight_of_steps(self.evidence)

    # Which part of it counts

    @cached_property
    def gait(self) -> Gait:
        """Gait events by the method of the settings; the file's are compared with others."""
        trial, pose, body = self.trial, self.pose, self.body
        weight_n = body.mass * GRAVITY_MPS2
        contacts = self.loads.shared.contacts
        of_plates = plate_events(contacts, plate_loads(self.lab), self.time, weight_n)
        motion = foot_motion(self.loads.places, self.ground.pose)
        swings: Swings = foot_swings(trial.markers, body.marker_set)
        carried = float(np.mean(free_of(self.quality, NO_SUPPORT)))
        wanted = self.settings.events
        method, doubts = choose_method(trial.events, swings, wanted, of_plates, carried)
        sources = trial.events, of_plates, motion, pose.markers, body.marker_set
        detected = detect_events(*sources, method)
        origin: EventOrigin = "motion" if {*detected.events}.isdisjoint(of_plates) else "calibrated"
        if method != "auto":
            origin = method
        return Gait(
            detected, origin if detected.events else "", swings.feet, (*doubts, detected.note)
        )

    @cached_property
    def window(self) -> Counted:
        """Cycles that count, or what counts in their place."""
        return what_counts(
            self.trial,
            self.gait.events,
            self.quality,
            self.inputs.condition,
            self.settling,
            self.ground.pose,
            self.settings.min_valid_share,
            self.gait.feet,
            self.gait.found.why_none,
        )

    @property
    def procedure(self) -> Procedure:
        """How it was processed where the settings leave that open."""
        correction = self.inputs.laboratory.plates
        corrections = corrections_used(self.trial.plates, correction)
        return Procedure(
            mass=self.mass.source,
            events=self.gait.origin,
            held=held_coordinates(self.body, self.pose.solved),
            plate_calibration=correction.name if correction and corrections else "",
            delays_corrected=any(one.delay_s for one in corrections),
            dynamic=bool(self.lab.lags_s),
        )

    # The residual by one filtered sum of all plates, for chains that are changed many times

    @property
    def time(self) -> Array:
        """Frame times, (T,) [s]."""
        return self.inputs.recording.markers.time

    @cached_property
    def markers(self) -> Markers:
        """Trajectories that the inverse kinematics used, T frames."""
        return self.solved.markers

    @property
    def plates(self) -> tuple[Plate, ...]:
        """Where the plates are with the platform in neutral."""
        return self.lab.recording.plates

    @cached_property
    def q(self) -> Array:
        """Coordinates before the filter, (T, 46) [m and rad]."""
        return self.pose.solved.q

    @cached_property
    def wrenches(self) -> tuple[Array, ...]:
        """Per plate, before the filter, compensated where the trial is, (T, 6) [N, N·m].

        In the plate's own axes about the centre of its surface.
        """
        return tuple(self.ground.in_plates[self.ground.best])

    @cached_property
    def platform(self) -> PlatformPose | None:
        """The platform's pose, T frames; None where it stands still."""
        return self.ground.pose

    @cached_property
    def accelerations(self) -> tuple[Array, ...]:
        """Per plate what its inertia model takes of the accelerometers, (T, K) [m/s²]."""
        return self.ground.accelerations

    @cached_property
    def belts(self) -> tuple[Array, ...]:
        """Per plate the wrench of its accelerating belt, which was subtracted, (T, 6) [N, N·m]."""
        return self.ground.belts

    @cached_property
    def soft_tissue(self) -> Array:
        """What soft tissue adds to the wrench on the ground: nothing unless it is given, (6,)."""
        return np.zeros(6)

    @cached_property
    def filtered(self) -> Filtered:
        """Filtered coordinates and their derivatives, (T, 46), frame by frame in memory."""
        settings = self.settings
        filtered = butterworth(self.q, self.time, settings.cutoff_hz, settings.filter)
        return Filtered(*map(np.ascontiguousarray, filtered))

    @cached_property
    def needed(self) -> Array:
        """Wrench that the motion needs, (T, 6) [N, N·m]: lab axes about the pelvis origin."""
        return needed_wrench(self.body, self.filtered)

    @cached_property
    def on_ground(self) -> Array:
        """Filtered sum of the plates' wrenches, (T, 6) [N, N·m]: lab axes about the lab origin."""
        moved = in_lab(self.wrenches, self.plates, self.platform)
        return self.low_pass(sum(moved, start=np.zeros((len(self.time), 6))))

    @property
    def residual(self) -> Array:
        """Wrench on the pelvis that closes the equations of motion, (T, 6) [N, N·m].

        Lab axes (X forward, Y left, Z up) about the pelvis origin.
        """
        on_ground = self.on_ground + self.soft_tissue
        return self.needed - shift_wrench(on_ground, self.filtered.value[:, :3])

    @property
    def shoes_are_known(self) -> bool:
        """Whether the subject's shoes are stated, or what else the feet carry or weigh."""
        of_feet = not set(FEET).isdisjoint(self.inputs.segments)
        return self.inputs.subject.shoe_mass_kg is not None or of_feet

    def low_pass(self, signal: Array) -> Array:
        """Pass a signal at the frames, (T, …), through the filter of the trial."""
        return low_pass(signal, self.time, self.settings.cutoff_hz, self.settings.filter)

    def of_frames(self, frames: slice) -> Self:
        """Give the chain of some frames, with the body, and with the plates of the whole trial.

        Neutral is where the platform is at the start of the whole trial.
        """
        recording, platform = self.inputs.recording, self.platform
        markers = recording.markers
        cut = Markers(markers.time[frames], markers.names, markers.position[frames])
        if platform is not None:
            platform = PlatformPose(platform.rotation[frames], platform.position[frames])
        part = self.changed(
            recording=replace(recording, markers=cut),
            body=self.body,
            lab=self.lab,
            platform=platform,
            wrenches=tuple(wrench[frames] for wrench in self.wrenches),
            accelerations=tuple(of_plate[frames] for of_plate in self.accelerations),
            belts=tuple(of_plate[frames] for of_plate in self.belts),
        )
        return part.changed(solved=part.solved, markers=part.markers, q=part.q)


def needed_wrench(body: Body, motion: Filtered) -> Array:
    """Give the wrench that a motion needs where gravity acts, (T, 6) [N, N·m].

    Lab axes about the pelvis origin.
    """
    # wrench about the lab's origin, then about the pelvis, where residuals are
    needed = kernels().newton_euler(*motion, body.geometry, body.inertia_vector, asked={1})[1]
    return shift_wrench(needed, motion.value[:, :3])


def _mended(recording: Recording, mendings: Sequence[str]) -> Recording:
    """Mend the plates of a recording; zeros that drift are followed as if that was stated of it."""
    drifts = [text for text in mendings if parse_mending(text)[1] == "drift"]
    options = recording.options
    if drifts:
        options = replace(options, mend_plates=(*options.mend_plates, *drifts))
    return replace(recording, plates=mended_plates(recording.plates, mendings), options=options)


@cache
def _all_of(stage: str, given: frozenset[str]) -> set[str]:
    """Give all that a stage is computed from, through other stages but for those that are given."""
    direct = DEPENDS_ON[stage].split()
    # a stage that is given stands for all that it was computed from
    through = (name for name in direct if name in DEPENDS_ON and name not in given)
    return {*direct}.union(*(_all_of(name, given) for name in through))


def _differing(one: Inputs, other: Inputs) -> Iterator[str]:
    """Name the inputs that differ, and those fields of recordings and laboratory that do."""
    # these are compared by what they state; others are the same if they were read once
    by_value = "condition", "contacts", "marker_set", "segments", "subject"
    for name in (field.name for field in fields(one)):
        before, now = getattr(one, name), getattr(other, name)
        if before is now or (name in by_value and before == now):
            continue
        yield name
        parts = {leaf for names in DEPENDS_ON.values() for leaf in names.split()}
        for leaf in (part for part in parts if part.startswith(f"{name}.")):
            attribute = leaf.removeprefix(f"{name}.")
            if getattr(before, attribute, None) is not getattr(now, attribute, ...):
                yield leaf
