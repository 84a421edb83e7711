"""The figures of the laboratory's page are not looked at in tests of commands."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def _no_figures_of_the_laboratory():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.report.laboratory._of_recording", lambda *given: [])
        yield
