"""A report of made-up results, written once."""

import pytest

from pipeline.report import write
from tests.pipeline.fake_results import write_fake_results


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """Three subjects in three conditions, reported without figures."""
    folder = write_fake_results(tmp_path_factory.mktemp("results"), subjects=3, cycles=3)
    with pytest.MonkeyPatch.context() as patch:
        for figures in ("study_figures", "joint_figures"):
            patch.setattr(write, figures, lambda *given: iter(()))
        write.write_report(folder)
    return folder
