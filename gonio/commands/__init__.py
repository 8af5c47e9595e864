"""The operator's commands, grouped as they are used. Imports inside: `gonio --help` has to be quick."""
