"""Faults of a laboratory: each has a scale or a size, and can be stated or switched off in TOML.

Scales are 1 for a well-maintained laboratory; the sizes that they multiply stand, with their
sources, where the instruments, the machine and the body are made.
"""

from typing import Annotated, Literal

from pydantic import Field

from pipeline.config.input_model import InputModel

Size = Annotated[float, Field(ge=0)]
Scale = Annotated[float, Field(ge=0, le=3)]
"""Beyond it no person is possible."""
Delay = Annotated[float, Field(ge=-0.2, le=0.2)]
"""Of an instrument [s], either way: more than any laboratory has."""
PlacementDeg = Annotated[float, Field(ge=-10, le=10)]
PlacementM = Annotated[float, Field(ge=-0.1, le=0.1)]
"""Of a plate that cameras and plates disagree about; more is a mistake that everybody sees."""


class BodyFaults(InputModel):
    """How the true body differs from what markers and the Human Body Model suggest.

    ``joint_scale`` is of joint centres and axes, ``segment_scale`` of the masses, centres and radii
    of gyration of segments (`pipeline.virtual_lab.person.subject`).

    The others are not in that model, and absent with ``same_body`` whatever their scales: segment
    inertias of another table; a joint in the middle of the trunk, knees that are no hinges, ankle
    axes that differ, wobbling masses (`pipeline.virtual_lab.person.body`), and shoes with a
    mass and a sole that yields under body weight.
    """

    same_body: bool = False
    inertias: Literal["dumas", "de_leva"] = "dumas"
    spine_scale: Scale = 1.0
    knee_scale: Scale = 1.0
    ankle_scale: Scale = 1.0
    wobble_scale: Scale = 1.0
    shoe_scale: Scale = 1.0
    joint_scale: Scale = 1.0
    segment_scale: Scale = 1.0


class MachineFaults(InputModel):
    """Mechanics of the treadmill; these are values, not deviations.

    ``flexibility`` multiplies what the structure yields (`pipeline.virtual_lab.machine.structure`):
    0 makes it rigid, and at 20 the platform sways at 3 Hz. ``sway_hz`` is the bandwidth of the sway
    actuators.
    """

    flexibility: Annotated[float, Field(ge=0, le=20)] = 1.0
    sway_hz: Annotated[float, Field(ge=0.5, le=50)] = 7.0


class ClockFaults(InputModel):
    """Errors of the instants at which instruments sample; the cameras' clock is the reference.

    ``scale`` is of clock rates, jitter and values that a stream repeats; jitter is 2 ms at most.
    """

    scale: Size = 1.0


class CameraFaults(InputModel):
    """Faults of the motion capture system, and soft tissue artefact.

    ``noise_m`` is the standard deviation of every marker, ``skin_scale`` multiplies the
    displacements of `pipeline.virtual_lab.person.soft_tissue`; gaps are counted over 46 markers.
    """

    noise_m: Size = 0.0003
    skin_scale: Size = 1.0
    gaps_per_minute: Size = 2.0


class PlateFaults(InputModel):
    """Faults of the plates' load cells, and of where the plates are.

    Scales are of white noise; of what else is fine (a wandering zero, interference from above half
    the sampling rate, quantisation); of zeros, which shift and drift; and of gains (cross-talk and
    curvature).

    ``delay_s`` is in the range of what the thesis found of its plates, 2 to 4 ms; the right plate
    is later than the left by ``right_later_s``. Both plates see the cameras' points turned about
    the vertical by ``placement_deg`` (positive to the left) and shifted by the other two: the
    transformation that a static calibration finds (Goldberg et al. 2009).
    """

    noise_scale: Size = 1.0
    fine_scale: Size = 1.0
    zero_scale: Size = 1.0
    gain_scale: Size = 1.0
    delay_s: Delay = 0.003
    right_later_s: Delay = -0.001
    placement_deg: PlacementDeg = 0.0
    placement_forward_m: PlacementM = 0.0
    placement_left_m: PlacementM = 0.0

    @property
    def delays_s(self) -> tuple[float, float]:
        """Delays of the left and the right plate [s]."""
        return self.delay_s, self.delay_s + self.right_later_s


class AccelerometerFaults(InputModel):
    """Faults of the accelerometers on the platform, and their number: the thesis has two.

    ``noise_scale`` is of white noise and quantisation, ``error_scale`` of gains, axes, curvature,
    zeros, drift and interference. They are 1 ms later than the left plate; assumed.
    """

    sensors: Literal[1, 2, 3, 4] = 2
    noise_scale: Size = 1.0
    error_scale: Scale = 1.0
    delay_s: Delay = 0.004


class BeltFaults(InputModel):
    """How the belts are driven, and faults of their speed channels.

    ``drive`` is "motor", as identified on recordings of a real one
    (`pipeline.virtual_lab.machine.belts`), or "linear", which follows its command and answers to
    its acceleration by the second-order response that compensation fits. ``roughness`` multiplies
    what was found of a motor's broad-band moment, its rotating parts out of balance, the uneven
    instants of its reports and their noise. ``unbalance_kg_per_m`` is the force of an unbalanced
    roller by the square of the belt speed, about that identified.
    """

    drive: Literal["motor", "linear"] = "motor"
    roughness: Size = 1.0
    unbalance_kg_per_m: Size = 0.3


class PlatformFaults(InputModel):
    """Faults of the platform's pose as the laboratory knows it.

    ``delay_s`` is of its sway and pitch channels, ``pivot_error_m`` is the error of the height of
    the pitch axis in the study file. Where a recording is replayed while the platform repeats its
    motion, as in the thesis, the channels are of the repetition, which does not start in the same
    frame: in every recording they are moved by one whole number of frames, drawn from
    ``-replay_frames`` to ``replay_frames``.
    """

    delay_s: Delay = 0.0
    pivot_error_m: Size = 0.0
    replay_frames: Annotated[int, Field(ge=0, le=20)] = 0


class Faults(InputModel):
    """All faults of a laboratory; ``Faults.none()`` is a perfect one."""

    machine: MachineFaults = MachineFaults()
    clocks: ClockFaults = ClockFaults()
    body: BodyFaults = BodyFaults()
    cameras: CameraFaults = CameraFaults()
    plates: PlateFaults = PlateFaults()
    accelerometers: AccelerometerFaults = AccelerometerFaults()
    belts: BeltFaults = BeltFaults()
    platform: PlatformFaults = PlatformFaults()

    @classmethod
    def none(cls) -> "Faults":
        """Give the faults of a perfect laboratory: none."""
        scales = {name: 0.0 for name in BodyFaults.model_fields if name.endswith("_scale")}
        return cls(
            machine=MachineFaults(flexibility=0),
            clocks=ClockFaults(scale=0),
            body=BodyFaults(same_body=True, inertias="de_leva", **scales),
            cameras=CameraFaults(noise_m=0, skin_scale=0, gaps_per_minute=0),
            plates=PlateFaults(
                noise_scale=0, fine_scale=0, zero_scale=0, gain_scale=0, delay_s=0, right_later_s=0
            ),
            accelerometers=AccelerometerFaults(noise_scale=0, error_scale=0, delay_s=0),
            belts=BeltFaults(drive="linear", roughness=0, unbalance_kg_per_m=0),
        )
