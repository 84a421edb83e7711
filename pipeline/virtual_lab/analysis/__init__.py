"""What each fault of a laboratory adds to each residual."""
