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


def write_forces(recording, path, *, sign=1, first=1):
    """Write Cortex's .forces: force, centre of pressure and free moment, in lab axes."""
    _, plates = in_file(recording, "forward,left,up")
    columns, names = [], ["#Sample"]
    for k, (force, moment, pressure) in enumerate(plates, start=1):
        free = (moment - np.cross(pressure, force))[:, 2:]
        names += [f"{part}{k}" for part in ("FX", "FY", "FZ", "X", "Y", "Z", "MZ")]
        columns += [sign * force, 1000 * pressure, 1000 * sign * free]
    values = np.hstack(columns)
    rate = recording.plates[0].rate_hz
    lines = ["[Force Data]", f"NumberOfForcePlates={len(plates)}", f"SampleRate={rate:.6f}"]
    lines += [f"NumberOfSamples={len(values)}", "\t".join(names)]
    lines += ["\t".join([str(first + k), *(f"{x:.6f}" for x in v)]) for k, v in enumerate(values)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def write_qualisys(recording, path, *, frames=True, titles=True, missing="", local=True, events=()):
    """Write Qualisys' TSV, x forward, y left, z up, and the files of forces beside it."""
    position, _ = in_file(recording, "forward,left,up")
    rate, first = recording.markers.rate_hz, recording.first_frame
    names = recording.markers.names
    header = {"NO_OF_FRAMES": len(position), "NO_OF_CAMERAS": 12, "NO_OF_MARKERS": len(names)}
    header |= {"FREQUENCY": f"{rate:g}", "NO_OF_ANALOG": 0, "ANALOG_FREQUENCY": 0}
    header |= {"DESCRIPTION": "--", "TIME_STAMP": "2024-05-01, 10:00:00.000\t1234.5"}
    lines = [f"{key}\t{value}" for key, value in {**header, "DATA_INCLUDED": "3D"}.items()]
    lines += ["\t".join(map(str, ("EVENT", *event))) for event in events]
    lines += ["\t".join(["MARKER_NAMES", *names])]
    lines += ["\t".join(["TRAJECTORY_TYPES", *["Measured"] * len(names)])]
    if titles:
        axes = [f"{name} {axis}" for name in names for axis in FRAME]
        lines.append("\t".join([*(["Frame", "Time"] if frames else []), *axes]))
    for k, row in enumerate(1000 * position.reshape(len(position), -1)):
        clock = [str(first + k), f"{(first - 1 + k) / rate:.5f}"] if frames else []
        lines.append("\t".join([*clock, *(missing if np.isnan(x) else f"{x:.6f}" for x in row)]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    for plate in recording.plates:
        file = path.with_stem(f"{path.stem}_f_{plate.number}")
        write_qualisys_plate(plate, file, start_s=(first - 1) / rate, local=local, timed=frames)
    return path


def write_qualisys_plate(plate, path, *, start_s=0.0, local=True, timed=True):
    """Write one plate of a Qualisys export: the action on it, in its own axes or the lab's."""
    corners, rotation, center = plate.corners, plate.rotation, plate.center
    if np.isnan(corners).any():  # 2 m by 1 m, its z down
        rotation, center = np.diag([1.0, -1.0, -1.0]), np.array([0.1, -0.2, 0.0])
        offsets = np.array([[1, 0.5, 0], [-1, 0.5, 0], [-1, -0.5, 0], [1, -0.5, 0]])
        corners = center + offsets @ rotation.T
    about_center = shift_wrench(-plate.wrench, center)
    force, moment = about_center[:, :3], about_center[:, 3:]
    loaded = np.abs(force[:, 2]) > 20
    pressure = np.zeros_like(force)
    pressure[loaded, 0] = -moment[loaded, 1] / force[loaded, 2]
    pressure[loaded, 1] = moment[loaded, 0] / force[loaded, 2]
    if local:
        force, moment, pressure = (part @ rotation for part in (force, moment, pressure))
    else:
        pressure[loaded] += center
    header = {"NO_OF_SAMPLES": len(force), "FREQUENCY": f"{plate.rate_hz:.6g}", "TIME_STAMP": ""}
    header |= {"FIRST_SAMPLE": 1, "DATA_INCLUDED": "Force", "FORCE_PLATE_TYPE": "Kistler"}
    of = "local (force plate)" if local else "world (lab)"
    header |= {"DESCRIPTION": f"Force data in {of} coordinates"}
    header |= {"FORCE_PLATE_NAME": f"Force-plate {plate.number}"}
    for corner, place in zip(
        ("POSX_POSY", "NEGX_POSY", "NEGX_NEGY", "POSX_NEGY"), corners, strict=True
    ):
        for axis, value in zip(FRAME, place, strict=True):
            header[f"FORCE_PLATE_CORNER_{corner}_{axis}"] = f"{1000 * value:.6f}"
    names = [f"{part}_{axis}" for part in ("Force", "Moment", "COP") for axis in FRAME]
    lines = [f"{key}\t{value}" for key, value in header.items()]
    lines.append("\t".join([*(["SAMPLE", "TIME"] if timed else []), *names]))
    for k, row in enumerate(np.hstack([force, moment, 1000 * pressure])):
        clock = [str(k + 1), f"{start_s + k / plate.rate_hz:.5f}"] if timed else []
        lines.append("\t".join([*clock, *(f"{x:.6f}" for x in row)]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
