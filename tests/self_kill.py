"""A process that ends itself at an event: its n-th measurement, its n-th packet. For tests alone; the product knows
nothing of it. What decides is the event and not the clock, so that a fast machine and a slow one do the same.
"""

import os
import resource
import signal
from pathlib import Path

WHERE = ("before", "between", "after")  # of a measurement: asked for, written, committed


def install(plan: dict) -> None:
    """plan: `measured` n and `where` of WHERE: SIGKILL at the first measurement that makes n or more stored ones;
    `writes` [n, ...]: `signal` (SIGKILL unless given) at these writes to a serial port; `limit` n: from n measurements
    on the files may not grow by more than 40 kB."""
    if "measured" in plan:
        _at_measurement(plan["measured"], plan["where"], signal.Signals(plan.get("signal", signal.SIGKILL)))
    if "writes" in plan:
        _at_writes(set(plan["writes"]), signal.Signals(plan.get("signal", signal.SIGKILL)))
    if "limit" in plan:
        _at_measurement(plan["limit"], "after", None)


def _at_measurement(goal: int, where: str, what: signal.Signals | None) -> None:
    from gonio.run.record.store import Store

    add, commit = Store.add, Store._maybe_commit
    done = False

    def strike(store: Store) -> None:
        nonlocal done
        done = True
        if what is None:
            size = max(p.stat().st_size for p in Path(store.folder).iterdir())
            resource.setrlimit(resource.RLIMIT_FSIZE, (size + 40_000, resource.RLIM_INFINITY))
        else:
            os.kill(os.getpid(), what)

    def adding(store, ids, *rest):
        stored = store._db.execute("SELECT count(*) FROM measurements").fetchone()[0]
        due = not done and stored + len(ids) >= goal
        if due and where == "before":
            strike(store)
        store._strike = due and where == "between"
        add(store, ids, *rest)
        if due and where == "after":
            store._db.commit()
            strike(store)

    def committing(store):
        if getattr(store, "_strike", False):
            strike(store)
        commit(store)

    Store.add, Store._maybe_commit = adding, committing


def _at_writes(moments: set[int], what: signal.Signals) -> None:
    import serial

    write, count = serial.Serial.write, 0

    def writing(port, data):
        nonlocal count
        count += 1
        if count in moments:
            os.kill(os.getpid(), what)
        return write(port, data)

    serial.Serial.write = writing
