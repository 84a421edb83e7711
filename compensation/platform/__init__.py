"""The moving platform: its pose, and plate wrenches in the lab."""
