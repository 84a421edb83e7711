"""What a file or folder is, and what can be done with it: ``hbm FILE``."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from hbm.spelling import counted, listed, parse_toml

if TYPE_CHECKING:
    from pipeline.io.recording import Recording


@dataclass(frozen=True, slots=True)
class Recognised:
    """What a path is.

    Attributes
    ----------
    what
        A noun phrase, such as "a study of 3 subjects".
    commands
        What can be done with it, the likeliest first.
    walking
        Whether it is a recording with markers and plates, whose residuals can be computed.
    """

    what: str
    commands: tuple[str, ...]
    walking: bool = False

    def __str__(self) -> str:
        first = f"; next: {self.commands[0]}" if self.commands else ""
        return f"{self.what}{first}"


def recognise(path: Path) -> Recognised:
    """Say what a file or folder is; a ValueError or OSError where it cannot be read."""
    if path.is_dir():
        return _folder(path)
    name, suffix = path.name, path.suffix.lower()
    if suffix == ".parquet":
        return _result(path)
    if suffix == ".toml":
        return _toml(path)
    if suffix == ".json":
        return _json(path)
    if suffix in (".html", ".md", ".svg", ".png", ".csv.gz"):
        return Recognised(f"a page or picture; open {name} in a browser", ())
    if suffix == ".rrd":
        return Recognised("a recording of the Rerun viewer", (f"rerun {path}",))
    return _recording(path)


def _folder(path: Path) -> Recognised:
    """Say what a folder holds."""
    if (path / "study.toml").is_file():
        subjects = len([*path.glob("*.toml")]) - 1
        what = f"a study with {counted(subjects, 'subject file')}"
        return Recognised(what, _of_study(path))
    if (path / "plates.toml").is_file():
        return Recognised("recordings of known weights (experiment 1)", (f"hbm plates {path}",))
    if results := [*path.glob("trials/*.parquet")]:
        what = f"the results of a study, {counted(len(results), 'trial')}"
        commands = (f"hbm report {path}", f"hbm view {path}", f"hbm explain {path}")
        return Recognised(what, (*commands, f"hbm export {path} --format tables --out DIR"))
    if path.name == "trials" and any(path.glob("*.parquet")):
        return _folder(path.absolute().parent)
    if all((path / name).is_dir() for name in ("calibration", "validation")):
        return Recognised("calibration trials (experiment 2)", (f"hbm calibration rank {path}",))
    from pipeline.io.read import is_recording  # numpy, which the others do without

    recordings = [file for file in sorted(path.iterdir()) if file.is_file() and is_recording(file)]
    if recordings:
        what = f"a folder with {counted(len(recordings), 'recording')} and no study"
        return Recognised(what, (f"hbm init {path}", f"hbm {recordings[-1]}"))
    what = "a folder without study, results or recordings"
    return Recognised(what, (f"hbm init {path}", "hbm demo"))


def _of_study(path: Path) -> tuple[str, ...]:
    """Give what can be done with a study; one without subjects or not in TOML is checked alone."""
    check = f"hbm check {path}"
    try:
        tables = [parse_toml(file.read_text("utf-8")) for file in sorted(path.glob("*.toml"))]
    except (ValueError, OSError):
        return (check,)
    subjects = [table["id"] for table in tables if {"id", "trials"} <= table.keys()]
    live = (f"hbm live --study {path} --subject {subject}" for subject in subjects[:1])
    return (check, f"hbm run {path}", *live) if subjects else (check,)


def _result(path: Path) -> Recognised:
    """Say of which trial a result is."""
    from pipeline.run.store import read_trial

    result = read_trial(path, frames=False)
    commands = (f"hbm view {path}", f"hbm export {path} --format tables --out DIR")
    return Recognised(f"the result of a trial, {result.source.name}", commands)


def _toml(path: Path) -> Recognised:
    """Say what a text file of settings is about."""
    from pipeline.config.toml_file import read_table

    table = read_table(path)
    if path.name == "study.toml" or "conditions" in table:
        return _folder(path.absolute().parent)
    for keys, what, command in (
        ({"weights"}, "a list of known weights", f"plates {path.parent}"),
        ({"trials"}, "a subject file of a study", f"check {path.parent}"),
        ({"markers", "landmarks"}, "a marker set", f"residuals TRIAL --marker-set {path}"),
        ({"protocol", "faults"}, "a simulation", f"simulate DIR --setting {path}"),
    ):
        if keys & {*table}:
            return Recognised(what, (f"hbm {command}",))
    what = f"a TOML file with {listed(table) or 'nothing in it'}, of unknown role"
    return Recognised(what, ("hbm residuals TRIAL --segments FILE", "hbm init DIR"))


def _json(path: Path) -> Recognised:
    """Say which calibration a file holds."""
    from compensation import from_json, plate_calibration
    from pipeline.io.input_file import read_text

    text = read_text(path)
    with suppress(ValueError, KeyError, TypeError):
        plates = plate_calibration.from_json(text).plates
        what = f"a calibration of {len(plates)} plates by known weights"
        return Recognised(what, (f"hbm residuals TRIAL --plate-calibration {path}",))
    with suppress(ValueError, KeyError, TypeError):
        plates_of = listed(from_json(text).plates)
        commands = (
            f"hbm residuals TRIAL --calibration {path}",
            f"hbm calibration check {path} RECORDING",
        )
        return Recognised(f"a calibration of a moving treadmill, {plates_of}", commands)
    return Recognised("a JSON file that is no calibration", ())


def _recording(path: Path) -> Recognised:
    """Say what a recording holds."""
    from pipeline.io.read import FORCES_BESIDE, file_format, read_with_any_axes
    from pipeline.io.recording import MIN_MARKERS

    kind, recording = file_format(path), read_with_any_axes(path)
    markers, plates = recording.markers, recording.plates
    walking = bool(plates) and len(markers.names) >= MIN_MARKERS
    uses: tuple[str, ...]
    uses = (f"hbm residuals TRIAL --static {path}",)
    if kind in FORCES_BESIDE:
        uses += (f"hbm residuals {path} --forces FORCES.mot",)
    if walking:
        exported = f"hbm export {path} --format osim --format tables --out DIR"
        uses = f"hbm residuals {path}", f"hbm explain {path}", exported, f"hbm live --replay {path}"
    elif plates:
        uses = _of_treadmill(path, recording)
    seconds = len(markers.time) / markers.rate_hz
    count = counted(len(plates), "plate") if plates else "no plates"
    what = f"a {kind} recording, {seconds:.1f} s, {len(markers.names)} markers, {count}"
    return Recognised(what, uses, walking)


def _of_treadmill(path: Path, recording: "Recording") -> tuple[str, ...]:
    """Give what can be done with plates without a body: by the platform's motion and their load."""
    from compensation.inertia.quality import MIN_LOAD_N
    from compensation.inputs import refuse_still_platform
    from pipeline.config.schema import Treadmill
    from pipeline.trial.ground import accelerometers as of_treadmill

    try:
        sensors = of_treadmill.find_accelerometers(recording)
        treadmill = Treadmill(accelerometers=sensors)
        clock, readings = of_treadmill.accelerations(recording, treadmill)
    except ValueError:
        return ()
    filtered = of_treadmill.setup_of(recording, treadmill).low_pass(readings, clock)
    load_n = max(abs(float(plate.wrench[:, 2].mean())) for plate in recording.plates)
    with suppress(ValueError):
        refuse_still_platform(*of_treadmill.without_gaps(filtered))
        if load_n < MIN_LOAD_N:
            fitted = f"hbm calibration fit {path} --out calibration.json"
            return fitted, f"hbm calibration check CALIBRATION.json {path}"
    return (f"hbm calibration fit EMPTY.c3d --beside {path} --out calibration.json",)
