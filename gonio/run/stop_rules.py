"""The reconstruction that runs beside an acquisition: when is it good enough, and what does it expect where."""

import numpy as np

from gonio.acquire import Progress
from gonio.brdf import Brdf
from gonio.config.material import Material
from gonio.geometry import Array, to_half_diff
from gonio.reconstruct.samples import Samples
from gonio.run.record.samples import load_samples
from gonio.run.record.store import Store


class GoodEnough:
    """The stop rules that need more than counting, looked at on a growing schedule."""

    def __init__(self, material: Material, store: Store):
        self.material, self.store = material, store
        self._next = 200 if material.stop.scene_error is None else 64
        self.anisotropic = material.symmetry == "anisotropic"
        self._surrogate: Brdf | None = None

    def __call__(self, progress: Progress) -> str | None:
        stop = self.material.stop
        if (
            all(goal is None for goal in (stop.energy_error, stop.ess, stop.scene_error))
            or progress.measured < self._next
        ):
            return None
        self._next = int(1.25 * progress.measured) + 1
        if stop.ess is not None and (ess := self.effective_samples()) >= stop.ess:
            return f"{ess:.0f} effective samples (goal {stop.ess:g})"
        if stop.energy_error is not None:
            progress.energy_error = self.energy_error()
            if progress.energy_error <= stop.energy_error:
                return f"estimated energy error {progress.energy_error:.3f} (goal {stop.energy_error:g})"
        if stop.scene_error is not None and (error := self.scene_error()) <= stop.scene_error:
            return f"estimated error in the picture {error:.3f} (goal {stop.scene_error:g})"
        return None

    def fit_surrogate(self, wi: Array, wo: Array, f: Array, sigma: Array | None = None) -> Brdf | None:
        """The running reconstruction, None where the samples do not make one (yet); `expected` asks the last one."""
        found = running_fit(Samples.of(wi, wo, f, sigma), self.anisotropic)
        if found is not None:
            self._surrogate = found
        return found

    def expected(self, wi: Array, wo: Array) -> Array | None:
        """f (N, C) as the sampler's last surrogate has it; None where there was none yet."""
        return None if self._surrogate is None else self._surrogate.eval(wi, wo)

    def energy_error(self) -> float:
        """Estimated share of reflected energy misplaced, from all measured so far. Raises ReconstructionError."""
        from gonio.reconstruct.running import fit

        return float(fit(load_samples(self.store), anisotropic=self.anisotropic).energy_error_estimate)

    def scene_error(self) -> float:
        """Estimated share of the light off the material that is wrong in the picture that the run is for.

        Raises ReconstructionError, PictureError.
        """
        from gonio import picture
        from gonio.reconstruct.running import fit
        from gonio.reconstruct.splines.expected_error import MEAN_OVER_68

        assert self.material.sampler.target.scene is not None
        seen = picture.load(self.material.sampler.target.scene)
        brdf = fit(load_samples(self.store), anisotropic=self.anisotropic)
        low, high = brdf.interval(seen.wi, seen.wo)
        return seen.error(MEAN_OVER_68 * 0.5 * (high - low), brdf.eval(seen.wi, seen.wo))

    def effective_samples(self) -> float:
        """The smallest ESS of theta_h, theta_d and |phi_d| over the chains together; of a run that looks for the
        unknown, that of the weights f cos / q of all its draws."""
        from gonio.mcmc.diagnostics import ess_bulk

        if self.material.sampler.target.kind == "unknown":
            return self._weighted_samples()
        m, steps = self.store.measured(), self.store.steps()
        keep = (steps["step"] >= 0) & (steps["state"] >= 0)
        row = np.searchsorted(m.id, steps["state"][keep])
        chains = self.material.sampler.chains
        theta_h, _, theta_d, phi_d = to_half_diff(m.asked[row, :3], m.asked[row, 3:])
        length = np.bincount(steps["chain"][keep], minlength=chains).min()
        if length < 8:
            return 0.0
        chain = steps["chain"][keep]
        return min(
            ess_bulk(np.stack([q[chain == c][-length:] for c in range(chains)]))
            for q in (theta_h, theta_d, np.abs(phi_d))
        )

    def _weighted_samples(self) -> float:
        """Kish's count of each block, (sum w)^2 / sum w^2, of the channel with the fewest; all blocks together."""
        from gonio.run.record.draws import load_draws

        m = self.store.measured()
        samples, draws = load_samples(self.store, m), load_draws(self.store, m)
        total = np.zeros(len(self.material.channels))
        for block in np.unique(draws.block):
            mine = (draws.block == block) & (draws.row >= 0)
            f = np.maximum(samples.f[draws.row[mine]], 0)
            w = f * (draws.wo[mine, 2] * np.exp(-draws.log_q[mine]))[:, None]
            total += w.sum(0) ** 2 / np.maximum((w**2).sum(0), 1e-300)
        return float(total.min())


def running_fit(samples: Samples, anisotropic: bool) -> Brdf | None:
    """The reconstruction that is quick enough to run beside an acquisition; None where the samples do not make one."""
    from gonio.reconstruct.errors import ReconstructionError
    from gonio.reconstruct.running import fit

    try:
        return fit(samples, anisotropic=anisotropic)
    except ReconstructionError:
        return None
