"""Processes of `gonio` by the dozen: one parent that has imported everything, and a fork of it for each command.

A child is a process like any other, with its own devices and threads, and can be killed like any other; what it does
not pay for is the start of the interpreter.
"""

import json
import os
import subprocess
import sys

PRELOAD = (
    "gonio.cli gonio.run.start gonio.run.stop_rules gonio.acquire gonio.commands.acquisition gonio.reconstruct.running"
)
PRELOAD_WIRE = "drivers.rig sim.wire.rig"


class Nursery:
    """`start(*args)` gives the pid of `gonio args…`, `wait()` its exit code (-9 where it was killed)."""

    def __init__(self, *modules: str, env: dict[str, str] | None = None):
        command = [sys.executable, "-m", "tests.nursery", *PRELOAD.split(), *modules]
        self._parent = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **(env or {})},
        )
        assert self._parent.stdout.readline() == "ready\n"

    def start(self, *args, **plan) -> int:
        """plan: what the child does to itself, as `tests.self_kill.install` takes it."""
        self._parent.stdin.write(json.dumps({"args": [str(a) for a in args], "plan": plan}) + "\n")
        self._parent.stdin.flush()
        return int(self._parent.stdout.readline())

    def wait(self) -> tuple[int, str]:
        """Exit code and last line said of the child started last, once it has ended."""
        self._parent.stdin.write("null\n")
        self._parent.stdin.flush()
        code, text = json.loads(self._parent.stdout.readline())
        return code, text

    def close(self) -> None:
        self._parent.stdin.close()
        self._parent.wait(60)
        self._parent.stdout.close()


def serve(modules: list[str]) -> None:
    import importlib
    import tempfile

    for name in modules:
        importlib.import_module(name)
    print("ready", flush=True)
    pid, said = 0, None
    for line in sys.stdin:
        order = json.loads(line)
        if order is None:
            _, status = os.waitpid(pid, 0)
            said.seek(0)
            last = (said.read().splitlines() or [""])[-1]
            print(json.dumps([os.waitstatus_to_exitcode(status), last]), flush=True)
            continue
        said = tempfile.TemporaryFile("w+")
        pid = os.fork()
        if pid == 0:
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.dup2(said.fileno(), 1)
            os.dup2(said.fileno(), 2)
            from gonio.cli import main
            from tests.self_kill import install

            install(order["plan"])
            sys.argv = ["gonio", *order["args"]]
            code = 1
            try:
                main()
            except SystemExit as e:
                code = e.code if isinstance(e.code, int) else int(e.code is not None)
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(code)
        print(pid, flush=True)


if __name__ == "__main__":
    serve(sys.argv[1:])
