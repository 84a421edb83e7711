"""Static and dynamic models of a flexible treadmill, judged on motion of other kinds."""
