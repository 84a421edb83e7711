"""What is received and computed, on disk as it comes."""
