"""The laboratory's own bodies: skeleton, inertias, kinematics and momentum."""
