"""Reconstructions by a normalizing flow."""
