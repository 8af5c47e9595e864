"""A reconstruction as a table: quick to look up and to draw from."""
