"""Marker trajectories, and marker sets: the segment and the landmark of each marker."""

from hbm.markers.marker_set import (
    LANDMARKS,
    MarkerSet,
    SetMarker,
    exchange,
    marker_sets,
    read_marker_set,
    recognise_marker_set,
    renaming,
    usual_landmarks,
)
from hbm.markers.trajectories import Markers

__all__ = [
    "LANDMARKS",
    "MarkerSet",
    "Markers",
    "SetMarker",
    "exchange",
    "marker_sets",
    "read_marker_set",
    "recognise_marker_set",
    "renaming",
    "usual_landmarks",
]
