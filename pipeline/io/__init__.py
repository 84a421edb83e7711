"""Files: every format -> `Recording`, and files written whole."""
