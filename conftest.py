"""Examples in docstrings: an empty folder to write files in; for `hbm`, a subject to show."""

import pytest


@pytest.fixture(autouse=True)
def _empty_folder_for_examples(request):
    if isinstance(request.node, pytest.DoctestItem):
        folder = request.getfixturevalue("tmp_path")
        request.getfixturevalue("monkeypatch").chdir(folder)


@pytest.fixture(autouse=True)
def _subject_for_examples(request, doctest_namespace):
    """In the examples of `hbm`, ``static`` is a calibration pose and ``body`` the body from it."""
    if isinstance(request.node, pytest.DoctestItem) and request.node.name.startswith("hbm."):
        from tests.synthetic import synthetic_body, synthetic_t_pose

        doctest_namespace |= {"static": synthetic_t_pose(), "body": synthetic_body()}
