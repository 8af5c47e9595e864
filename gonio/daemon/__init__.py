"""The daemon: one process, one thread of it, owns a rig; everybody else asks it over a Unix socket."""
