"""In tests of commands nobody looks at figures: those of this process are not drawn."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def _no_figures():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.report.laboratory._of_recording", lambda *given: [])
        patch.setattr("pipeline.figures.style._printed", lambda *given: b"")
        yield
