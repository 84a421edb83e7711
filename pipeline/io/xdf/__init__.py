"""XDF files; the descriptions of streams, which they share with Lab Streaming Layer."""
