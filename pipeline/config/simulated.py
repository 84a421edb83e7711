"""Where a simulated study states what was simulated."""

from typing import Final

SIMULATED: Final = "truth/setting.toml"
"""Relative to the folder of the study."""
