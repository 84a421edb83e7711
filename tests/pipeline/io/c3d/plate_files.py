"""C3D files with force plates of any type, processor and storage, made byte by byte.

Nothing of the package is used, so that a fault of its encoders is not made twice.
"""

import struct
from dataclasses import dataclass, field

import numpy as np

BLOCK = 512
PROCESSORS = {"intel": 84, "dec": 85, "sgi": 86}
CORNERS_MM = np.array([[300.0, 200, 0], [-300, 200, 0], [-300, -200, 0], [300, -200, 0]])
UNITS = {
    1: ["N"] * 3 + ["mm"] * 2 + ["Nmm"],
    2: ["N"] * 3 + ["Nmm"] * 3,
    3: ["N"] * 8,
    4: ["V"] * 6,
}
ORIGIN_MM = {1: (0, 0, 0), 2: (4, -3, -40), 3: (120, 200, -54), 4: (-2, 1, 35)}
LOADED = {
    1: [20.0, -30, 700, 40, -25, 3000],
    2: [20.0, -30, 700, -17_000, -28_000, 3000],
    3: [12.0, 8, -14, -16, 180, 160, 170, 190],
    4: [0.2, -0.3, 1.7, -0.4, -0.6, 0.1],
}
"""About the middle of each channel, in its unit: 700 N near the middle of the surface."""
RANGE = {
    1: [4e3, 4e3, 4e3, 400, 400, 4e4],
    2: [4e3, 4e3, 4e3, 1e5, 1e5, 1e5],
    3: [400.0] * 8,
    4: [4.0] * 6,
}
"""Channels stay within it; 25,000 counts of an integer file."""
MATRIX = np.diag([80.0, 80, 400, 3e4, 3e4, 2e4]) + np.add.outer(np.arange(6.0), np.arange(6.0))


@dataclass
class PlateFile:
    """What a file is to be; `write` makes it."""

    kind: int = 2
    byte_order: str = "intel"
    real: bool = True
    unsigned: bool = False
    plates: int = 1
    frames: int = 30
    per_frame: int = 4
    general_scale: float = 1.0
    offset: int = 0
    spare_channels: int = 1
    zero: tuple[int, int] = (1, 0)
    last_step: str = "stated"
    values: np.ndarray = field(init=False)

    def __post_init__(self):
        rng = np.random.default_rng(self.kind)
        count = len(UNITS[self.kind])
        loaded = np.tile(LOADED[self.kind], self.plates)
        sway = 0.1 * rng.normal(size=(self.frames * self.per_frame, count * self.plates))
        spare = rng.normal(size=(len(sway), self.spare_channels))
        self.values = np.hstack([spare, loaded * (1 + sway)])  # plates do not come first

    @property
    def scale(self):
        """SCALE of every channel: real files hold thousandths of its range, others counts."""
        highest = np.array([10.0] * self.spare_channels + RANGE[self.kind] * self.plates)
        return highest / (1000.0 if self.real else 25_000.0) / self.general_scale

    @property
    def count(self):
        """One integer step of every channel, in its unit."""
        return self.scale * self.general_scale

    def write(self, path):
        stored = self.values / self.count + self.offset
        channels = stored.shape[1]
        points = np.zeros((self.frames, 2, 4))
        points[..., :3] = 400 + 300 * np.arange(2)[:, None] + np.arange(self.frames)[:, None, None]
        step = -0.1 if self.real else 0.1
        words = np.hstack(
            [
                (points / (1.0 if self.real else 0.1)).reshape(self.frames, -1),
                stored.reshape(self.frames, -1),
            ]
        )
        section = self._section(step, channels, 0)
        blocks = -(-len(section) // BLOCK)
        section = self._section(step, channels, 2 + blocks)
        header = bytearray(BLOCK)
        header[:2] = bytes([2, 0x50])
        header[2:12] = self._integers(2, channels * self.per_frame, 1, self.frames, 0)
        header[12:16] = self._reals(step)
        header[16:20] = self._integers(2 + blocks, self.per_frame)
        header[20:24] = self._reals(100.0)
        data = self._reals(*words.ravel()) if self.real else self._counts(words)
        data += bytes(-len(data) % BLOCK)
        path.write_bytes(bytes(header) + section.ljust(blocks * BLOCK, b"\0") + data)
        return path

    def _counts(self, words):
        words = np.rint(words)
        words[:, 8:] %= 65536  # as the two's complement of signed ones
        return words.astype(int).astype(">u2" if self.byte_order == "sgi" else "<u2").tobytes()

    def _integers(self, *values):
        order = ">" if self.byte_order == "sgi" else "<"
        return struct.pack(f"{order}{len(values)}H", *(int(value) % 65536 for value in values))

    def _reals(self, *values):
        if self.byte_order != "dec":
            order = ">" if self.byte_order == "sgi" else "<"
            return struct.pack(f"{order}{len(values)}f", *values)
        data = b""
        for value in values:
            low, high = struct.unpack("<2H", struct.pack("<f", 4 * value))
            data += struct.pack("<2H", high, low)
        return data

    def _section(self, step, channels, data_block):
        first, count = self.spare_channels, len(UNITS[self.kind])
        numbers = 1 + first + np.arange(count * self.plates).reshape(self.plates, count)
        corners = [CORNERS_MM + np.array([0, 500 * k, 0]) for k in range(self.plates)]
        plates = {
            "USED": [self.plates],
            "TYPE": [self.kind] * self.plates,
            "ZERO": list(self.zero),
            "CORNERS": np.array(corners).T,
            "ORIGIN": np.tile(np.float64(ORIGIN_MM[self.kind]), (self.plates, 1)).T,
            "CHANNEL": numbers.T,
        }
        if self.kind == 4:
            plates["CAL_MATRIX"] = np.repeat(MATRIX[..., None], self.plates, axis=2)
        analog = {
            "USED": [channels],
            "GEN_SCALE": [float(self.general_scale)],
            "SCALE": self.scale,
            "OFFSET": [self.offset] * channels,
            "RATE": [100.0 * self.per_frame],
            "UNITS": ["V"] * first + UNITS[self.kind] * self.plates,
            "DESCRIPTIONS": ["-"] * channels,
            "LABELS": [f"SPARE{k}" for k in range(first)]
            + [f"P{p + 1}C{k + 1}" for p in range(self.plates) for k in range(count)],
            "FORMAT": ["UNSIGNED" if self.unsigned else "SIGNED"],
        }
        groups = {
            "POINT": {
                "USED": [2],
                "FRAMES": [self.frames],
                "SCALE": [float(step)],
                "RATE": [100.0],
                "UNITS": ["mm"],
                "LABELS": ["LHEE", "RHEE"],
                "DESCRIPTIONS": ["left heel", "right heel"],
                "DATA_START": [data_block],
            },
            "ANALOG": analog,
            "FORCE_PLATFORM": plates,
        }
        records = []
        for identity, (group, members) in enumerate(groups.items(), start=3):
            records.append((-identity, group, b"\0"))
            records += [(identity, name, self._values(v)) for name, v in members.items()]
        body = b""
        for k, (identity, name, content) in enumerate(records):
            last = k == len(records) - 1 and self.last_step == "zero"
            length = 0 if last else len(content) + 2
            body += struct.pack("<bb", len(name), identity) + name.encode()
            body += self._integers(length) + content
        blocks = -(-(len(body) + 6) // BLOCK)
        return bytes([1, 0x50, blocks, PROCESSORS[self.byte_order]]) + body + b"\0\0"

    def _values(self, values):
        if isinstance(values[0], str):
            width = max(map(len, values))
            text = "".join(value.ljust(width) for value in values).encode()
            return struct.pack("<bBBB", -1, 2, width, len(values)) + text + b"\0"
        values = np.asarray(values)
        ordered = values.ravel(order="F").tolist()
        real = values.dtype.kind == "f"
        data = self._reals(*ordered) if real else self._integers(*ordered)
        head = struct.pack(f"<bB{values.ndim}B", 4 if real else 2, values.ndim, *values.shape)
        return head + data + b"\0"
