"""What becomes of the light and the motors when something goes wrong in a task of the rig."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from gonio.rig.errors import RigError
from gonio.rig.uninterrupted import uninterrupted


@contextmanager
def dark_after_errors(
    off: Callable[[], None], halt: Callable[[], None], halt_ahead: Callable[[], None]
) -> Iterator[None]:
    """Light off after any error inside, which is raised on.

    off: the light; halt: everything; halt_ahead: a motion begun ahead of its turn, all that can move after a RigError.
    A loop that is left early is no error: a run that has enough looks once more by the light that it has.
    """
    try:
        yield
    except (RigError, OSError):
        with uninterrupted():
            with suppress(RigError):
                halt_ahead()
            off()
        raise
    except GeneratorExit:
        raise
    except BaseException as e:  # Ctrl-C, or an error in somebody's own code
        with uninterrupted():  # a second Ctrl-C must not leave the lamp burning
            with suppress(Exception):
                halt()
            try:
                off()
            except Exception as stays_on:
                e.add_note(f"and the light could not be put off: {stays_on}")
        raise
