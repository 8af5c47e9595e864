"""Files that laboratories and optical design programs exchange."""
