"""What can be wrong in a laboratory: every fault with its size, set or switched off in TOML."""

from typing import Annotated, Literal

from pydantic import Field

from pipeline.config.schema import InputModel

Size = Annotated[float, Field(ge=0)]
Delay = Annotated[float, Field(ge=-0.2, le=0.2)]


class BodyFaults(InputModel):
    """How the true body differs from what markers and de Leva's table say (see `variation`)."""

    joint_scale: Size = 1.0
    axis_deg: Size = 3.0
    mass_share: Size = 0.06
    center_m: Size = 0.008
    gyration_share: Size = 0.05


class CameraFaults(InputModel):
    """Of the motion capture system and the skin."""

    noise_m: Size = 0.0003
    skin_scale: Size = 1.0
    gaps_per_minute: Size = 2.0
    gap_s: Size = 0.15
    swaps_per_minute: Size = 0.0


class PlateFaults(InputModel):
    """Of the load cells."""

    force_noise_n: Size = 1.5
    moment_noise_nm: Size = 0.5
    cross_talk: Size = 0.002
    offset_n: Size = 2.0
    drift_n_per_min: Size = 0.3
    delay_s: Delay = 0.003


class AccelerometerFaults(InputModel):
    """Of the accelerometers on the platform."""

    sensors: Literal[1, 2, 3, 4] = 2
    noise_mps2: Size = 0.02
    gain_share: Size = 0.01
    misalignment_deg: Size = 1.0
    offset_mps2: Size = 0.05
    range_g: Annotated[float, Field(gt=0)] = 2.0
    delay_s: Delay = 0.003  # wired to the same converter as the plates


class PlatformFaults(InputModel):
    """Of what the laboratory believes about the platform's pose."""

    marker_noise_m: Size = 0.0003
    delay_s: Delay = 0.0
    pivot_error_m: Size = 0.0


class Faults(InputModel):
    """Everything that is wrong in a laboratory; ``Faults.none()`` is a perfect one."""

    body: BodyFaults = BodyFaults()
    cameras: CameraFaults = CameraFaults()
    plates: PlateFaults = PlateFaults()
    accelerometers: AccelerometerFaults = AccelerometerFaults()
    platform: PlatformFaults = PlatformFaults()

    @classmethod
    def none(cls) -> "Faults":
        """Give a laboratory without faults."""
        return cls(
            body=BodyFaults(joint_scale=0, axis_deg=0, mass_share=0, center_m=0, gyration_share=0),
            cameras=CameraFaults(noise_m=0, skin_scale=0, gaps_per_minute=0),
            plates=PlateFaults(
                force_noise_n=0,
                moment_noise_nm=0,
                cross_talk=0,
                offset_n=0,
                drift_n_per_min=0,
                delay_s=0,
            ),
            accelerometers=AccelerometerFaults(
                noise_mps2=0, gain_share=0, misalignment_deg=0, offset_mps2=0, delay_s=0
            ),
            platform=PlatformFaults(marker_noise_m=0),
        )
