"""Experiment 1 as people state it: ``plates.toml`` names recordings of known weights."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator

from hbm.spatial import Array
from pipeline.config.input_model import (
    AxesText,
    CoordinateM,
    FilterCutoffHz,
    InputModel,
    LengthUnit,
    PlateUnitsText,
    Text,
)
from pipeline.config.toml_file import Around, FileName, StudyFaults, check_table, read_table
from pipeline.io.read_options import ReadOptions

FILE = "plates.toml"
BeltSide = Literal["left", "right"]
WeightKg = Annotated[float, Field(gt=0, le=500)]
BeltSpeedMps = Annotated[float, Field(ge=0, le=5)]
"""No treadmill for walking and running is faster."""
Edges = Annotated[tuple[CoordinateM, CoordinateM], Field(strict=False)]


class StaticRecording(InputModel):
    """A weight placed on the plate at many points, one after the other."""

    file: FileName
    belt: BeltSide


class HammerRecording(StaticRecording):
    """Impacts of a hammer that carries a marker."""


class WeightRecording(StaticRecording):
    """One recording of a known weight that the belt carries forward and backward."""

    mass_kg: WeightKg
    speed_mps: BeltSpeedMps
    profile: Literal["constant", "sine", "square"]
    position_m: CoordinateM
    supports: bool = True


LimitN = Annotated[float, Field(gt=0, le=1000)]
LimitNm = Annotated[float, Field(gt=0, le=1000)]
LimitM = Annotated[float, Field(gt=0, le=0.1)]
LimitPercent = Annotated[float, Field(gt=0, le=20)]


class Surface(InputModel):
    """Where the surface of a plate is, level with the lab's origin: its edges in the lab.

    Attributes
    ----------
    x_m, y_m
        Rear and front edge, right and left edge [m].
    """

    x_m: Edges
    y_m: Edges

    @field_validator("x_m", "y_m")
    @classmethod
    def _ordered(cls, edges: tuple[float, float]) -> tuple[float, float]:
        if not edges[1] - edges[0] >= 0.1:  # no foot has room on less
            raise ValueError(
                "must be two edges at least 0.1 m apart, the smaller number first, "
                f"got {edges[0]:g} and {edges[1]:g}"
            )
        return edges

    @property
    def center(self) -> Array:
        """Its centre in the lab, (3,) [m]."""
        return np.array([np.mean(self.x_m), np.mean(self.y_m), 0.0])

    @property
    def corners(self) -> Array:
        """Its corners in the lab, (4, 3) [m]."""
        (rear, front), (right, left) = self.x_m, self.y_m
        corners = [(front, left), (front, right), (rear, right), (rear, left)]
        return np.array([[x, y, 0.0] for x, y in corners])


class AccuracyLimits(InputModel):
    """Errors up to which plates are accurate enough for inverse dynamics; docs/plates.md explains.

    Limits of total errors, root mean square over the loads of stance: ``force_n``, ``cop_m``,
    ``moment_nm``. Limits of single faults: all others. The defaults and where they are from:

    - ``cop_m`` 5 mm: centre of pressure shifted by 5 mm changes the largest joint moments of
      walking and running by 7 % on average (McCaw and DeVita 1995, J Biomech 28:985).
    - ``moment_nm`` 7.5 N·m about the person's centre of mass: the residual moment that Hicks et al.
      (2015, J Biomech Eng 137:020905) accept, 1 % of the external force times the height of that
      centre, for 75 kg and 1 m. Our choice that plates may use all of it.
    - ``force_n`` 7.5 N: at that height, a horizontal force error of 7.5 N is that moment. It is 1 %
      of the weight of 75 kg, a fifth of the residual force that Hicks et al. accept.
    - ``gain_percent``, ``cross_talk_percent`` 1 % (of N per N, N·m per N·m, N per N·m, and N·m per
      N): of the weight of 75 kg, this is ``force_n``. Our choice.
    - ``angle_deg`` 0.5°, ``offset_m`` 3 mm: each less than ``cop_m``, 0.5 m from the middle of the
      plate. Our choice; the thesis found 0.19° and 1.8 mm.
    - ``zero_n`` 3 N, ``zero_nm`` 3 N·m, ``drift_n_per_s`` 0.05 N/s (3 N in a minute): forces off by
      6 N change joint moments of children beyond the spread between them, by 3 N they do not (J
      Biomech 2024, doi 10.1016/j.jbiomech.2024.112351). For moments our choice: 4 mm at 75 kg.
    - ``delay_s`` 2 ms: forces late by 5 ms change the ankle moment of walking by 29 %, and each
      millisecond adds nearly 1 % of body weight to the residual force (Lemaire and Kuo 2024,
      bioRxiv 2024.06.24.600392). The number is our choice.
    - ``curvature_percent``, ``nonlinearity_percent`` 1 % of full scale: our choice, below the 1.3 %
      that the thesis found.
    - ``vibration_m`` 5 mm: as ``cop_m``.
    - ``noise_n`` 2.5 N, ``noise_nm`` 1 N·m at the study's cut-off: a third of ``force_n``, and
      1.4 mm at 75 kg. Our choice.
    """

    force_n: LimitN = 7.5
    moment_nm: LimitNm = 7.5
    cop_m: LimitM = 0.005
    gain_percent: LimitPercent = 1.0
    cross_talk_percent: LimitPercent = 1.0
    angle_deg: Annotated[float, Field(gt=0, le=10)] = 0.5
    offset_m: LimitM = 0.003
    zero_n: LimitN = 3.0
    zero_nm: LimitNm = 3.0
    drift_n_per_s: Annotated[float, Field(gt=0, le=10)] = 0.05
    delay_s: Annotated[float, Field(gt=0, le=0.1)] = 0.002
    curvature_percent: LimitPercent = 1.0
    nonlinearity_percent: LimitPercent = 1.0
    vibration_m: LimitM = 0.005
    noise_n: LimitN = 2.5
    noise_nm: LimitNm = 1.0


class PlatesFile(InputModel):
    """The contents of ``plates.toml``; full scale and filter are those of the thesis.

    Plates are judged at loads of a person of ``body_mass_kg``. By how much all masses together may
    be misstated is unknown where ``mass_uncertainty_percent`` is not stated.
    """

    name: str = "plates"
    axes: AxesText
    units: LengthUnit | None = None
    plate_units: PlateUnitsText | None = None
    marker: Text = "WEIGHT"
    hammer_marker: Text = "HAMMER"
    plate_numbers: dict[BeltSide, int] = Field({"left": 1, "right": 2})
    surface: dict[BeltSide, Surface] = Field(default_factory=dict)
    cutoff_hz: FilterCutoffHz = 20.0
    full_scale_n: Annotated[float, Field(gt=0)] = 510.0
    center_height_m: Annotated[float, Field(ge=0, le=2)] = 0.0
    body_mass_kg: WeightKg = 75.0
    mass_uncertainty_percent: Annotated[float, Field(ge=0, le=100)] | None = None
    limits: AccuracyLimits = AccuracyLimits()
    static: Annotated[tuple[StaticRecording, ...], Field(strict=False)] = ()
    hammer: Annotated[tuple[HammerRecording, ...], Field(strict=False)] = ()
    weights: Annotated[tuple[WeightRecording, ...], Field(strict=False, min_length=1)]

    @property
    def height_stated(self) -> bool:
        """True if the height of the weights' centre of mass is known, not just left at zero."""
        return "center_height_m" in self.model_fields_set

    @property
    def options(self) -> ReadOptions:
        """How its recordings are to be read."""
        return ReadOptions(axes=self.axes, units=self.units, plate_units=self.plate_units)


@dataclass(frozen=True, slots=True)
class PlatesStudy:
    """Experiment 1, checked.

    Attributes
    ----------
    folder
        Where its files are.
    file
        The contents of ``plates.toml``.
    """

    folder: Path
    file: PlatesFile


def read_plates_study(folder: str | Path) -> PlatesStudy:
    """Read ``plates.toml``.

    Parameters
    ----------
    folder
        Folder with ``plates.toml``, or the file itself.

    Returns
    -------
    PlatesStudy
        Everything that the file states, checked.

    Raises
    ------
    StudyFaults
        If anything is wrong: all faults, one line each.
    """
    folder = Path(folder)
    folder = folder.parent if folder.suffix == ".toml" else folder
    if not (folder / FILE).is_file():
        raise StudyFaults([f"{folder}: no {FILE} here"], folder)
    faults: list[str] = []
    file = check_table(FILE, read_table(folder / FILE), PlatesFile, faults, Around(folder))
    if faults or file is None:
        raise StudyFaults(faults, folder)
    return PlatesStudy(folder, file)
