"""OpenSim's tools without their reports; and their reading and writing alone, to be subtracted."""

from pathlib import Path

import numpy as np
import opensim

FORCES = "id.sto"


def tasks(folder: Path):
    opensim.Logger.setLevelString("Off")
    program = OpenSim(folder, dict(np.load(folder / "trial.npz")))
    return {
        "ik": program.inverse_kinematics,
        "ik tool": program.run_inverse_kinematics,
        "ik files": program.inverse_kinematics_files,
        "id": program.inverse_dynamics,
        "id tool": program.run_inverse_dynamics,
        "id files": program.inverse_dynamics_files,
    }


class OpenSim:
    def __init__(self, folder, given):
        self.folder, self.time, self.translations = folder, given["time"], given["translations"]
        self.coordinates, self.markers = given["coordinates"], given["markers"]
        self.model = opensim.Model(self.path("body.osim"))
        self.model.initSystem()

    def path(self, name):
        return str(self.folder / name)

    def run_inverse_kinematics(self, output="Unassigned"):
        """Run at the default accuracy; an output of this name is not written."""
        tool = opensim.InverseKinematicsTool()
        tool.setModel(self.model)
        tool.setMarkerDataFileName(self.path("markers.trc"))
        tool.set_report_errors(False)
        for name in self.markers:
            task = opensim.IKMarkerTask()
            task.setName(str(name))
            task.setWeight(1)
            tool.getIKTaskSet().cloneAndAppend(task)
        tool.setOutputMotionFileName(output)
        self.run(tool)

    def inverse_kinematics(self):
        self.run_inverse_kinematics(self.path("ik.mot"))
        q = self.table("ik.mot", self.coordinates)
        return np.where(self.translations, q, np.radians(q))

    def inverse_kinematics_files(self):
        opensim.TimeSeriesTableVec3(self.path("markers.trc"))

    def run_inverse_dynamics(self):
        tool = opensim.InverseDynamicsTool()
        tool.setModel(self.model)
        tool.setCoordinatesFileName(self.path("coordinates.mot"))
        tool.setExternalLoadsFileName(self.path("grf.xml"))
        tool.setOutputGenForceFileName(FORCES)
        self.run(tool)

    def inverse_dynamics(self):
        self.run_inverse_dynamics()
        kinds = np.where(self.translations, "force", "moment")
        names = [f"{name}_{kind}" for name, kind in zip(self.coordinates, kinds, strict=True)]
        return self.table(FORCES, names)

    def inverse_dynamics_files(self):
        for name in ("coordinates.mot", "grf.mot"):
            opensim.Storage(self.path(name))
        opensim.Storage(self.path(FORCES)).printToFile(self.path("copy.sto"), "w", "")

    def run(self, tool):
        tool.setStartTime(self.time[0])
        tool.setEndTime(self.time[-1])
        tool.setResultsDir(str(self.folder))
        assert tool.run()

    def table(self, name, columns):
        table = opensim.TimeSeriesTable(self.path(name))
        labels = list(table.getColumnLabels())
        return table.getMatrix().to_numpy()[:, [labels.index(column) for column in columns]]
