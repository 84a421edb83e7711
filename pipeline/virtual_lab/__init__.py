"""A simulated laboratory: people who walk on a moving, instrumented treadmill, and the truth."""
