"""What studies of many cells share: cells made once and kept, workers, tables, plots. `run_cells` is the way in."""

from gonio.bench.harness.cells import Cell, Row
from gonio.bench.harness.pool import StudyFailed, run_cells

__all__ = ["Cell", "Row", "StudyFailed", "run_cells"]
