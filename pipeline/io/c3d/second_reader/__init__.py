"""A second, independent reading of a C3D file: by ezc3d, or c3d where ezc3d cannot."""
