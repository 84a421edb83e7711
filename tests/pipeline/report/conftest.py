"""A report of made-up results, written once."""

import pytest

from pipeline.report.write import write_report
from tests.pipeline.fake_results import without_figures, write_fake_results


@pytest.fixture(scope="module", autouse=True)
def one_process():
    """Trials are read and figures drawn in this process: to start others takes longer."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("joblib.cpu_count", lambda: 1)
        yield


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """Three subjects in three conditions, reported without figures."""
    folder = write_fake_results(tmp_path_factory.mktemp("results"), subjects=3, cycles=3)
    with without_figures():
        write_report(folder)
    return folder
