"""One trial written as other laboratories' programs write it: for tests of the readers."""

from dataclasses import replace
from xml.sax.saxutils import escape

import numpy as np

from hbm.markers import Markers
from hbm.spatial import rotate_wrench, shift_wrench
from pipeline.export.tables import write_trc
from pipeline.io.axes import parse_axes

FRAME = ("X", "Y", "Z")


def excerpt(walker, start, stop, *, first_frame=1):
    """Give frames of a recording as one of its own, markers and plates only."""
    markers, count = walker.markers, stop - start
    return replace(
        walker,
        markers=Markers(np.arange(count) / 100, markers.names, markers.position[start:stop]),
        plates=tuple(
            replace(
                plate,
                time=np.arange(10 * count) / 1000,
                wrench_in_plate=plate.wrench_in_plate[10 * start : 10 * stop],
            )
            for plate in walker.plates
        ),
        analog=None,
        events=(),
        first_frame=first_frame,
    )


def in_file(recording, axes, *, every=1, about=None):
    """Positions, forces, moments and centres of pressure in a file's own axes."""
    to_file = parse_axes(axes).T
    plates = []
    for plate in recording.plates:
        lab = plate.wrench[::every]
        force = lab[:, :3]
        loaded = force[:, 2] > 20
        pressure = np.zeros_like(force)
        pressure[loaded, 0] = -lab[loaded, 4] / force[loaded, 2]
        pressure[loaded, 1] = lab[loaded, 3] / force[loaded, 2]
        at = shift_wrench(lab, about(plate)) if about else lab
        turned = rotate_wrench(at, to_file)
        plates.append((turned[:, :3], turned[:, 3:], pressure @ to_file.T))
    return recording.markers.position @ to_file.T, plates


def write_dflow(recording, path, *, missing="zero", stamps=None, about=None, edit=None, extra=None):
    """Write D-Flow's mocap text; plates at the markers' rate; edit changes header and rows."""
    every = round(len(recording.plates[0].time) / len(recording.markers.time))
    position, plates = in_file(recording, "right,up,back", every=every, about=about)
    count = len(position)
    lost = np.isnan(position).any(axis=-1)
    position = np.where(lost[..., None], 0, position)
    if missing == "held":
        for k in range(1, count):
            position[k, lost[k]] = position[k - 1, lost[k]]
    columns = {
        "TimeStamp": recording.markers.time + 200 if stamps is None else stamps,
        "FrameNumber": recording.first_frame + np.arange(count),
    }
    for k, name in enumerate(recording.markers.names):
        columns |= {f"{name}.Pos{a}": position[:, k, j] for j, a in enumerate(FRAME)}
    for k, (force, moment, pressure) in enumerate(plates, start=1):
        parts = (("Cop", pressure), ("For", force), ("Mom", moment))
        columns |= {f"FP{k}.{q}{a}": v[:, j] for q, v in parts for j, a in enumerate(FRAME)}
    columns |= extra or {}
    lines = ["\t".join(columns)]
    lines += ["\t".join(f"{x:.6f}" for x in row) for row in zip(*columns.values(), strict=True)]
    if edit is not None:
        lines = edit(lines)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8", newline="")
    return path


def write_nexus(recording, path, *, separator=",", sign=-1, unit=("mm", 1000.0), subject="S01:"):
    """Write a Nexus ASCII export, x forward, y left, z up; moments about the plates' centres."""
    position, plates = in_file(recording, "forward,left,up", about=lambda plate: plate.center)
    per = round(len(recording.plates[0].time) / len(recording.markers.time))
    first, rate = recording.first_frame, recording.markers.rate_hz

    def block(title, its_rate, names, components, units, rows):
        return [
            title,
            f"{its_rate:g}",
            separator.join(["", "", *names]),
            separator.join(["Frame", "Sub Frame", *components]),
            separator.join(["", "", *units]),
            *(separator.join(row) for row in rows),
            "",
        ]

    names, components, units, values = [], [], [], []
    for k, (force, moment, pressure) in enumerate(plates, start=1):
        for what, letter, its_unit, value in (
            ("Force", "F", "N", sign * force),
            ("Moment", "M", "N.mm", sign * 1000 * moment),
            ("CoP", "C", "mm", 1000 * pressure),
        ):
            names += [f"Imported AMTI #{k} - {what}", "", ""]
            components += [f"{letter}{a}" for a in "xyz"]
            units += [its_unit] * 3
            values.append(value)
    values = np.hstack(values)
    rows = (
        [str(first + k // per), str(k % per), *(f"{x:.9g}" for x in row)]
        for k, row in enumerate(values)
    )
    lines = block("Devices", rate * per, names, components, units, rows)
    scaled = position.reshape(len(position), -1) * unit[1]
    names = [field for name in recording.markers.names for field in (f"{subject}{name}", "", "")]
    rows = (
        [str(first + k), "0", *("" if np.isnan(x) else f"{x:.9g}" for x in row)]
        for k, row in enumerate(scaled)
    )
    count = len(recording.markers.names)
    lines += block("Trajectories", rate, names, [*"XYZ"] * count, [unit[0]] * 3 * count, rows)
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def write_mox(recording, path):
    """Write Motek's XML, x forward, y up, z right."""
    position, plates = in_file(recording, "forward,up,right")
    rate = recording.markers.rate_hz
    per = round(len(recording.plates[0].time) / len(position))
    channels = {
        f"{name}.Pos{a}": (rate, np.nan_to_num(position[:, k, j]))
        for k, name in enumerate(recording.markers.names)
        for j, a in enumerate(FRAME)
    }
    for k, measured in enumerate(plates, start=1):
        for what, value in zip(("Force", "Moment", "Cop"), measured, strict=True):
            channels |= {
                f"FP{k} - {what} {a}": (rate * per, value[:, j]) for j, a in enumerate(FRAME)
            }
    channels["Rotation LHipFlex"] = (rate, np.arange(len(position)))
    body = "".join(
        f"<viewer_channel><channel_label>{escape(name)}</channel_label><raw_channel_data>"
        f"<sampling_frequency>{its_rate:g}</sampling_frequency>"
        f"<channel_data>{' '.join(repr(float(x)) for x in samples)}</channel_data>"
        "</raw_channel_data></viewer_channel>"
        for name, (its_rate, samples) in channels.items()
    )
    path.write_text(
        '<?xml version="1.0"?><moxie_viewer_datafile xmlns="http://example.org/rev/moxie">'
        "<viewer_header><patient_id>P7</patient_id>"
        f"<nr_of_samples>{len(position)}</nr_of_samples></viewer_header>"
        f"<viewer_data>{body}</viewer_data></moxie_viewer_datafile>",
        encoding="utf-8",
    )
    return path


def write_opensim(recording, trc, mot):
    """Write TRC and MOT in lab axes; the points of application are the lab origin."""
    write_trc(recording.markers, trc)
    names, columns = ["time"], [recording.plates[0].time]
    for k, plate in enumerate(recording.plates, start=1):
        parts = (
            ("force_v", plate.wrench[:, :3]),
            ("force_p", np.zeros((len(plate.time), 3))),
            ("torque_", plate.wrench[:, 3:]),
        )
        for stem, value in parts:
            names += [f"{k}_ground_{stem}{a}" for a in "xyz"]
            columns += list(value.T)
    header = ["loads", f"nRows={len(columns[0])}", f"nColumns={len(names)}", "endheader"]
    rows = ("\t".join(f"{x:.9g}" for x in row) for row in zip(*columns, strict=True))
    mot.write_text("\n".join([*header, "\t".join(names), *rows]) + "\n", encoding="utf-8")
    return mot
