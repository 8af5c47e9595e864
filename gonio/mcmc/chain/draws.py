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
        parts, end = [], step + count
        while step < end:
            chunk, first = divmod(step, ROWS)
            last = min(ROWS, first + end - step)
            parts.append([table[:, first:last].transpose(1, 2, 0) for table in self._table(chunk)])
            step += last - first
        u, z = parts[0] if len(parts) == 1 else (np.concatenate(p) for p in zip(*parts))
        return np.ascontiguousarray(u), np.ascontiguousarray(z)

    def _make(self, chunk: int) -> tuple[Array, Array]:
        # each generator fills a stretch of its own; chains are put side by side a step at a time, in cache
        u = np.empty((self.chains, ROWS, self.uniforms))
        z = np.empty((self.chains, ROWS, self.normals))
        for c in range(self.chains):
            rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(self.seed, spawn_key=(c, chunk))))
            rng.random(out=u[c])
            if self.normals:
                rng.standard_normal(out=z[c])
        return u, z
