"""What a reconstruction has to say against the samples it was given."""


class ReconstructionError(ValueError):
    """Samples from which no BRDF can be made: says what is wrong with them and what to do. One line."""

    exit_code = 2


class ReconstructionWarning(UserWarning):
    """What was done to samples that are not as they should be. One line."""
