"""From the markers of a calibration pose to joint centres, axes and segment frames."""
