"""From the markers of a calibration pose to joint centres and axes."""
