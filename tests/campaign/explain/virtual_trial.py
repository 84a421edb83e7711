"""Short trials of the virtual laboratory, recorded by instruments with and without faults."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from compensation import InertiaModel
from compensation.protocol import platform_signal
from hbm.spatial import Array
from pipeline.config.schema import Platform, Subject, Treadmill
from pipeline.io.recording import Recording
from pipeline.trial.ground.calibrations import fit_calibration
from pipeline.trial.ground.laboratory import Laboratory
from pipeline.virtual_lab.faults import BodyFaults, Faults
from pipeline.virtual_lab.machine.instrumented_treadmill import (
    ANALOG_HZ,
    PITCH_CHANNEL,
    PLATFORM_MARKERS_M,
    SWAY_CHANNEL,
    Clock,
    InstrumentedTreadmill,
    make_treadmill,
    undergo,
)
from pipeline.virtual_lab.machine.platform import (
    BeltRamp,
    TreadmillMotion,
    move_platform,
    platform_trajectory,
)
from pipeline.virtual_lab.machine.structure import Response
from pipeline.virtual_lab.person.gait import schedule
from pipeline.virtual_lab.person.subject import make_subject
from pipeline.virtual_lab.person.walk import Walk, simulate_walk
from pipeline.virtual_lab.protocol.walking_protocol import PERSONS, sway_command
from pipeline.virtual_lab.protocol.walking_trial import person_loads, record, run_signal
from tests.campaign.explain.faults import Seeded
from tests.campaign.explain.plate_faults import restated, with_faults

SPEED_MPS: Final = 1.3
STANDING_S: Final = 2.5
STARTING_S: Final = 3.0
STEADY_S: Final = STANDING_S + STARTING_S + 0.5
"""From here on gait cycles count."""
DURATION_S: Final = 18.5
SWAYS_S: Final = (6.0, 9.0)
"""Times between which the platform starts to sway; it is back in neutral 10 s later."""
PITCH_RAD: Final = 0.1
PITCH_PERIOD_S: Final = 8.0
CALIBRATION_S: Final = 60
CALIBRATION_MPS: Final = 3.0


def background() -> Faults:
    """Give the default laboratory, whose plates have nothing wrong but noise."""
    default, none = Faults(), Faults.none()
    kept = {"noise_scale", "fine_scale"}
    noise = default.plates.model_dump(include=kept)
    return default.model_copy(update={"plates": none.plates.model_copy(update=noise)})


@dataclass(frozen=True, slots=True)
class Walked:
    """A person's walk on a treadmill, and what its instruments underwent.

    Attributes
    ----------
    seed
        Of all that is random.
    walk, motion, response
        How the person and the treadmill moved, and what the instruments undergo.
    """

    seed: tuple[int, ...]
    walk: Walk
    motion: TreadmillMotion
    response: Response


def walk_on(
    treadmill: InstrumentedTreadmill,
    body: BodyFaults,
    seed: tuple[int, ...],
    *,
    moving: bool = False,
    individuality: float = 1.0,
) -> Walked:
    """Simulate a person who stands in a T-pose and then walks for 13 s."""
    of_body, of_walk, of_platform, of_machine = np.random.default_rng(seed).spawn(4)
    person = PERSONS[int(of_platform.integers(len(PERSONS)))]
    subject = make_subject(person, individuality=individuality, faults=body, rng=of_body)
    steps = schedule(subject.step_parameters, SPEED_MPS, STANDING_S, DURATION_S, of_walk)
    time = np.arange(round(DURATION_S * ANALOG_HZ)) / ANALOG_HZ
    sway = pitch = np.zeros(len(time))
    if moving:
        onset, side = of_platform.uniform(*SWAYS_S), of_platform.choice([-1.0, 1.0])
        sway = sway_command(np.array([onset]), np.array([side]), time)
        waves = np.sin(2 * np.pi * (time - STEADY_S) / PITCH_PERIOD_S)
        pitch = side * PITCH_RAD * waves * (time > STEADY_S)
    platform = move_platform(treadmill.machine, sway, pitch, ANALOG_HZ)
    belt = BeltRamp(SPEED_MPS, STANDING_S, STARTING_S)
    motion = TreadmillMotion(time, platform, belt.speed(time), np.empty(0))
    trajectory = platform_trajectory(platform, ANALOG_HZ)
    walk = simulate_walk(subject, steps, belt, trajectory, DURATION_S, of_walk)
    response = undergo(treadmill, motion, of_machine, person_loads(walk, time))
    return Walked(seed, walk, motion, response)


def recorded(walked: Walked, treadmill: InstrumentedTreadmill) -> Recording:
    """Record a walk; equal walks have equal noise in all instruments."""
    noise = np.random.default_rng((*walked.seed, 1))
    name = f"walk_{'_'.join(map(str, walked.seed))}.c3d"
    return record(treadmill, walked.motion, walked.walk, name, noise, walked.response)


@dataclass(frozen=True)
class VirtualLaboratory:
    """A laboratory whose instruments have nothing wrong but noise, until faults are seeded.

    Attributes
    ----------
    seed
        Of its instruments.
    """

    seed: int

    @cached_property
    def treadmill(self) -> InstrumentedTreadmill:
        """The treadmill with its instruments."""
        return make_treadmill(background(), self.seed)

    @cached_property
    def stated(self) -> Treadmill:
        """The treadmill as a study states it, without its pose."""
        names = [sensor.name for sensor in self.treadmill.sensors]
        return Treadmill(accelerometers={s: (f"{s}.X", f"{s}.Y", f"{s}.Z") for s in names})

    @cached_property
    def still(self) -> Laboratory:
        """The laboratory where the treadmill stands still."""
        return Laboratory(Treadmill())

    @cached_property
    def calibrated(self) -> Laboratory:
        """The laboratory with the calibration of its moving treadmill."""
        limits = self.treadmill.machine.limits
        signal = platform_signal("all", CALIBRATION_S, self.seed, CALIBRATION_MPS, limits)
        empty = run_signal(self.treadmill, signal, np.random.default_rng((self.seed, 2)))
        return Laboratory(self.stated, fit_calibration(empty, self.stated))

    def moving(self, seeded: Seeded, shown: Sequence[Array], *, channels: bool) -> Laboratory:
        """Give the laboratory as it knows its moving treadmill.

        Parameters
        ----------
        seeded
            What is wrong.
        shown
            Per plate what it shows of what it carries, (6, 6): the empty plates of the calibration
            showed it too, and its models are linear.
        channels
            Whether the platform's pose is known from its channels, else from markers.
        """
        calibration = self.calibrated.calibration
        assert calibration is not None

        def seen(models: dict[str, InertiaModel]) -> dict[str, InertiaModel]:
            return {
                name: replace(model, gain=model.gain @ linear.T)
                for (name, model), linear in zip(models.items(), shown, strict=False)
            }

        x, y, z = self.treadmill.machine.pivot_m
        platform = Platform(markers=tuple(PLATFORM_MARKERS_M))
        if channels:
            platform = Platform(
                sway_channel=SWAY_CHANNEL,
                pitch_channel=PITCH_CHANNEL,
                pivot_m=(x, y, z + seeded.pivot_m),
            )
        return Laboratory(
            self.stated.model_copy(update={"platform": platform}),
            replace(
                calibration,
                plates=seen(dict(calibration.plates)),
                dynamic=seen(dict(calibration.dynamic)),
            ),
        )

    def with_faults(self, seeded: Seeded) -> InstrumentedTreadmill:
        """Give the treadmill with faults of its instruments; one converter has all but cameras."""
        faults = self.treadmill.faults
        turned, forward, left = seeded.placement
        placed = {
            "placement_deg": float(np.degrees(turned)),
            "placement_forward_m": float(forward),
            "placement_left_m": float(left),
        }
        changed = {
            "plates": placed,
            "platform": {"delay_s": seeded.pose_late_s},
            "cameras": {"skin_scale": 1 + seeded.skin},
        }
        faults = faults.model_copy(
            update={
                name: getattr(faults, name).model_copy(update=own) for name, own in changed.items()
            }
        )
        sensors = tuple(
            replace(
                sensor,
                clock=Clock(
                    sensor.clock.delay_s + seeded.late_s + seeded.sensors_late_s,
                    sensor.clock.rate,
                    sensor.clock.jitter_s,
                ),
            )
            for sensor in self.treadmill.sensors
        )
        treadmill = replace(self.treadmill, faults=faults, sensors=sensors)
        return with_faults(treadmill, seeded.plates, seeded.late_s)


def body_faults(seeded: Seeded) -> BodyFaults:
    """Give how far the person differs from the model."""
    body = Faults().body
    inertias = 1 + seeded.inertias
    scaled: dict[str, float | str] = {
        "segment_scale": inertias * body.segment_scale,
        "joint_scale": (1 + seeded.joints) * body.joint_scale,
    }
    if inertias == 0:
        scaled["inertias"] = "de_leva"
    return body.model_copy(update=scaled)


def stated_subject(walked: Walked, seeded: Seeded) -> Subject:
    """Give the subject as a study states it."""
    person = walked.walk.subject.person
    mass_kg = person.mass_kg * (1 + seeded.mass_share)
    return Subject(sex=person.sex, mass_kg=mass_kg, height_m=person.height_m)


def stated_recording(walked: Walked, treadmill: InstrumentedTreadmill, seeded: Seeded) -> Recording:
    """Record a walk, with the plates where they are stated to be."""
    return restated(recorded(walked, treadmill), seeded.plates)
