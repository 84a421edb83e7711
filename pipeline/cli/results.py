"""Results on the command line: report and viewer."""

from pathlib import Path

from rich.console import Console

from pipeline.config.study import Study, read_study
from pipeline.run.store import read_summary, recall_study
from pipeline.trial.process import process_trial, read_file

PERTURBATION_S = 1.0


def report(folder: Path) -> Path:
    """Write everything that is made from a study's results and say where it is.

    Parameters
    ----------
    folder
        Results folder.

    Returns
    -------
    Path
        ``report.html``.

    Raises
    ------
    ValueError, OSError
        If there are no results, or they cannot be written.
    """
    from pipeline.report.write import write_report

    console = Console(highlight=False, markup=False)
    with console.status("report") as status:
        page = write_report(folder, recall_study(folder), status.update)
    console.print(f"report: {page}", soft_wrap=True)
    return page


def view(
    folder: Path,
    *,
    subject: str | None = None,
    condition: str | None = None,
    web: bool = False,
    save: Path | None = None,
) -> None:
    """Show a trial of a study in the viewer, and its mean gait cycle beside it.

    Parameters
    ----------
    folder
        Results folder.
    subject, condition
        Which trial; the first by default.
    web
        In a browser on this machine.
    save
        Where to write the trial's recording; nothing is opened then.

    Raises
    ------
    ValueError
        If there is no such trial, or the recordings are gone.
    """
    from pipeline.viewer.serve import view as show

    subject, condition = _chosen(folder, subject, condition)
    stem = folder / "viewer" / f"{subject}_{condition}"
    trial, cycles = Path(f"{stem}.rrd"), Path(f"{stem}_cycles.rrd")
    console = Console(highlight=False, markup=False)
    key = read_summary(folder / "trials" / f"{subject}_{condition}.parquet").key
    marker = Path(f"{stem}.key")
    fresh = trial.is_file() and cycles.is_file() and marker.is_file() and marker.read_text() == key
    if save is not None or not fresh:
        with console.status(f"preparing {subject} {condition}"):
            write_view(folder, subject, condition, save or trial, None if save else cycles)
        if save is None:
            marker.write_text(key)
    if save is not None:
        console.print(f"recording: {save}", soft_wrap=True)
    else:
        show([trial, cycles], web=web, tell=lambda line: console.print(line, soft_wrap=True))


def write_view(
    folder: Path, subject: str, condition: str, trial: Path, cycles: Path | None
) -> None:
    """Process a trial again and write it for the viewer.

    Parameters
    ----------
    folder
        Results folder.
    subject, condition
        Which trial.
    trial
        Recording to write.
    cycles
        Recording of the mean gait cycle to write, if any.

    Raises
    ------
    ValueError
        If the study's files are not where they were.
    """
    from pipeline.viewer.trial import write_cycles, write_recording

    where = recall_study(folder)
    if where is None:
        raise ValueError(
            f"{folder}: the study that these results come from is not there any more; "
            f"run 'hbm run STUDY --out {folder}' again"
        )
    study: Study = read_study(where)
    result = process_trial(study, subject, condition)
    stated = study.subject(subject).trials[condition]
    assert stated.file is not None
    spans = [(float(t), float(t) + PERTURBATION_S, "perturbation") for t in result.onsets]
    trial.parent.mkdir(parents=True, exist_ok=True)
    recording = read_file(study, stated.file, stated)
    write_recording(result, recording, trial, perturbations=spans)
    if cycles is not None:
        write_cycles(result, cycles)


def _chosen(folder: Path, subject: str | None, condition: str | None) -> tuple[str, str]:
    """Find the trial asked for among the results."""
    there = []
    for path in sorted((folder / "trials").glob("*.parquet")):
        trial = read_summary(path)
        there.append((trial.subject.id, trial.condition))
    for found in there:
        if subject in (None, found[0]) and condition in (None, found[1]):
            return found
    if not there:
        raise ValueError(f"{folder}: no results of trials here; run 'hbm run STUDY --out {folder}'")
    known = ", ".join(" ".join(found) for found in there)
    raise ValueError(f"{folder}: no such trial; there are: {known}")
