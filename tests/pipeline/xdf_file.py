"""XDF files as LabRecorder writes them, made without any library of XDF or LSL."""

import struct
from xml.sax.saxutils import escape

import numpy as np

BOUNDARY = bytes.fromhex("43a546dccbf5410fb30ed5467383cbe4")
COMPONENTS = ("ForceX", "ForceY", "ForceZ", "MomentX", "MomentY", "MomentZ")
FORMATS = {np.dtype(float): "double64", np.dtype(np.float32): "float32"}


def chunk(tag, content):
    body = struct.pack("<H", tag) + content
    return b"\x04" + struct.pack("<I", len(body)) + body


def tags(**parts):
    return "".join(f"<{name}>{escape(str(text))}</{name}>" for name, text in parts.items())


def described(channels, extra=""):
    """XML of ``desc`` from one mapping of parts per channel."""
    inside = "".join(f"<channel>{tags(**parts)}</channel>" for parts in channels)
    return f"<channels>{inside}</channels>{extra}"


def marker_channels(names, unit="meters"):
    return [
        {"label": f"{name}_{axis}", "marker": name, "type": f"Position{axis}", "unit": unit}
        for name in names
        for axis in "XYZ"
    ]


def plate_channels(number, units=("N", "N·m")):
    return [
        {"label": f"FP{number}.{t[0]}{t[-1]}", "type": t, "unit": units[k // 3], "plate": number}
        for k, t in enumerate(COMPONENTS)
    ]


def plate_place(plate):
    def numbers(values):
        return " ".join(repr(float(value)) for value in np.ravel(values))

    return (
        "<plate>"
        + tags(
            number=plate.number,
            corners=numbers(plate.corners),
            rotation=numbers(plate.rotation),
            center=numbers(plate.center),
        )
        + "</plate>"
    )


def stream(name, content_type, stamps, values, desc="", *, rate, offset=(), kind=None):
    """One stream: its samples, and how far its clock is behind the recorder's, [(time, s)]."""
    values = np.asarray(values)
    return {
        "name": name,
        "type": content_type,
        "stamps": np.asarray(stamps, float),
        "values": values,
        "desc": desc,
        "rate": rate,
        "offset": offset,
        "format": kind or FORMATS[values.dtype],
    }


def header(of):
    count = of["values"].shape[1]
    own = tags(
        name=of["name"],
        type=of["type"],
        channel_count=count,
        nominal_srate=of["rate"],
        channel_format=of["format"],
    )
    return f'<?xml version="1.0"?><info>{own}<desc>{of["desc"]}</desc></info>'.encode()


def samples(of, start, stop):
    content = b"\x04" + struct.pack("<I", stop - start)
    rows = zip(of["stamps"][start:stop], of["values"][start:stop], strict=True)
    for stamp, row in rows:
        content += b"\x08" + struct.pack("<d", stamp)
        if of["format"] == "string":
            content += b"".join(b"\x01" + bytes([len(t)]) + t.encode() for t in row)
        else:
            content += row.astype(row.dtype.newbyteorder("<")).tobytes()
    return content


def write_xdf(path, streams):
    """Write a file; samples in chunks of 200, streams in turn, boundaries between."""
    parts = [b"XDF:", chunk(1, b'<?xml version="1.0"?><info><version>1.0</version></info>')]
    identified = [(struct.pack("<I", k), of) for k, of in enumerate(streams, start=1)]
    parts += [chunk(2, k + header(of)) for k, of in identified]
    longest = max(len(of["stamps"]) for of in streams)
    for start in range(0, longest, 200):
        for k, of in identified:
            stop = min(start + 200, len(of["stamps"]))
            if start < stop:
                parts.append(chunk(3, k + samples(of, start, stop)))
        parts.append(chunk(5, BOUNDARY))
    for k, of in identified:
        parts += [chunk(4, k + struct.pack("<dd", *pair)) for pair in of["offset"]]
    parts += [
        chunk(6, k + f"<info>{tags(sample_count=len(of['stamps']))}</info>".encode())
        for k, of in identified
    ]
    path.write_bytes(b"".join(parts))
    return path


def recorded(recording, *, start_s=5000.0, jitter=np.zeros):
    """The streams of a recording: markers, plates with their place, other channels."""
    markers = recording.markers
    position = np.array(markers.position).reshape(len(markers.time), -1)
    streams = [
        stream(
            "Cameras",
            "MoCap",
            start_s + markers.time + jitter(len(markers.time)),
            position,
            described(marker_channels(markers.names), tags(axes="forward,left,up")),
            rate=markers.rate_hz,
        )
    ]
    plates = recording.plates
    if plates:
        time = plates[0].time
        places = "".join(map(plate_place, plates))
        channels = [channel for plate in plates for channel in plate_channels(plate.number)]
        streams.append(
            stream(
                "Plates",
                "Force",
                start_s + time + jitter(len(time)),
                np.hstack([plate.wrench_in_plate for plate in plates]),
                described(channels, f"<plates>{places}</plates>"),
                rate=plates[0].rate_hz,
            )
        )
    if (analog := recording.analog) is not None:
        channels = [
            {"label": name, "unit": unit}
            for name, unit in zip(analog.names, analog.units, strict=True)
        ]
        streams.append(
            stream(
                "Analog",
                "Analog",
                start_s + analog.time + jitter(len(analog.time)),
                np.array(analog.values),
                described(channels),
                rate=analog.rate_hz,
            )
        )
    return streams
