"""Samples of a file's force plates, changed in the way in which the file stores them."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hbm.spatial import Array
from pipeline.io.c3d.byte_order import float_bytes, floats, integer_type
from pipeline.io.c3d.data import analog_scaling, frame_rate_hz, is_unsigned
from pipeline.io.c3d.force_plates import PlateLayout, plate_layouts
from pipeline.io.c3d.header import Header
from pipeline.io.c3d.labels import channel_labels
from pipeline.io.c3d.parameters import Parameters
from pipeline.io.c3d.plate_channels import channel_change
from pipeline.io.stated import Stated

MAX_REAL: Final = float(np.finfo(np.float32).max)
MAX_DEC: Final = MAX_REAL / 4
"""The same bits mean a quarter of the IEEE number in a DEC file."""


@dataclass(frozen=True, slots=True)
class PlateSamples:
    """How the samples of a file's plates are stored.

    Attributes
    ----------
    header
        Of the file.
    plates
        Its force plates.
    names
        Labels of all analog channels.
    offset, scale
        Of all analog channels: value = (sample − offset) · scale.
    rate_hz
        Of the analog channels [Hz].
    unsigned
        Whether whole samples have no sign.
    """

    header: Header
    plates: tuple[PlateLayout, ...]
    names: list[str]
    offset: NDArray[np.float64]
    scale: NDArray[np.float64]
    rate_hz: float
    unsigned: bool

    def changed(self, data: bytes, wrench_changes: Sequence[Array], first_frame: int) -> bytes:
        """Change the plates' wrenches in some frames of the data section.

        Parameters
        ----------
        data
            The frames' bytes.
        wrench_changes
            Per plate, what is to be added to its wrench in the whole trial, in the plate's axes
            about the centre of its surface, (N, 6) [N, N·m].
        first_frame
            Index of the first of these frames.

        Returns
        -------
        bytes
            The same frames; a sample whose wrench is not changed keeps its bytes.

        Raises
        ------
        ValueError
            A channel cannot hold what it would have to; the message names it and the time.
        """
        per_frame = self.header.analog_per_frame
        channels = self.header.channels
        words = np.frombuffer(data, self._word_type)
        words = words.reshape(len(data) // self.header.frame.bytes, -1).copy()
        start = first_frame * per_frame
        for plate, change in zip(self.plates, wrench_changes, strict=True):
            part = change[start : start + len(words) * per_frame]
            if not part.any():
                continue
            in_frame = np.add.outer(channels * np.arange(per_frame), plate.channels)
            columns = 4 * self.header.n_points + in_frame
            cells = words[:, columns]
            stored = self._changed_plate(plate, cells.reshape(len(part), -1), part, start)
            words[:, columns] = stored.reshape(cells.shape)
        return words.tobytes()

    def _changed_plate(
        self, plate: PlateLayout, stored: NDArray[np.integer], wrench_change: Array, start: int
    ) -> NDArray[np.integer]:
        """Change stored samples (N, c) of one plate."""
        chosen = list(plate.channels)
        scale, before = self.scale[chosen], self._decoded(stored)
        known = np.isfinite(before).all(axis=1)
        values = (before[known] - self.offset[chosen]) * scale
        change = np.zeros(before.shape)
        change[known] = channel_change(plate, values, wrench_change[known])

        def refuse(wrong: NDArray[np.bool_], reason: str) -> None:
            if wrong.any():
                sample, channel = np.argwhere(wrong)[0].tolist()
                raise ValueError(
                    f"force plate {plate.number}, channel {self.names[chosen[channel]]}, at "
                    f"{(start + sample) / self.rate_hz:.4f} s: {reason}"
                )

        refuse(
            np.isnan(change),
            "the compensated force has no centre of pressure on the plate's surface, and plates of "
            "TYPE 1 store no other moment; export the recording with TYPE 2 plates",
        )
        refuse(
            (change != 0) & ((scale == 0) | ~np.isfinite(scale)),
            "its scale is 0 or no number, so that it can hold no force",
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            after = np.where(change == 0, before, before + change / scale)
        after = after if self._real else np.rint(after)
        low, high = self._limits
        refuse(
            (change != 0) & ~((after >= low) & (after <= high)),
            f"the compensated sample is outside the range of the file's samples, {low:g} to "
            f"{high:g}; export the recording with real (floating-point) samples",
        )
        return np.where(change == 0, stored, self._encoded(after))

    @property
    def _real(self) -> bool:
        return self.header.scale < 0

    @property
    def _word_type(self) -> np.dtype:
        """Type of a sample: its value where it is whole, its bytes where it is real."""
        if self._real:
            return np.dtype("<u4")
        return integer_type(self.header.byte_order, signed=not self.unsigned)

    @property
    def _limits(self) -> tuple[float, float]:
        if self._real:
            most = MAX_DEC if self.header.byte_order == "dec" else MAX_REAL
            return -most, most
        return float(np.iinfo(self._word_type).min), float(np.iinfo(self._word_type).max)

    def _decoded(self, stored: NDArray[np.integer]) -> Array:
        if not self._real:
            return stored.astype(float)
        return floats(stored.tobytes(), self.header.byte_order).reshape(stored.shape).astype(float)

    def _encoded(self, samples: Array) -> NDArray[np.integer]:
        if not self._real:
            return samples.astype(self._word_type)
        data = float_bytes(samples, self.header.byte_order)
        return np.frombuffer(data, self._word_type).reshape(samples.shape)


def plate_samples(header: Header, parameters: Parameters, stated: Stated) -> PlateSamples:
    """Find how a file stores its plates' samples.

    Parameters
    ----------
    header, parameters
        What `read_header` gave for it.
    stated
        Units that a person states.

    Returns
    -------
    PlateSamples
        Of the plates that it describes.

    Raises
    ------
    ValueError
        There are no plates that it describes, or two of them share a channel.
    """
    channels = header.channels
    names, units = channel_labels(parameters, channels)
    plates, _ = plate_layouts(parameters, names, units, stated)
    if not plates:
        raise ValueError("the file has no force plates")
    owners = Counter(channel for plate in plates for channel in plate.channels)
    if shared := [names[channel] for channel, count in owners.items() if count > 1]:
        raise ValueError(f"FORCE_PLATFORM:CHANNEL names {shared[0]} twice")
    offset, scale, _ = analog_scaling(header, parameters)
    rate_hz = frame_rate_hz(header, parameters)[0] * header.analog_per_frame
    unsigned = is_unsigned(parameters)
    return PlateSamples(header, tuple(plates), names, offset, scale, rate_hz, unsigned)
