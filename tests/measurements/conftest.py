"""Simulated walks, shared with the tests of the virtual laboratory."""

from tests.pipeline.virtual_lab.conftest import perfect, walked

__all__ = ["perfect", "walked"]
