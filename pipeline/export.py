"""A trial's body and results in the files of other programs."""

from dataclasses import dataclass
from pathlib import Path

from pipeline.bids import write_bids
from pipeline.one_trial import Request, process, read_asked
from pipeline.opensim_model import write_osim
from pipeline.opensim_tables import (
    write_coordinates,
    write_external_loads,
    write_forces,
    write_trc,
)
from pipeline.urdf import write_urdf


@dataclass(frozen=True, slots=True)
class BidsTarget:
    """Where a recording goes in a BIDS data set: its folder, and labels of subject and task."""

    folder: Path
    subject: str
    task: str


def run(
    request: Request,
    *,
    osim: Path | None = None,
    urdf: Path | None = None,
    tables: Path | None = None,
    bids: BidsTarget | None = None,
) -> None:
    """Write what was asked for; process the trial where that needs it.

    Parameters
    ----------
    request
        Which trial, and how.
    osim, urdf
        Model files; not written where None.
    tables
        Folder for coordinates and external loads (.mot), generalized forces (.sto) and markers
        (.trc), named after the trial; not written where None.
    bids
        Data set that the recording is added to, unprocessed; not written where None.

    Raises
    ------
    ValueError, OSError
        If nothing was asked for, or the trial cannot be processed.
    """
    if not (osim or urdf or tables or bids):
        raise ValueError(
            "nothing to export; name --osim FILE, --urdf FILE, --tables DIR or --bids DIR"
        )
    written = []
    if bids is not None:
        written += write_bids(read_asked(request), bids.folder, bids.subject, bids.task)
    if osim or urdf or tables:
        written += _processed(request, osim, urdf, tables)
    print("written: " + ", ".join(str(path) for path in written))


def _processed(
    request: Request, osim: Path | None, urdf: Path | None, tables: Path | None
) -> list[Path]:
    """Process the trial and write the models and tables asked for."""
    result, recording = process(request)
    written = []
    for path, write in ((osim, write_osim), (urdf, write_urdf)):
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            write(result.body, path)
            written.append(path)
    if tables is not None:
        tables.mkdir(parents=True, exist_ok=True)
        stem = tables / request.trial.stem
        time = result.motion.time
        write_coordinates(result.motion, Path(f"{stem}_coordinates.mot"))
        write_forces(result.measured, Path(f"{stem}_forces.sto"))
        write_external_loads(time, result.ground["measured"], Path(f"{stem}_loads.mot"))
        write_trc(recording.markers, Path(f"{stem}.trc"))
        written += sorted(tables.glob(f"{request.trial.stem}*"))
    return written
