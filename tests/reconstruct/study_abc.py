"""Does the ABC fit converge on every measured material? `python tests/reconstruct/study_abc.py ../shared/materials`

One line per material (12 tables, 101 networks, 2,000 samples each): energy_mean of ABC and of GGX, seconds.
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reconstruct.pss_chain import samples

from gonio.brdf import NetworkBrdf, RglBrdf
from gonio.evaluate import evaluate
from gonio.reconstruct import reconstruct


def materials(folder: Path):
    for path in sorted((folder / "rgl").glob("*.bsdf")):
        yield path.stem, RglBrdf.from_file(path)
    networks = folder / "nbrdf" / "nbrdf.npz"
    for name in np.load(networks)["names"]:
        yield str(name), NetworkBrdf.from_file(networks, str(name))


if __name__ == "__main__":
    errors = []
    for name, truth in materials(Path(sys.argv[1])):
        s = samples(truth, 2000)
        start = time.perf_counter()
        abc = reconstruct(s, "abc")
        seconds = time.perf_counter() - start
        errors.append((evaluate(abc, truth)["energy_mean"], evaluate(reconstruct(s, "ggx"), truth)["energy_mean"]))
        print(f"{name:40s} abc {errors[-1][0]:.3f}  ggx {errors[-1][1]:.3f}  {seconds:.1f} s", flush=True)
    print(f"{len(errors)} materials, median abc {np.median(errors, 0)[0]:.3f}, ggx {np.median(errors, 0)[1]:.3f}")
