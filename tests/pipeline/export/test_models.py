"""The exported models hold the 18 segments, and are written without Pinocchio as with it."""

import subprocess
import sys
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from hbm.body import build_body
from hbm.coordinates import SEGMENTS
from hbm.segments import Inertia, SegmentOverride
from pipeline.cli.app import main
from pipeline.export.models import TOKEN_INERTIA, write_osim, write_urdf
from tests.hbm.people import person
from tests.synthetic import MASS_KG, synthetic_body

BLOCKED = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "pinocchio":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocked())
"""
COMMAND = "import sys; from pipeline.cli.app import main; raise SystemExit(main(sys.argv[1:]))"


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


@pytest.mark.parametrize(
    ("write", "link", "mass", "token_kg"),
    [
        (write_osim, "Body", "mass", 0),
        (write_urdf, "link", "inertial/mass", TOKEN_INERTIA.mass),
    ],
)
def test_18_segments_carry_the_mass(body, tmp_path, write, link, mass, token_kg):
    write(body, tmp_path / "body.xml")
    found = masses(tmp_path / "body.xml", link, mass)
    assert {name for name, kg in found.items() if kg > token_kg} == set(SEGMENTS)
    assert sum(found.values()) == pytest.approx(MASS_KG, rel=1e-9)


@pytest.mark.slow
def test_hbm_export_writes_the_same_files_without_pinocchio(walker, tmp_path):
    trial = (str(walker.source), "--sex", "female")
    assert main(["residuals", *trial, "--out", str(tmp_path)]) == 0
    stored = (str(tmp_path / f"{walker.source.stem}.parquet"),)

    def models(folder):
        files = [folder / f"{walker.source.stem}.{form}" for form in ("osim", "urdf")]
        return ["--format", "osim", "--format", "urdf", "--out", str(folder)], files

    options, expected = models(tmp_path / "with")
    assert main(["export", *stored, *options]) == 0
    options, files = models(tmp_path / "without")
    command = [sys.executable, "-c", BLOCKED + COMMAND, "export", *trial, *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    for file, same in zip(files, expected, strict=True):
        assert file.read_bytes() == same.read_bytes()
