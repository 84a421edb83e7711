"""A trial's body and results in the files of other programs."""

from pathlib import Path

from pipeline.one_trial import Request, process
from pipeline.opensim_model import write_osim
from pipeline.opensim_tables import (
    write_coordinates,
    write_external_loads,
    write_forces,
    write_trc,
)
from pipeline.urdf import write_urdf


def run(request: Request, *, osim: Path | None, urdf: Path | None, tables: Path | None) -> None:
    """Process a trial and write what was asked for.

    Parameters
    ----------
    request
        Which trial, and how.
    osim, urdf
        Model files; not written where None.
    tables
        Folder for coordinates and external loads (.mot), generalized forces (.sto) and markers
        (.trc), named after the trial; not written where None.

    Raises
    ------
    ValueError, OSError
        If nothing was asked for, or the trial cannot be processed.
    """
    if not (osim or urdf or tables):
        raise ValueError("nothing to export; name --osim FILE, --urdf FILE or --tables DIR")
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
    print("written: " + ", ".join(str(path) for path in written))
