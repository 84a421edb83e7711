"""The human body model: markers and wrenches in, coordinates and pelvis residuals out."""
