"""Scenes of Mitsuba: what of a material they see (`record`), and themselves with a material put in (`show`)."""
