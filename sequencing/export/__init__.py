"""Controller programs and log files."""
