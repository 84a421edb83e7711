"""What trials' residuals are made of, in words and tables, as files, and for whole studies."""
