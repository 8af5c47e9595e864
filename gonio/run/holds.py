"""What a run folder holds, in a few words."""

from pathlib import Path
from typing import Any

import numpy as np

from gonio.run.record.config import read_config
from gonio.run.record.store import Store

PRODUCTS = ("brdf.npz", "brdf.bsdf", "report.html", "budget.json")


def holds(folder: Path) -> dict[str, Any]:
    """material, measured by what (or imported from what), how much of it, how it ended, what was made of it.

    Raises ConfigError, StoreError where it is no run.
    """
    config = read_config(folder)
    with Store.open(folder, write=False) as store:
        f, ended = store.measured().f, store.get("ended", "")
        provenance = store.get("provenance", {})
    good = int(np.isfinite(f).all(1).sum()) if len(f) else 0
    source = f"rig {config.rig.name}{', simulated' if provenance.get('simulated') else ''}"
    if (i := config.imported) is not None:
        source = f"imported from {', '.join(i.files[:3])} ({i.format}, {i.quantity})"
    return {
        "run": str(folder),
        "material": f"{config.material.name} ({config.material.symmetry})",
        "channels": list(config.material.channels),
        "source": source,
        "measured": f"{good} of {len(f)} with a value",
        "ended": ended or "not yet",
        "made": [name for name in PRODUCTS if (Path(folder) / name).exists()],
    }
