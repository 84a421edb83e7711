"""A study on the command line: init, check, run; report and view; simulate and demo."""

import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

from rich.table import Table
from rich.text import Text
from typer import Argument, Option

from hbm.spelling import counted, listed, printable
from pipeline.cli.options import RESULT, Jobs, Out, ResultsFolder, StudyFolder
from pipeline.cli.output import OUTPUT, plain_notes
from pipeline.cli.stopping import stoppable
from pipeline.cli.terminal import (
    PlainConsole,
    StepProgress,
    announcer,
    counts_of,
    follow_trials,
    note_line,
    outcome_record,
    print_block,
    print_table,
)

if TYPE_CHECKING:
    from hbm.notes import Note
    from pipeline.config.found_recordings import FoundSubject
    from pipeline.trial.result import TrialResult
    from pipeline.virtual_lab.protocol.walking_protocol import Setting

MOST_PLACES = 3
"""Files that are named with what concerns all of them."""


def init(
    folder: Annotated[Path, Argument(help="Folder for the new study.")],
    pattern: Annotated[
        str, Option(help='How names are read: "{subject}_{condition}_{recording}"; * is any text.')
    ] = "",
    every: Annotated[bool, Option("--all", help="Write every setting, with its meaning.")] = False,
) -> None:
    """Of the recordings in the folder, or as an example; edit it, then 'hbm check'.

    Folders belong to names: "{subject}/{condition}/*". Without {subject}, all are of one person.
    """
    from pipeline.config.found_recordings import NO_RECORDING, found_subjects, valid_names
    from pipeline.config.templates import write_template
    from pipeline.io.read import read_with_any_axes
    from pipeline.trial.ground.accelerometers import find_accelerometers

    console, new = PlainConsole(), not folder.exists()
    with console.status("reading recordings"):
        found = found_subjects(folder, pattern)
    for way, subjects in found.readings.items():
        console.say(f'--pattern "{way}"')
        print_table(_grid(subjects, MOST_PLACES), console)
    if found.readings:
        first, unclear = next(iter(found.readings)), next(iter(found.unused))
        raise ValueError(
            f"{folder}: {unclear} does not say surely whose it is: {len(found.readings)} readings; "
            f'nothing was written; state one, such as --pattern "{first}"'
        )
    treadmill = dict[str, Any]()
    for file in found.empty if found.subjects else ():
        with suppress(ValueError):
            sensors = find_accelerometers(read_with_any_axes(folder / file))
            found.unused[file] = f"{treadmill.get('calibration')} is the calibration"
            if not treadmill:
                names = valid_names(sensors, "sensor").values()
                channels = dict(zip(names, sensors.values(), strict=True))
                treadmill = {"calibration": file, "accelerometers": channels}
                del found.unused[file]
    if found.subjects:
        print_table(_grid(found.subjects), console)
    for item, file in treadmill.items():
        console.say(f"{item} of the treadmill: {file if item == 'calibration' else listed(file)}")
    alike: dict[str, list[str]] = {}
    for file, reason in found.unused.items():
        name = printable(Path(file).name)
        alike.setdefault(reason.removeprefix(f"{name}: "), []).append(printable(file))
    for reason, of_reason in alike.items():
        named = listed(of_reason) if reason == NO_RECORDING else ", ".join(of_reason)
        console.say(f"not used: {named}: {reason}")
    written = write_template(folder, found.subjects, treadmill, every=every)
    files = ", ".join(path.name for path in written)
    platform = ", how the platform moves as [treadmill.platform]" if treadmill else ""
    todo = f"state sex, height_m and mass_kg of each subject{platform}, then hbm check {folder}"
    why = "there is no such folder" if new else "no recording in it is used"
    template = "" if found.subjects else f" (a template: {why})"
    console.say(f"written to {folder}: {files}{template}; next: {todo}")


def _grid(subjects: Sequence["FoundSubject"], most: int | None = None) -> Table:
    """Lay out subject by condition, with the poses; of the first few subjects and files alone."""
    table = Table(show_lines=most is None)
    conditions = dict.fromkeys(name for subject in subjects for name in subject.trials)
    hips = any(subject.hip_trial for subject in subjects)
    table.add_column("subject")
    for head in ("pose", *(["hip trial"] if hips else []), *conditions):
        table.add_column(head, justify="default")
    for subject in subjects[:most]:
        poses = [subject.static or "none", *([subject.hip_trial or "none"] if hips else [])]
        cells = [[trial["file"] for trial in subject.trials.get(name, ())] for name in conditions]
        more = (["…"] if most and cell[most:] else [] for cell in cells)
        lines = ([f"{len(cell)}:", *cell[:most], *m] for cell, m in zip(cells, more, strict=True))
        files = ("\n".join(cell) if cell[1:] else "–" for cell in lines)
        table.add_row(subject.name, *poses, *files)
    if most and subjects[most:]:
        table.caption = f"and {counted(len(subjects) - most, 'more subject')}"
    return table


def check(
    study: StudyFolder,
    second_reader: Annotated[
        bool, Option("--second-reader", help="Also compare every C3D file as ezc3d reads it.")
    ] = False,
) -> int:
    """Every TOML file and every recording is read; exit code 2 where there are faults."""
    from pipeline.config.comparison import study_design
    from pipeline.config.study import read_study
    from pipeline.config.toml_file import StudyFaults
    from pipeline.run.check import check_study, read_twice, study_recordings
    from pipeline.statistics.design import in_words

    console, loaded = PlainConsole(), read_study(study)
    findings, recordings = check_study(loaded, jobs=None), study_recordings(loaded)
    agree = 0
    if second_reader:
        with StepProgress(console, "reading twice", "files") as progress:
            for done, path in enumerate(recordings, 1):
                agree += read_twice(path, findings)
                progress.show(path.name, done, len(recordings))
    for fault in findings.faults:
        console.say(f"FAULT {fault}")
    places = {remark.place for remark in findings.remarks}.intersection(loaded.files)
    doubtful = [remark for remark in findings.remarks if remark.doubtful]
    by_text: dict[Note | str, list[str]] = {}  # one of many files is printed once
    for remark in findings.remarks if OUTPUT.verbose else doubtful:
        by_text.setdefault(remark.said, []).append(remark.place)
    for text, where in by_text.items():
        console.say(f"{listed(where, MOST_PLACES)}:")
        console.say(f"- {text}" if isinstance(text, str) else note_line(text))
    if (healthy := len(places - {remark.place for remark in doubtful})) and not OUTPUT.verbose:
        console.say(f"no warnings: {counted(healthy, 'file')} (--verbose shows their contents)")
    if second_reader:
        console.say(f"both readers read the same in {agree} of {len(recordings)} files")
    design = in_words(study_design(loaded.file))
    if not findings.faults:
        console.say(
            f"{'' if loaded.file.comparison else 'no [comparison] in study.toml: '}{design}"
        )
    trials = sum(trial.exclude is None for trial in loaded.trials.values())
    remarks = [remark for remark in findings.remarks if isinstance(remark.said, str)]
    OUTPUT.result.update(
        faults=[],
        subjects=len(loaded.subjects),
        trials=trials,
        remarks=[{"place": remark.place, "text": remark.said} for remark in remarks],
        notes=[
            {"place": remark.place, **plain_notes([remark.said])[0]}
            for remark in findings.remarks
            if not isinstance(remark.said, str)
        ],
    )
    counts = (
        f"{counted(len(loaded.subjects), 'subject')}, {counted(trials, 'trial')}, "
        f"{counted(len(findings.faults), 'fault')}"
    )
    if findings.faults and (OUTPUT.quiet or OUTPUT.json):
        raise StudyFaults([str(fault) for fault in findings.faults], loaded.folder)
    console.say(counts if findings.faults else f"{counts}; next: hbm run {quote(str(study))}")
    return 2 if findings.faults else 0


def run(
    study: StudyFolder,
    subject: Annotated[list[str] | None, Option(help="Only this one; repeatable.")] = None,
    condition: Annotated[list[str] | None, Option(help="Only this one; repeatable.")] = None,
    jobs: Jobs = None,
    scheduler: Annotated[str | None, Option(help="Dask, e.g. tcp://host:8786.")] = None,
    out: Out = Path("results"),
    overwrite: Annotated[
        bool, Option("--overwrite", help="Replace results made with other settings or files.")
    ] = False,
) -> int:
    """Failed trials are listed with their reasons, the others are done; exit code 1."""
    from pipeline.config.study import read_study
    from pipeline.config.toml_file import StudyFaults
    from pipeline.run.run import forecast, plan, require_nothing_replaced, run_planned
    from pipeline.trial.study_files import read_study_laboratory

    console, start = PlainConsole(), time.monotonic()
    try:
        loaded = read_study(study, recordings=False)  # a trial whose file is missing fails alone
    except StudyFaults:
        loaded = read_study(study)  # what stops the run, and whatever else is missing
    planned = plan(loaded, out, subjects=subject, conditions=condition)
    if not any(job.size for job in planned):
        read_study(study)  # says what is missing
    if not overwrite:
        require_nothing_replaced(planned, out)
    if loaded.file.treadmill.check:
        console.say_notes(read_study_laboratory(loaded).notes)
    console.say(forecast(planned))
    outcomes = run_planned(
        loaded, planned, out, jobs=jobs, scheduler=scheduler, announce=announcer(console)
    )
    finished = follow_trials(outcomes, len(planned), "processing", "done and kept", console)
    console.say_notes(dict.fromkeys(note for one in finished for note in one.of_calibration))
    seconds = time.monotonic() - start
    OUTPUT.result.update(trials=[outcome_record(outcome) for outcome in finished], seconds=seconds)
    counts, then = counts_of(finished, "processed"), f"hbm report {quote(str(out))}"
    console.say(f"{counts}, in {seconds:.1f} s; next: {then}")
    return int(any(one.failure is not None or one.failed_variants for one in finished))


def report(
    folder: ResultsFolder = Path("results"),
    plan: Annotated[bool, Option("--plan", help="Print plan.md: how many subjects.")] = False,
    pages: Annotated[
        bool | None,
        Option("--pages/--no-pages", help="A page of every trial; default: up to 60 trials."),
    ] = None,
    figures: Annotated[str, Option(help="Formats, e.g. pdf,tiff; default: [figures].")] = "",
) -> None:
    """They are made from the results of 'hbm run', and written beside them."""
    from pipeline.config.schema import FIGURE_FORMATS
    from pipeline.config.toml_file import nearest
    from pipeline.report.write import NO_PAGES, write_report, writes_pages
    from pipeline.run.store import recorded_study_folder

    console = PlainConsole()
    formats = tuple(filter(None, figures.split(",")))
    for unknown in {*formats}.difference(FIGURE_FORMATS):
        raise ValueError(f"--figures {unknown}: no such format{nearest(unknown, FIGURE_FORMATS)}")
    with StepProgress(console, "report", "steps") as progress:

        def announce(step: str, done: int = 0, steps: int = 0) -> None:
            progress.update(progress.task, description=step, completed=done, total=steps or None)

        study = recorded_study_folder(folder)
        page = write_report(folder, study, announce, pages=pages, formats=formats)
    if not writes_pages(folder, pages):
        console.say(NO_PAGES.replace("RESULTS", str(folder)))
    if plan:
        console.say((page.parent / "plan.md").read_text(encoding="utf-8"))
    console.say(f"report: {page}")


def view(
    results: ResultsFolder = Path("results"),
    subject: Annotated[str | None, Option(help="Default: the first.")] = None,
    condition: Annotated[str | None, Option(help="Default: the first.")] = None,
    number: Annotated[
        str | None, Option("--recording", help="Of several, such as 02; default: the first.")
    ] = None,
    web: Annotated[bool, Option("--web", help="In a browser on this machine.")] = False,
    at: Annotated[float | None, Option(help="Where to open [s]; default: worst cycle.")] = None,
    beside: Annotated[
        str | None, Option(help="A condition, or SUBJECT/CONDITION, next to it.")
    ] = None,
    video: Annotated[Path | None, Option(help="MP4 file of the trial.")] = None,
    video_offset_s: Annotated[float, Option(help="When in the trial the video begins.")] = 0.0,
    save: Annotated[Path | None, Option(help="Only write the recording (.rrd).")] = None,
) -> None:
    """Show markers, body, plates, forces, and residuals over time, from the worst gait cycle on."""
    from pipeline.budgets.explanation import bands_of
    from pipeline.run.store import read_trial
    from pipeline.viewer.serve import results_contents
    from pipeline.viewer.serve import view as show
    from pipeline.viewer.trial import opening, write_recording

    console = PlainConsole()
    result = (
        results if results.suffix == RESULT else _result_of(results, subject, condition, number)
    )
    folder = result.parent.parent if result.parent.name == "trials" else result.parent
    if save and at is not None:
        raise ValueError("--at: a saved recording opens at its start; leave out --save or --at")
    film = None if video is None else (video, video_offset_s)

    def recorded(result: Path, trial: "TrialResult", **more: Any) -> Path:
        recording = save or folder / "viewer" / f"{result.stem}.rrd"
        recording.parent.mkdir(parents=True, exist_ok=True)
        write_recording(trial, recording, bands=bands_of(result, trial), **more)
        return recording

    with console.status(Text(f"preparing {result.stem}")):
        trial = read_trial(result)
        other = None
        if beside is not None:
            person, _, of_other = beside.rpartition("/")
            other = read_trial(_result_of(folder, person or trial.subject.id, of_other, None))
        cursor = opening(trial, at, beside=other is not None)
        recording = recorded(result, trial, beside=other, video=film)
    if save:
        console.say(f"recording: {save}")
    else:
        others = results_contents(result, lambda path: recorded(path, read_trial(path)))
        show(recording, web=web, cursor=cursor, others=others, announce=console.say)


def _result_of(folder: Path, *asked: str | None) -> Path:
    """Find the result of a subject's recording of a condition; of the first where not given."""
    from pipeline.run.store import read_trial

    if folder.is_file():
        raise ValueError(f"{folder}: is neither a results folder nor a result ({RESULT})")
    names = []
    for path in sorted((folder / "trials").glob(f"*{RESULT}")):
        name = read_trial(path, frames=False).name
        if all(one in (None, part) for one, part in zip(asked, name, strict=True)):
            return path
        names.append(str(name))
    if not names:
        raise ValueError(f"{folder}: no results of trials here; run 'hbm run STUDY --out {folder}'")
    raise ValueError(f"{folder}: no such trial; there are: {', '.join(names)}")


def simulate(
    folder: Annotated[Path, Argument(help="For the study; may hold a simulated one.")],
    setting: Annotated[Path | None, Option(help="TOML file; or thesis.")] = None,
    subjects: Annotated[int | None, Option(min=1, max=9, help="How many of the nine.")] = None,
    seed: Annotated[int | None, Option(help="Equal seeds give equal files.")] = None,
    jobs: Jobs = None,
) -> None:
    """C3D files, study files and the true values are written.

    Of a simulated study that is in the folder already, only what is missing is written. A setting
    is a TOML file with seed, [protocol] and [faults.…], or 'thesis': the faults that it states.
    """
    from pipeline.virtual_lab.protocol import walking_study
    from pipeline.virtual_lab.protocol.walking_protocol import Setting, find_setting

    there = walking_study.folder_setting(folder)
    chosen = find_setting(setting) if setting is not None else there or Setting()
    if seed is not None:
        chosen = chosen.model_copy(update={"seed": seed})
    if subjects is not None:
        protocol = chosen.protocol.model_copy(update={"subjects": subjects})
        chosen = chosen.model_copy(update={"protocol": protocol})
    if there is not None:
        walking_study.require_setting(folder, there, chosen)
    start, missing = time.monotonic(), walking_study.missing_files(folder, chosen)
    _simulate_study(folder, chosen, jobs, PlainConsole(), keep=True)
    recordings = sum(name.endswith(".c3d") for name in missing)
    there_already = len(walking_study.study_files(chosen)) - len(missing)
    PlainConsole().say(
        f"{counted(recordings, 'recording')} and {counted(len(missing) - recordings, 'other file')}"
        f" written to {folder} in {time.monotonic() - start:.0f} s, "
        f"{there_already} were there already; next: hbm run {folder}"
    )


def _simulate_study(
    folder: Path, setting: "Setting", jobs: int | None, console: PlainConsole, *, keep: bool = False
) -> None:
    from hbm.kernels.native import kernels
    from pipeline.virtual_lab.protocol.walking_study import simulate_study

    goes_on = "goes on" if keep else "begins again"
    with stoppable(lambda: f"the study is not complete; the same command {goes_on}"):
        kernels(announcer(console))
        with StepProgress(console, "simulating", "recordings") as progress:
            simulate_study(folder, setting, progress.show, jobs, keep=keep)


def demo(
    full: Annotated[bool, Option("--full", help="The thesis' 2.4 hours of walking.")] = False,
    jobs: Jobs = None,
    out: Out = Path("demo"),
) -> int:
    """Write recordings, report, figures and viewer recording to --out."""
    from pipeline.io.write import read_csv
    from pipeline.report.tables import means, windows_sentence
    from pipeline.statistics.design import EXPERIMENT_3
    from pipeline.virtual_lab.protocol.walking_protocol import DEMO, Setting

    console, start = PlainConsole(), time.monotonic()
    study, results = out / "study", out / "results"
    out.mkdir(parents=True, exist_ok=True)
    setting = Setting() if full else Setting(protocol=DEMO)
    _simulate_study(study, setting, jobs, console)
    console.say(
        f"{setting.protocol.subjects} simulated subjects walked on a treadmill that sways and "
        f"pitches; their recordings are in {study} ({time.monotonic() - start:.0f} s)"
    )
    code = run(study, jobs=jobs, out=results)
    report(results)
    residuals = read_csv(results / "residuals.csv").query("headline")
    print_block(means(residuals, EXPERIMENT_3), console)
    console.say(windows_sentence(residuals))
    view(results, "sub01", "sway", save=results / "viewer" / "sub01_sway.rrd")
    console.say(
        f"open {results / 'report.html'} in a browser; 'hbm view {results}' shows where the "
        "residuals come from"
    )
    return code
