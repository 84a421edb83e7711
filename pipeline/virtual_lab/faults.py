"""Faults of a laboratory: each has a size, and can be stated or switched off in TOML.

Sizes are standard deviations unless stated otherwise. Defaults without a source are assumed to be
those of a well-maintained laboratory.
"""

from typing import Annotated, Final, Literal

from pydantic import Field

from pipeline.config.input_model import InputModel

Size = Annotated[float, Field(ge=0)]
Scale = Annotated[float, Field(ge=0, le=3)]
Share = Annotated[float, Field(ge=0, le=0.3)]
"""Of a published size, and of a value: beyond them no person and no machine is possible."""
BandwidthHz = Annotated[float, Field(ge=0.5, le=50)]
AssemblyKg = Annotated[float, Field(ge=50, le=500)]
Flexibility = Annotated[float, Field(ge=0, le=20)]
"""Twenty times as flexible, the platform sways at 3 Hz."""
RatePpm = Annotated[float, Field(ge=0, le=1000)]
JitterS = Annotated[float, Field(ge=0, le=0.01)]
"""Beyond them a clock is broken."""
Bits = Annotated[int, Field(ge=0, le=24)]
MAX_DELAY_S: Final = 0.2
"""Of an instrument, either way: more than any laboratory has."""
Delay = Annotated[float, Field(ge=-MAX_DELAY_S, le=MAX_DELAY_S)]
MAX_PLACEMENT_DEG: Final = 10.0
MAX_PLACEMENT_M: Final = 0.1
"""Of a plate that cameras and plates disagree about; more is a mistake that everybody sees."""
PlacementDeg = Annotated[float, Field(ge=-MAX_PLACEMENT_DEG, le=MAX_PLACEMENT_DEG)]
PlacementM = Annotated[float, Field(ge=-MAX_PLACEMENT_M, le=MAX_PLACEMENT_M)]
MAX_REPLAY_FRAMES: Final = 20
"""`MAX_DELAY_S` in frames of the cameras."""


MAX_SHOE_KG: Final = 2.0
MAX_SOLE_M: Final = 0.1
"""Of a shoe: more than the heaviest boots."""


class BodyFaults(InputModel):
    """How the true body differs from what markers and the Human Body Model suggest.

    ``joint_scale`` multiplies the standard deviations of the joint centres; ``axis_deg`` tilts the
    joint axes; masses and radii of gyration differ by a share of themselves, centres of mass by a
    distance (`pipeline.virtual_lab.person.variation`).

    The others are not in that model, and absent with ``same_body`` whatever their sizes: segment
    inertias of another table; a joint in the middle of the trunk and knees that are no hinges
    (`pipeline.virtual_lab.person.variation`), ankle axes that differ, wobbling masses
    (`pipeline.virtual_lab.person.momentum`), each with a scale of its published size; shoes,
    of a mass each, and of a sole that yields under body weight.
    """

    same_body: bool = False
    inertias: Literal["dumas", "de_leva"] = "dumas"
    spine_scale: Scale = 1.0
    knee_scale: Scale = 1.0
    ankle_scale: Scale = 1.0
    wobble_scale: Scale = 1.0
    shoe_kg: Annotated[float, Field(ge=0, le=MAX_SHOE_KG)] = 0.3
    sole_m: Annotated[float, Field(ge=0, le=MAX_SOLE_M)] = 0.025
    sole_yield_m: Annotated[float, Field(ge=0, le=MAX_SOLE_M)] = 0.004
    joint_scale: Scale = 1.0
    axis_deg: Size = 3.0
    mass_share: Share = 0.06
    center_m: Size = 0.008
    gyration_share: Share = 0.05


class MachineFaults(InputModel):
    """Mechanics of the treadmill; these are values, not deviations.

    ``flexibility`` multiplies what the structure yields (`pipeline.virtual_lab.machine.structure`):
    0 makes it rigid. ``people_shake`` multiplies the forces of people on it where they make it
    vibrate; what the plates carry of them stays. ``assembly_kg`` is the mass of each belt assembly,
    which the thesis states; its inertia changes in proportion, and load cells and base stay.
    ``sway_hz`` and ``pitch_hz`` are the bandwidths of the platform's actuators.
    """

    flexibility: Flexibility = 1.0
    people_shake: Scale = 1.0
    assembly_kg: AssemblyKg = 150.0
    sway_hz: BandwidthHz = 7.0
    pitch_hz: BandwidthHz = 3.0


class ClockFaults(InputModel):
    """Faults of the instants at which instruments sample; the cameras' clock is the reference.

    ``rate_ppm`` is the error of each instrument's clock; assumed, of instruments that are
    synchronised. ``jitter_s`` is that of the converter of plates and accelerometers; assumed.
    Belt speed and platform channels come as a stream whose instants differ by ``stream_jitter_s``,
    2 ms at most, and of which a sample is now and then a repetition of the one before: 0.2 to
    0.3 ms and one to three in six minutes are those of the recordings of Hnat and van den Bogert
    (2014).
    """

    rate_ppm: RatePpm = 1.0
    jitter_s: JitterS = 0.00002
    stream_jitter_s: JitterS = 0.0003
    doubled_per_minute: Size = 0.3


class CameraFaults(InputModel):
    """Faults of the motion capture system, and soft tissue artefact.

    ``skin_scale`` multiplies the displacements of `pipeline.virtual_lab.person.soft_tissue`;
    ``gap_s`` is the mean duration of a gap; gaps and swapped labels are counted over all markers of
    a person.
    """

    noise_m: Size = 0.0003
    skin_scale: Size = 1.0
    gaps_per_minute: Size = 2.0
    gap_s: Size = 0.15
    swaps_per_minute: Size = 0.0


class PlateFaults(InputModel):
    """Faults of the plates' load cells, and of where the plates are.

    ``force_noise_n`` and ``moment_noise_nm`` are white: real plates at rest have 0.9 to 1.3 N and
    0.4 to 0.9 N·m. White noise alone would leave half of the 0.13 to 0.27 N that these have below
    6 Hz: the zero wanders by ``wander_n``. It moves by ``zero_shift_n`` from trial to trial, and by
    ``drift_n_per_min`` within one. ``cross_talk`` is that of each component in each other [1];
    ``curvature`` that of the vertical force as a share of full scale there, assumed, of the size
    that makers state. ``alias_n`` is interference of the motors from above half the sampling rate,
    which no filter keeps away; assumed. ``bits`` are those of the converter over the range; 0 is a
    perfect one.

    ``delay_s`` is in the range of what the thesis found of its plates, 2 to 4 ms; the right plate
    is later than the left by ``right_later_s``. Both plates see the cameras' points turned about
    the vertical by ``placement_deg`` (positive to the left) and shifted by the other two: the
    transformation that a static calibration finds (Goldberg et al. 2009). These, and ``bits``, are
    values, not deviations.
    """

    force_noise_n: Size = 1.1
    moment_noise_nm: Size = 0.6
    wander_n: Size = 0.15
    cross_talk: Size = 0.002
    curvature: Size = 0.002
    offset_n: Size = 2.0
    zero_shift_n: Size = 0.5
    drift_n_per_min: Size = 0.3
    alias_n: Size = 0.1
    bits: Bits = 16
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
    """Faults of the accelerometers on the platform, and their number.

    The thesis has two, with a range of 2 g. ``cross_axis`` is what a channel shows of the other two
    axes beside ``misalignment_deg`` of the sensor, ``curvature`` its departure from a straight line
    at the end of the range as a share of that, both assumed, of the size that makers state. They
    are 1 ms later than the left plate; assumed. ``alias_mps2`` and ``bits`` are as of the plates.
    """

    sensors: Literal[1, 2, 3, 4] = 2
    noise_mps2: Size = 0.02
    gain_share: Size = 0.01
    misalignment_deg: Size = 1.0
    cross_axis: Size = 0.01
    curvature: Size = 0.002
    offset_mps2: Size = 0.05
    drift_mps2_per_min: Size = 0.001
    alias_mps2: Size = 0.002
    range_g: Annotated[float, Field(gt=0)] = 2.0
    bits: Bits = 16
    delay_s: Delay = 0.004


class BeltFaults(InputModel):
    """How the belts are driven, and faults of their speed channels.

    ``drive`` is "motor", as identified on recordings of a real one
    (`pipeline.virtual_lab.machine.belts`), or "linear", which follows its command and answers
    to its acceleration by the second-order response that compensation fits. ``roughness``
    multiplies what was found of a motor's broad-band moment, its rotating parts out of balance and
    the uneven instants of its reports. ``unbalance_kg_per_m`` is the force of an unbalanced roller
    by the square of the belt speed, about that identified. ``noise_mps`` of the speed channels is
    assumed; ``delay_s`` adds to what the motor's reports are late.
    """

    drive: Literal["motor", "linear"] = "motor"
    roughness: Size = 1.0
    unbalance_kg_per_m: Size = 0.3
    noise_mps: Size = 0.005
    delay_s: Delay = 0.0


class PlatformFaults(InputModel):
    """Faults of the platform's pose as the laboratory knows it.

    ``marker_noise_m`` is of the markers on the platform, which have as many gaps as those of
    people, ``gaps_per_minute`` over 46 of them. ``delay_s`` is of its sway and pitch channels,
    ``pivot_error_m`` is the error of the height of the pitch axis in the study file.
    Where a recording is replayed while the platform repeats its motion, as in the thesis, the
    channels are of the repetition, which does not start in the same frame: in every recording they
    are moved by one whole number of frames, drawn from ``-replay_frames`` to ``replay_frames``.
    """

    marker_noise_m: Size = 0.0003
    gaps_per_minute: Size = 2.0
    delay_s: Delay = 0.0
    pivot_error_m: Size = 0.0
    replay_frames: Annotated[int, Field(ge=0, le=MAX_REPLAY_FRAMES)] = 0


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
        return cls(
            machine=MachineFaults(flexibility=0, people_shake=0),
            clocks=ClockFaults(rate_ppm=0, jitter_s=0, stream_jitter_s=0, doubled_per_minute=0),
            body=BodyFaults(
                same_body=True,
                inertias="de_leva",
                spine_scale=0,
                knee_scale=0,
                ankle_scale=0,
                wobble_scale=0,
                shoe_kg=0,
                sole_m=0,
                sole_yield_m=0,
                joint_scale=0,
                axis_deg=0,
                mass_share=0,
                center_m=0,
                gyration_share=0,
            ),
            cameras=CameraFaults(noise_m=0, skin_scale=0, gaps_per_minute=0),
            plates=PlateFaults(
                force_noise_n=0,
                moment_noise_nm=0,
                wander_n=0,
                cross_talk=0,
                curvature=0,
                offset_n=0,
                zero_shift_n=0,
                drift_n_per_min=0,
                alias_n=0,
                bits=0,
                delay_s=0,
                right_later_s=0,
            ),
            accelerometers=AccelerometerFaults(
                noise_mps2=0,
                gain_share=0,
                misalignment_deg=0,
                cross_axis=0,
                curvature=0,
                offset_mps2=0,
                drift_mps2_per_min=0,
                alias_mps2=0,
                bits=0,
                delay_s=0,
            ),
            belts=BeltFaults(drive="linear", roughness=0, unbalance_kg_per_m=0, noise_mps=0),
            platform=PlatformFaults(marker_noise_m=0, gaps_per_minute=0),
        )
