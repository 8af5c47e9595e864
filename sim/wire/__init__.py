"""Byte-level emulators on pseudo-terminals: what the real drivers talk to where no hardware is at hand."""
