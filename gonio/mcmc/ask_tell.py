"""What the acquisition loop asks of whoever decides where to look: a `Sampler`, or a list given by hand."""

from typing import Protocol

from numpy.typing import NDArray

from gonio.geometry import Array
from gonio.mcmc.chain.steps import Steps
from gonio.mcmc.sampler import Batch


class AskTell(Protocol):
    """`ask` gives what is wanted next and was not told yet, `tell` takes any subset of it in any order."""

    unmeasured_in_a_row: int

    def ask(self) -> Batch: ...

    def tell(self, ids: NDArray, f: Array, sigma: Array | None = None) -> None: ...

    def take_steps(self) -> Steps: ...
