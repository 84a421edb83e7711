"""What a moving treadmill adds to its own force plates, and how to take it away again."""
