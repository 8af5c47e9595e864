"""Runs the cells of a study: those that are kept are read, the others made by processes here or on a Dask cluster.

A worker that dies takes nothing with it: what is not kept yet is made again, three times at most. A cell that raises
is a row `failed`, and the study goes on and ends with StudyFailed. Only the study itself writes into the folder of
what is kept, so nothing is counted twice, however often it was made.
"""

import multiprocessing
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from gonio.bench.harness.cells import Cell, Kept, Row, called, digest
from gonio.bench.harness.progress import Watched
from gonio.config import ConfigError

TRIES = 3


class StudyFailed(Exception):
    """Some cells raised: how many, and the first of them. What the others gave is in the table."""

    exit_code = 1


def run_cells(
    function: str, cells: Iterable[Cell], folder: Path, *, workers: int = 1, dask: str | None = None
) -> Iterator[tuple[Cell, list[Row]]]:
    """Each cell with the rows that `function` (`package.module:name`) makes of it, as they are ready.

    folder: where rows are kept. dask: address of a scheduler, whose workers have this gonio and its materials; else
    `workers` processes here, or this very one if it is 1. Raises StudyFailed after the last cell, if one failed;
    ConfigError where no Dask answers.
    """
    wanted = {digest(function, cell): cell for cell in cells}  # one named twice is made once
    kept = Kept(folder / "cells", function)
    known = {key: rows for key, cell in wanted.items() if (rows := kept.get(cell)) is not None}
    left = {key: cell for key, cell in wanted.items() if key not in known}
    failed: list[str] = []
    with Watched(len(wanted), len(known)) as watched:
        for key, rows in known.items():
            yield wanted[key], rows
        for key, found in _made(function, left, workers, dask):
            watched.one()
            if not isinstance(found, BaseException):
                try:
                    kept.put(left[key], found)
                except TypeError as e:  # a row of more than JSON values
                    found = e
            if isinstance(found, BaseException):
                failed.append(f"{_named(left[key])}: {type(found).__name__}: {found}")
                found = [{**left[key], "failed": failed[-1]}]
            yield left[key], found
    if failed:
        raise StudyFailed(f"{len(failed)} of {len(wanted)} cells failed; the first: {failed[0]}".replace("\n", " "))


def _made(function: str, cells: dict[str, Cell], workers: int, dask: str | None) -> Iterator[tuple[str, Any]]:
    """key and rows, or key and what was raised."""
    if not cells:
        return
    if dask is not None:
        yield from _by_dask(function, cells, dask)
    elif workers == 1:
        for key, cell in cells.items():
            try:
                yield key, called(function, cell)
            except Exception as e:
                yield key, e
    else:
        yield from _by_processes(function, cells, workers)


def _by_processes(function: str, cells: dict[str, Cell], workers: int) -> Iterator[tuple[str, Any]]:
    left = dict(cells)
    died: Counter[str] = Counter()
    while left:
        pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))
        waiting: dict[Future, str] = {}
        queue = iter(list(left.items()))
        try:
            while True:
                # no more than there are processes: all in the pool may have caused its death
                while len(waiting) < workers and (following := next(queue, None)) is not None:
                    waiting[pool.submit(called, function, following[1])] = following[0]
                if not waiting:
                    break
                done, _ = wait(waiting, return_when=FIRST_COMPLETED)
                if any(isinstance(f.exception(), BrokenProcessPool) for f in done):
                    break
                for future in done:
                    key = waiting.pop(future)
                    del left[key]
                    yield key, future.exception() or future.result()
        except BrokenProcessPool:
            pass
        finally:
            pool.shutdown(cancel_futures=True)
        for key in waiting.values():
            died[key] += 1
            if died[key] == TRIES:
                del left[key]
                yield key, RuntimeError(f"its process died, {TRIES} times")


def _by_dask(function: str, cells: dict[str, Cell], address: str) -> Iterator[tuple[str, Any]]:
    try:
        from distributed import Client, as_completed
    except ModuleNotFoundError:
        raise ConfigError("--dask needs dask.distributed: pip install 'gonio[study]'") from None
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as e:
        raise ConfigError(f"--dask {address}: no scheduler answers ({e})".replace("\n", " ")) from None
    with client:
        # a scheduler tries again by itself what a worker took with it when it died
        futures = {client.submit(called, function, cell, key=f"gonio-{key}"): key for key, cell in cells.items()}
        for future in as_completed(futures):
            error = future.exception()
            yield futures[future], error if error is not None else future.result()
            future.release()


def _named(cell: Cell) -> str:
    return " ".join(f"{k}={v}" for k, v in cell.items())
