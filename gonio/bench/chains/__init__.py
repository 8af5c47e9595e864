"""Studies of how well a chain samples."""
