"""The pretrained flows in gonio/flow/weights: a zoo by GGX roughness, and one conditional on a material's code.

`gonio bench pretrain` makes them.
"""

import os
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

import numpy as np

from gonio.brdf.saved import read_arrays
from gonio.flow.cubes import make_cube
from gonio.flow.flow import Flow, FlowError
from gonio.flow.material_code import Codes
from gonio.geometry import Array

FOLDER = Path(str(files("gonio"))) / "flow" / "weights"


def load_flow(path: str | os.PathLike) -> tuple[Flow, dict[str, Array]]:
    """A flow and whatever else its file holds. Raises FlowError, one line."""
    try:
        d = read_arrays(path)
    except (OSError, ValueError) as e:
        raise FlowError(f"{path}: not a flow's weights ({e}); make them with `gonio bench pretrain`") from None
    try:
        return Flow.from_arrays(d), d
    except FlowError as e:
        raise FlowError(f"{path}: {e}") from None


@lru_cache(maxsize=1)
def zoo() -> tuple[tuple[str, Flow], ...]:
    """(name, flow) of every roughness, smallest first. Raises FlowError where a file is spoilt."""
    found = sorted(FOLDER.glob("ggx_*.npz"), key=lambda p: float(p.stem[4:]))
    return tuple((p.stem, load_flow(p)[0]) for p in found)


@lru_cache(maxsize=1)
def conditional() -> tuple[Flow, Codes]:
    """The flow over many materials and the codes of those it was trained on. Raises FlowError."""
    return load_conditional(FOLDER / "code.npz")


def load_conditional(path: str | os.PathLike) -> tuple[Flow, Codes]:
    """The same of a file that `gonio bench pretrain` wrote. Raises FlowError."""
    flow, d = load_flow(path)
    codes, shape, cube = d.get("codes"), flow.shape, make_cube("half", 0.1)
    if codes is None or codes.ndim != 2 or codes.shape[1] != shape.code or not np.isfinite(codes).all():
        raise FlowError(f"{path}: no codes of {shape.code} numbers in it; make it with `gonio bench pretrain`")
    if (shape.dimensions, shape.leading, shape.periodic) != (cube.dimensions, cube.leading, cube.periodic):
        raise FlowError(
            f"{path}: a flow over other coordinates than the half cube's; make it with `gonio bench pretrain`"
        )
    return flow, Codes(codes)
