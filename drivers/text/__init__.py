"""Instruments that speak plain text, by their description in YAML."""
