"""One thread per process; for examples in docstrings an empty folder and, for `hbm`, a subject."""

import os

import pytest

# before NumPy is loaded: tests run on every core, and more threads than cores only wait
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


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
