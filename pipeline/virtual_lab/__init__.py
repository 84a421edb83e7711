"""A laboratory in software: people who walk on a moving, instrumented treadmill, and the truth."""
