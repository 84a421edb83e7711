"""The parameter group that says what was subtracted from the plates of a file."""

from typing import Final, get_args

import numpy as np

from hbm.spelling import short
from pipeline.io.c3d.encoding import Value
from pipeline.io.c3d.parameters import Parameters
from pipeline.io.recording import Compensation, PlateFrame

GROUP: Final = "HBM_RESIDUALS"
TEXTS: Final = {
    "SOFTWARE": "software",
    "CALIBRATION": "calibration",
    "CALIBRATION_SHA256": "calibration_sha256",
    "BELTS": "belts",
    "BELTS_SHA256": "belts_sha256",
    "PLATE_CALIBRATION": "plate_calibration",
    "PLATE_CALIBRATION_SHA256": "plate_calibration_sha256",
    "FILTER": "filter",
    "FRAME": "frame",
}
"""Parameter -> attribute of `Compensation`."""


def compensation_group(compensation: Compensation) -> dict[str, Value]:
    """Give the group's parameters; what is not known is left out."""
    members: dict[str, Value] = {
        name: text
        for name, attribute in TEXTS.items()
        if (text := getattr(compensation, attribute))
    }
    members["PLATES"] = np.array(compensation.plates, int)
    if compensation.cutoff_hz is not None:
        members["CUTOFF_HZ"] = np.array([compensation.cutoff_hz])
    return members


def read_compensation(parameters: Parameters) -> Compensation | None:
    """Read what was subtracted from a file's plates; None where they are as measured.

    Raises
    ------
    ValueError
        The group says something that this version does not know.
    """
    if GROUP not in parameters.groups:
        return None
    texts = {attribute: parameters.text(GROUP, name) for name, attribute in TEXTS.items()}
    frames: tuple[PlateFrame, ...] = get_args(PlateFrame)
    stated = texts.pop("frame")
    frame = next((known for known in frames if known == stated), None)
    if frame is None:
        raise ValueError(
            f"{GROUP}:FRAME is {short(stated)!r}, expected one of "
            f"{', '.join(frames)}; another version of this program wrote it"
        )
    plates = tuple(parameters.integers(GROUP, "PLATES").ravel().tolist())
    cutoff_hz = next(iter(parameters.numbers(GROUP, "CUTOFF_HZ").flat), None)
    return Compensation(**texts, plates=plates, cutoff_hz=cutoff_hz, frame=frame)
