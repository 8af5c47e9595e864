"""Studies of run time, rig time and size."""
