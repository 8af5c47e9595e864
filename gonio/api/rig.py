"""A rig in the hands of a script: pairs of directions in, readings out."""

import contextlib
import os
import weakref
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gonio.brdf import Brdf
from gonio.brdf.models.function import FunctionBrdf
from gonio.config import ConfigError, load_config
from gonio.config import Material as MaterialConfig
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.daemon.rig_owner import RigOwner
from gonio.daemon.sockets import hold_hardware
from gonio.geometry import Array
from gonio.reconstruct.samples import Samples
from gonio.rig.build import envelope_of, geometry_calibration
from gonio.rig.devices import Visited

Truth = Brdf | Callable[[Array, Array], Array] | str | os.PathLike[str]


def open_rig(
    rig: str | os.PathLike[str] | RigConfig,
    truth: Truth | None = None,
    *,
    isotropic: bool = True,
    seed: int = 0,
) -> "OpenRig":
    """The rig of a YAML file, or of the name of one that ships, for this process alone.

    truth is what a simulated rig shows: a function f(wi, wo) of unit vectors (N, 3), (N, 3) that gives (N, C) in 1/sr
    (cosine not included), a BRDF, or a material's name or file. None: what the material of `gonio.acquire` names.
    isotropic: the sample on it is, which saves motion. seed: of a simulated rig's noise. Devices are opened when they
    are first needed. Raises ConfigError; SocketsError where another process drives the rig.

    Examples:
        >>> import gonio, numpy as np
        >>> with gonio.open_rig("ideal", truth=lambda wi, wo: np.full((len(wi), 1), 0.8 / np.pi)) as rig:
        ...     seen = rig.measure([[0.6, 0, 0.8]], [[0, 0, 1]])
        >>> seen.f.round(4).tolist()
        [[0.2546]]
    """
    config = rig if isinstance(rig, RigConfig) else load_config(find_config(rig, "rigs"), RigConfig)
    shown = None if truth is None else as_brdf(truth)
    if shown is not None and config.depth == "real":
        raise ConfigError(f"truth: rig {config.name} is real and shows what lies on it; leave `truth` out")
    return OpenRig(config, shown, isotropic, seed)


def as_brdf(truth: Truth) -> Brdf:
    """A BRDF as it is, or of a function, a name, a file. Raises BrdfFileError, ValueError."""
    if isinstance(truth, Brdf):
        return truth
    if callable(truth):
        return FunctionBrdf(truth)
    from gonio.run.truth import open_truth

    return open_truth(os.fspath(truth))


_OPEN: "weakref.WeakValueDictionary[str, OpenRig]" = weakref.WeakValueDictionary()


def _let_go(owner: RigOwner, held: contextlib.ExitStack) -> None:
    with held:
        owner.close()


class OpenRig:
    """A rig that this process drives until `close`; use it in a `with` block. Directions are unit vectors (N, 3), z the
    sample's normal, wi to the light, wo to the detector."""

    def __init__(self, config: RigConfig, truth: Brdf | None, isotropic: bool, seed: int):
        self.config, self.truth, self.isotropic, self.seed = config, truth, isotropic, seed
        if config.depth == "real" and config.name in _OPEN:
            raise ConfigError(f"rig {config.name}: is open in this very session; close it first, or use a `with` block")
        held = contextlib.ExitStack()
        held.enter_context(hold_hardware(config))
        self._owner = RigOwner(config)
        # also where it is forgotten, or the session ends: a lamp must not stay on, nor a rig be held
        self._let_go = weakref.finalize(self, _let_go, self._owner, held)
        _OPEN[config.name] = self
        self._reach = envelope_of(config, geometry_calibration(config)).reachable
        self._next = 0

    def reachable(self, wi: Array, wo: Array) -> NDArray[np.bool_]:
        """Which pairs the rig can show, (N,). Touches no hardware."""
        return self._reach(np.atleast_2d(wi).astype(float), np.atleast_2d(wo).astype(float))

    def visit(self, wi: Array, wo: Array, ids: NDArray[np.int64] | None = None) -> Iterator[Visited]:
        """Measure every pair in the order that is cheapest; see `gonio.rig.devices.Rig.visit`.

        ids (N,) number the measurements, None = onwards from the last: a simulated rig draws the noise from them.
        Raises DeviceFault, SafetyStop, CalibrationMissing, ConfigError; ValueError for what is no direction.
        """
        wi, wo = _directions("wi", wi), _directions("wo", wo)
        if len(wi) != len(wo):
            raise ValueError(f"wi has {len(wi)} rows, wo {len(wo)}; give pairs")
        ids = np.arange(self._next, self._next + len(wi)) if ids is None else np.asarray(ids, np.int64)
        self._next = max(self._next, int(ids.max(initial=-1)) + 1)
        return self._rig().visit(wi, wo, ids)

    def measure(self, wi: Array, wo: Array) -> Samples:
        """One reading of each pair, rows in the order given; directions as achieved, NaN where none could be made."""
        wi, wo = np.atleast_2d(np.asarray(wi, float)), np.atleast_2d(np.asarray(wo, float))
        first = self._next
        seen = list(self.visit(wi, wo))
        parts = [np.concatenate([getattr(s, k) for s in seen]) for k in ("ids", "wi", "wo", "f", "sigma", "saturated")]
        order = np.argsort(parts[0])
        if len(order) != len(wi) or (parts[0][order] != first + np.arange(len(wi))).any():
            raise RuntimeError(f"rig {self.config.name}: was stopped before all pairs were measured")
        wi, wo, f, sigma, saturated = (p[order] for p in parts[1:])
        return Samples.of(wi, wo, f, sigma, saturated)

    def home(self) -> None:
        """Confirm the zero of every axis; nothing moves before. An ideal rig has none."""
        if (home := getattr(self._rig(), "home", None)) is not None:
            home()

    def park(self) -> None:
        """Light off, arms to their pose of rest."""
        if (park := getattr(self._rig(), "park", None)) is not None:
            park()

    def stop(self) -> None:
        """Halt at once; from any thread."""
        self._owner.stop()

    def close(self) -> None:
        """Light off, devices let go. Also done when the session ends."""
        if _OPEN.get(self.config.name) is self:
            del _OPEN[self.config.name]
        self._let_go()

    def for_run(self, material: MaterialConfig, truth: Brdf | None) -> Any:
        """The rig as a run of `material` wants it (`gonio.rig.devices.Rig`)."""
        self._refuse_closed()
        return self._owner.for_run(material, truth)

    def _refuse_closed(self) -> None:
        if not self._let_go.alive:
            raise ConfigError(f"rig {self.config.name}: was closed; open it again with `gonio.open_rig`")

    def _rig(self) -> Any:
        self._refuse_closed()
        if self._owner.rig is None:
            symmetry = "isotropic" if self.isotropic else "anisotropic"
            self._owner.for_run(MaterialConfig(name="by_hand", symmetry=symmetry, seed=self.seed), self.truth)
        return self._owner.rig

    def __enter__(self) -> "OpenRig":
        return self

    def __exit__(self, kind, *exc) -> None:
        try:
            if kind is not None:
                self.stop()
        finally:
            self.close()

    def __repr__(self) -> str:
        return f"<rig {self.config.name}, {self.config.depth}>"


def _directions(name: str, w: Array) -> Array:
    """Raises ValueError where `w` is not (N, 3) unit vectors."""
    w = np.asarray(w, float)
    if w.ndim != 2 or w.shape[1] != 3 or not np.allclose((w * w).sum(1), 1, rtol=0, atol=1e-6):
        raise ValueError(f"{name}: wanted unit vectors (N, 3), z along the normal; `gonio.from_angles` makes them")
    return w / np.sqrt((w * w).sum(1))[:, None]
