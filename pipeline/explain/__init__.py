"""What the residuals of a trial are made of, and how sure that is."""
