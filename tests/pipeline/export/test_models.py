"""The exported models hold the 18 segments, and are written without Pinocchio as with it."""

import subprocess
import sys
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from hbm.body import build_body
from hbm.coordinates import MOVING, SEGMENTS
from hbm.overrides import SegmentOverride
from hbm.segments import Inertia
from pipeline.cli.app import main
from pipeline.export.models import TOKEN_INERTIA, write_osim, write_urdf
from tests.hbm.people import person
from tests.pipeline.without_pinocchio import BLOCKED, COMMAND
from tests.synthetic import MASS_KG, synthetic_body


@pytest.fixture(scope="module", params=["by the table", "with a rucksack and a helmet"])
def body(request):
    if request.param == "by the table":
        return synthetic_body()
    center, tensor = np.array([-0.1, 0.0, 0.1]), 0.1 * np.eye(3)
    worn = {s: SegmentOverride(worn=Inertia(3.0, center, tensor)) for s in ("mid_trunk", "head")}
    return build_body(person(), mass=MASS_KG, overrides=worn)


def masses(path, link, mass):
    """Body of an XML model -> its mass [kg]."""
    found = {}
    for element in ET.parse(path).iter(link):
        value = element.find(mass)
        if value is not None:
            found[element.get("name")] = float(value.get("value") or value.text)
    return found


def test_opensim_gets_the_18_segments_and_the_two_massless_shoulder_points(body, tmp_path):
    write_osim(body, tmp_path / "body.osim")
    found = masses(tmp_path / "body.osim", "Body", "mass")
    assert {name for name, kg in found.items() if kg > 0} == set(SEGMENTS)
    assert {name for name, kg in found.items() if kg == 0} == set(MOVING) - set(SEGMENTS)
    assert sum(found.values()) == pytest.approx(MASS_KG, rel=1e-9)


def test_urdf_has_18_links_of_more_than_token_mass(body, tmp_path):
    write_urdf(body, tmp_path / "body.urdf")
    found = masses(tmp_path / "body.urdf", "link", "inertial/mass")
    assert {name for name, kg in found.items() if kg > TOKEN_INERTIA.mass} == set(SEGMENTS)
    assert sum(found.values()) == pytest.approx(MASS_KG, rel=1e-9)


@pytest.mark.slow
def test_hbm_export_writes_the_same_files_without_pinocchio(walker, tmp_path):
    """From the recording, and from the stored trial."""
    trial = (str(walker.source), "--sex", "female")
    assert main(["residuals", *trial, "--out", str(tmp_path)]) == 0
    stored = (str(tmp_path / f"{walker.source.stem}.parquet"),)

    def models(folder):
        files = folder / "body.osim", folder / "body.urdf"
        return ["--osim", str(files[0]), "--urdf", str(files[1])], files

    options, expected = models(tmp_path / "with")
    assert main(["export", *stored, *options]) == 0
    for name, source in (("recording", trial), ("stored", stored)):
        options, files = models(tmp_path / name)
        command = [sys.executable, "-c", BLOCKED + COMMAND, "export", *source, *options]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        for file, same in zip(files, expected, strict=True):
            assert file.read_bytes() == same.read_bytes()
