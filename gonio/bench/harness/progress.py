"""How far a study is: a bar on a terminal, a line at every tenth in a log; both with the time that is left."""

import sys
import time

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn


class Watched:
    """Counts the cells of a study, of which `known` are there at the start."""

    def __init__(self, cells: int, known: int):
        self.cells, self.done, self.known, self.began = cells, known, known, time.monotonic()
        self.console = Console(stderr=True)
        self.bar = Progress(
            TextColumn("cells"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(elapsed_when_finished=False),
            console=self.console,
            transient=True,
            disable=not self.console.is_terminal,
        )

    def __enter__(self) -> "Watched":
        self.bar.start()
        self.task = self.bar.add_task("cells", total=self.cells, completed=self.known)
        return self

    def __exit__(self, *exc) -> None:
        self.bar.stop()

    def one(self) -> None:
        """One more is made."""
        self.done += 1
        self.bar.advance(self.task)
        if self.bar.disable and (10 * self.done) // self.cells > (10 * (self.done - 1)) // self.cells:
            spent = time.monotonic() - self.began
            left = spent / (self.done - self.known) * (self.cells - self.done)
            print(f"cells {self.done}/{self.cells}, {spent / 60:.1f} min, {left / 60:.1f} left", file=sys.stderr)
