"""What may be wrong with a trial: plates, platform, compensation, body, markers and filter."""
