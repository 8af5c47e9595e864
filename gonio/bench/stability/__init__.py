"""Numbers that hold: public functions against 50 digits (`sweep`), whole runs against nonsense (`runs`)."""
