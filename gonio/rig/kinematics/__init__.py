"""Poses <-> directions, one file for each geometry of rig."""
