"""Faults of plates that a trial is searched for are not looked at where it is compared live."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def _no_search_for_faults_of_plates():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.trial.process.find_faults", lambda chain: ())
        yield
