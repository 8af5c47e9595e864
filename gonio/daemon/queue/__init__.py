"""Samples that wait for a rig: a list on disk, and the thread that has the rig work it off."""
