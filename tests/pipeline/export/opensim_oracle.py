"""OpenSim's answers about an exported body and trial, found in a process of its own.

The wheels of OpenSim and casadi each bring a casadi library of the same name, so OpenSim cannot be
imported where the body model is. ``python opensim_oracle.py FOLDER`` reads what the exporters and
the test left in FOLDER and leaves ``answers.npz`` there.
"""

import sys
from pathlib import Path

import numpy as np
import opensim


class Oracle:
    def __init__(self, folder):
        self.folder = folder
        self.given = dict(np.load(folder / "given.npz"))
        self.model = opensim.Model(str(folder / "body.osim"))
        markers = self.model.getMarkerSet()
        self.markers = [markers.get(k).getName() for k in range(markers.getSize())]

    def answers(self):
        self.run_inverse_kinematics()
        self.run_inverse_dynamics()
        out = {
            "markers": self.markers,
            "positions": self.positions(),
            "falling": self.falling(),
            "tau": self.inverse_dynamics(),
        }
        for name in ("ik.mot", "id.sto"):
            out |= table(name, opensim.TimeSeriesTable(str(self.folder / name)))
        return out

    def positions(self):
        """All markers at the given poses."""
        state, order = self.start(self.model)
        markers = [self.model.getMarkerSet().get(name) for name in self.markers]
        out = []
        for q in self.given["poses"]:
            state.setQ(vector(q[order]))
            self.model.realizePosition(state)
            out.append([marker.getLocationInGround(state).to_numpy() for marker in markers])
        return out

    def falling(self):
        """Accelerations at the given poses and speeds, let go."""
        state, order = self.start(self.model)
        out = np.empty_like(self.given["poses"])
        for k, (q, v) in enumerate(zip(self.given["poses"], self.given["speeds"], strict=True)):
            state.setQ(vector(q[order]))
            state.setU(vector(v[order]))
            self.model.realizeAcceleration(state)
            out[k, order] = state.getUDot().to_numpy()
        return out

    def inverse_dynamics(self):
        """Generalized forces at the given coordinates, speeds, accelerations and loads."""
        model = opensim.Model(str(self.folder / "body.osim"))
        model.addModelComponent(opensim.ExternalLoads(str(self.folder / "grf.xml"), True))
        state, order = self.start(model)
        solver = opensim.InverseDynamicsSolver(model)
        time, q, v, a = (self.given[name] for name in ("time", "q", "v", "a"))
        tau = np.empty_like(q)
        for k, t in enumerate(time):
            state.setTime(t)
            state.setQ(vector(q[k, order]))
            state.setU(vector(v[k, order]))
            model.realizeDynamics(state)
            tau[k, order] = solver.solve(state, vector(a[k, order])).to_numpy()
        return tau

    def run_inverse_kinematics(self):
        tool = opensim.InverseKinematicsTool()
        tool.setModel(self.model)
        tool.setMarkerDataFileName(str(self.folder / "markers.trc"))
        tool.setStartTime(self.given["time"][0])
        tool.setEndTime(self.given["time"][-1])
        tool.set_accuracy(1e-9)
        for name in self.markers:
            task = opensim.IKMarkerTask()
            task.setName(name)
            task.setWeight(1)
            tool.getIKTaskSet().cloneAndAppend(task)
        tool.setOutputMotionFileName(str(self.folder / "ik.mot"))
        tool.setResultsDir(str(self.folder))
        assert tool.run()

    def run_inverse_dynamics(self):
        """OpenSim's tool, which reads the exported tables and differentiates by itself."""
        tool = opensim.InverseDynamicsTool()
        tool.setModel(self.model)
        tool.setCoordinatesFileName(str(self.folder / "coordinates.mot"))
        tool.setExternalLoadsFileName(str(self.folder / "grf.xml"))
        tool.setStartTime(self.given["time"][0])
        tool.setEndTime(self.given["time"][-1])
        tool.setResultsDir(str(self.folder))
        tool.setOutputGenForceFileName("id.sto")
        assert tool.run()

    def start(self, model):
        """Give a state, and where each of its variables is among our coordinates."""
        state = model.initSystem()
        for k, name in enumerate(self.given["coordinates"]):
            model.getCoordinateSet().get(str(name)).setSpeedValue(state, k)
        return state, state.getU().to_numpy().astype(int)


def vector(values):
    return opensim.Vector.createFromMat(values)


def table(name, content):
    return {
        f"{name}: labels": content.getColumnLabels(),
        f"{name}: values": content.getMatrix().to_numpy(),
    }


if __name__ == "__main__":
    opensim.Logger.setLevelString("Warn")
    folder = Path(sys.argv[1])
    np.savez(folder / "answers.npz", **Oracle(folder).answers())
