"""What ends a run before it has begun."""


class NoSupport(RuntimeError):
    """No direction with a measurable value was found: the rig reaches nothing, or nothing reflects. One line."""

    exit_code = 2
