"""What the chain visits in proportion to. `Target`: the energy, p(wi, wo) ∝ (s(f)^power + floor) cos theta_o (METHOD 1
and 6). `Unknown`: what is not known yet, see gonio.mcmc.plans.epoch.

s is one number made of the channels: one of them, their luminance, their mean, or the largest after each is divided
by its own albedo ("max": every channel's features are seen, however dark it is). The floor is a constant chosen so
that the given share of the draws comes from it, where f is low. Weights f cos / p are stored with every step, so that
integrals and fits are right for any target.
"""

from typing import Protocol

import numpy as np

from gonio.geometry import Array

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # Rec. 709, linear RGB
TINY = 1e-300


class Frozen(Protocol):
    """The part of a target that does not hang on the reading: the inverse (N, C) of the albedos by which channels are
    divided, floor (N,), log of the rest (N,)."""

    def inverse_albedo(self, wi: Array) -> Array: ...
    def floor(self, wi: Array) -> Array: ...
    def log_rest(self, wi: Array, wo: Array) -> Array: ...


def combined(channels: int | str, f: Array) -> Array:
    """One number (N,) of the channels (N, C): one of them, luminance, mean or the largest ("max")."""
    if isinstance(channels, int):
        return f[:, channels]
    if channels == "luminance":
        return f @ LUMINANCE
    if channels == "mean":
        return f.mean(1)
    s = f[:, 0]
    for c in range(1, f.shape[1]):  # of few channels a good deal faster than max along the short axis
        s = np.maximum(s, f[:, c])
    return s


class Target:
    """log p of BRDF values (N, C) at wi, wo (N, 3). `rescale` sets albedos and floor from what was measured."""

    def __init__(self, channels: int | str, power: float, floor: float, count: int):
        self.channels, self.power, self.floor_share = channels, power, floor
        self.inverse_albedo = np.ones(count)
        self.floor = 0.0

    @property
    def needs_scale(self) -> bool:
        """Whether log_prob depends on `rescale`."""
        return self.channels == "max" or self.floor_share > 0

    def scalar(self, f: Array) -> Array:
        """s(f), (N,); negative readings count as 0 (the bias this makes is in docs/sampling.md)."""
        f = np.maximum(f, 0)
        return combined(self.channels, f * self.inverse_albedo if self.channels == "max" else f)

    def _strength(self, f: Array) -> Array:
        s = self.scalar(f)
        return s if self.power == 1 else s**self.power

    def log_prob(self, f: Array, wi: Array, wo: Array) -> Array:
        """log p up to a constant, (N,); -inf nowhere: a tiny number stands for 0 so that no NaN can arise."""
        return np.log((self._strength(f) + self.floor) * wo[:, 2] + TINY)

    def rescale(self, f: Array, cos_o: Array, log_q: Array) -> None:
        """Albedos and floor from draws (N,) of density exp(log_q): importance estimates of ∫∫ f cos and ∫∫ s cos."""
        w = np.exp(-(log_q - log_q.min())) * cos_o
        total = np.maximum(f, 0).T @ w
        if total.max() <= 0:
            return
        # a channel that is nearly dead is not blown up beyond a thousandth of the brightest
        self.inverse_albedo = total.max() / np.maximum(total, 1e-3 * total.max())
        mean = (self._strength(f) @ w) / w.sum()
        self.floor = self.floor_share / (1 - self.floor_share) * mean

    def copy(self) -> "Target":
        """As it is now; later `rescale`s do not reach it."""
        other = Target(self.channels, self.power, self.floor_share, len(self.inverse_albedo))
        other.restore(self.state())
        return other

    def state(self) -> dict:
        return {"inverse_albedo": self.inverse_albedo.copy(), "floor": self.floor}

    def restore(self, state: dict) -> None:
        self.inverse_albedo, self.floor = np.array(state["inverse_albedo"]), float(state["floor"])


class Unknown(Target):
    """What the epoch in force makes of the readings; the energy itself before there is one. Channels count by their
    share of their own albedo at that theta_i, and the floor is the epoch's too."""

    def __init__(self, channels: int | str, power: float, floor: float, count: int):
        super().__init__(channels, power, 0.0, count)
        self.epoch: Frozen | None = None

    def log_strength(self, f: Array, inverse_albedo: Array, floor: Array) -> Array:
        """log (s + floor)^power (N,) of f, inverse_albedo (N, C)."""
        s = combined(self.channels, np.maximum(f, 0) * inverse_albedo)
        return self.power * np.log(s + floor + TINY)

    def log_prob(self, f: Array, wi: Array, wo: Array, log_rest: Array | None = None) -> Array:
        """As for any target; log_rest (N,) where the epoch has worked it out before."""
        if (e := self.epoch) is None:
            return super().log_prob(f, wi, wo)
        rest = e.log_rest(wi, wo) if log_rest is None else log_rest
        return self.log_strength(f, e.inverse_albedo(wi), e.floor(wi)) + rest
