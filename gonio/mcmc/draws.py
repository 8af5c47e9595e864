"""Random numbers by step: what step t of chain c draws depends on (seed, c, t) alone.

Not on how many chains run, in which order measurements come back, or where a run was interrupted. So the generator's
whole state is a seed and a step number.
"""

from functools import lru_cache

import numpy as np

from gonio.geometry import Array

ROWS = 256  # steps generated at once; part of what a seed means, so never change it


class Draws:
    """(uniforms + normals) random numbers per step and chain; chain c has its own child of SeedSequence(seed)."""

    def __init__(self, seed: int, chains: int, uniforms: int, normals: int):
        self.seed, self.chains, self.uniforms, self.normals = seed, chains, uniforms, normals
        self._table = lru_cache(maxsize=2)(self._make)

    def rows(self, step: int, count: int) -> tuple[Array, Array]:
        """Uniforms (count, uniforms, chains) in [0, 1) and standard normals (count, normals, chains)."""
        chunk, first = divmod(step, ROWS)
        u, z = self._table(chunk)
        if first + count <= ROWS:
            return u[first : first + count], z[first : first + count]
        parts = [(u[first:], z[first:])]
        while (left := count - sum(len(p[0]) for p in parts)) > 0:
            chunk += 1
            u, z = self._table(chunk)
            parts.append((u[:left], z[:left]))
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])

    def _make(self, chunk: int) -> tuple[Array, Array]:
        u = np.empty((ROWS, self.uniforms, self.chains))
        z = np.empty((ROWS, self.normals, self.chains))
        for c in range(self.chains):
            rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(self.seed, spawn_key=(c, chunk))))
            u[:, :, c] = rng.random((ROWS, self.uniforms))
            if self.normals:
                z[:, :, c] = rng.standard_normal((ROWS, self.normals))
        return u, z
