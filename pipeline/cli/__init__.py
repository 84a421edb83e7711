"""The command line, ``hbm``."""

from pipeline.cli.app import main

__all__ = ["main"]
