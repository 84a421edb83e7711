"""The study in `subjects` is the virtual laboratory's."""

import pytest

from pipeline.virtual_lab.protocol.walking_protocol import Setting
from pipeline.virtual_lab.protocol.walking_study import study_texts
from tests.subjects.conftest import SUBJECTS

TEXTS = study_texts(Setting())


@pytest.mark.parametrize("name", TEXTS)
def test_the_text_is_what_the_simulation_of_experiment_3_writes(name):
    """After a change of the protocol: delete the file and run `hbm simulate subjects`."""
    assert (SUBJECTS / name).read_text(encoding="utf-8") == TEXTS[name]
