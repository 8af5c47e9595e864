"""What a run keeps: its folder, its database, its config."""
