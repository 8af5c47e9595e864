"""What a lab does beside a run: first files, scans, a queue."""
