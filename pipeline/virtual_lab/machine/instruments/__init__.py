"""The laboratory's instruments and their errors."""
