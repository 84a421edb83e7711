"""What a library other than ours read from a C3D file, or why it could not."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Parameter = tuple[str | float, ...]


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a library gave no reading of a file.

    Attributes
    ----------
    reader
        The library, with its version if it is installed.
    reason
        One line.
    installed
        Whether the library is installed.
    miscount
        What it read another number of than the file holds, such as "frames"; both numbers.
    """

    reader: str
    reason: str
    installed: bool = True
    miscount: tuple[str, int, int] | None = None

    def __str__(self) -> str:
        return f"{self.reader} does not read it: {self.reason}"


@dataclass(frozen=True, slots=True)
class Reading:
    """A C3D file as a library other than ours read it, in the file's units and axes.

    Attributes
    ----------
    reader
        The library and its version.
    points
        Coordinates, (T, P, 3); missing samples as the library gives them.
    residuals, cameras
        What else is stored with each point, (T, P).
    analog
        Scaled analog samples, (T · samples per frame, channels).
    rotations
        Rotation matrices of segments, one row per sample.
    first_frame, rate_hz, analog_per_frame, events
        As in the header block; events are label and time [s].
    parameters
        ``GROUP:NAME`` -> values, the first index of their dimensions runs fastest.
    descriptions
        ``GROUP`` or ``GROUP:NAME`` -> its description.
    assumed
        Parameters that the library gives every file, here with its default values.
    """

    reader: str
    points: NDArray[np.floating]
    residuals: NDArray[np.floating]
    cameras: NDArray[np.number]
    analog: NDArray[np.float64]
    rotations: NDArray[np.float64]
    first_frame: int
    rate_hz: float
    analog_per_frame: int
    events: tuple[tuple[str, float], ...]
    parameters: dict[str, Parameter]
    descriptions: dict[str, str]
    assumed: frozenset[str]

    def labels(self, group: str, count: int) -> list[str]:
        """Name points or channels by their labels, those without one by their number."""
        labels: list[str] = []
        for page in ("", *range(2, count + 2)):
            texts = self.parameters.get(f"{group}:LABELS{page}", ())
            labels += [str(text) for text in texts]
            if not texts or len(labels) >= count:
                break
        return numbered(labels, count)


def numbered(labels: Sequence[str], count: int) -> list[str]:
    """Give each of so many things its label, or its number from 1 where it has none."""
    return [labels[k] if k < len(labels) and labels[k] else f"{k + 1}" for k in range(count)]


def load_reading(folder: Path) -> Reading | str:
    """Load what the program `libraries` left in a folder.

    Parameters
    ----------
    folder
        The folder.

    Returns
    -------
    Reading | str
        The reading, or the library's own reason why there is none.

    Raises
    ------
    ValueError, KeyError, OSError
        The program did not finish what it wrote.
    """
    stored = json.loads((folder / "description.json").read_text(encoding="utf-8"))
    if "refused" in stored:
        return str(stored["refused"])
    points, residuals, cameras, analog, rotations = (
        np.load(folder / f"{name}.npy", allow_pickle=False)
        for name in ("points", "residuals", "cameras", "analog", "rotations")
    )
    return Reading(
        reader=stored["reader"],
        points=points,
        residuals=residuals,
        cameras=cameras,
        analog=analog,
        rotations=rotations,
        first_frame=stored["first_frame"],
        rate_hz=stored["rate_hz"],
        analog_per_frame=stored["analog_per_frame"],
        events=tuple((label, time) for label, time in stored["events"]),
        parameters={key: tuple(values) for key, values in stored["parameters"].items()},
        descriptions=stored["descriptions"],
        assumed=frozenset(stored["assumed"]),
    )
