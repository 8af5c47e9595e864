"""What may be asked of the queue, over HTTP."""

from collections.abc import Callable
from typing import Annotated, Any

from fastapi import FastAPI
from fastapi import Path as InPath
from pydantic import BaseModel, ConfigDict, Field

from gonio.config import Material
from gonio.config.scan import Scan
from gonio.daemon.queue.entries import Entry
from gonio.daemon.queue.worker import Queue

Number = Annotated[int, InPath(ge=1, le=2**31)]


class Body(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class AddBody(Body):
    material: Material
    scan: Scan | None = None


class MoveBody(Body):
    place: int = Field(ge=1, le=2**31, description="among those that wait; 1 = next")


class WorkBody(Body):
    active: bool = True
    ask: bool = Field(True, description="wait for the operator before each sample")


class Row(BaseModel):
    id: int
    name: str
    state: str
    run: str
    message: str
    scan: bool


class Listed(BaseModel):
    active: bool
    ask: bool
    asks: str = Field(description="the sample that it waits for; empty where it does not")
    entries: list[Row]


class Added(BaseModel):
    id: int


def add_requests(
    app: FastAPI,
    queue: Queue,
    answer: Callable[[Callable[[], Any]], Any],
    named: Callable[[Material], Material],
    refusals: dict[int | str, dict[str, Any]],
) -> None:
    """answer(make) turns what `make` raises into a refusal; named(material) has its files found, or refused."""
    entries = queue.entries

    @app.get("/queue", response_model=Listed)
    def listed() -> Any:
        """All entries, in their order."""
        saved = entries.saved
        asks = (queue.control.board.state()["job"] or {}).get("asks") or ""
        return {"active": saved.active, "ask": saved.ask, "asks": asks, "entries": [_row(e) for e in saved.entries]}

    @app.post("/queue", status_code=201, response_model=Added, responses=refusals)
    def add(body: AddBody) -> Any:
        """One more sample, at the end."""

        def make() -> dict[str, int]:
            added = entries.add(named(body.material), body.scan)
            queue.show()
            return {"id": added.id}

        return answer(make)

    @app.post("/queue/{number}/move", response_model=Listed, responses=refusals)
    def move(number: Number, body: MoveBody) -> Any:
        """An entry that waits, to another place."""
        return _changed(lambda: entries.move(number, body.place))

    @app.post("/queue/{number}/remove", response_model=Listed, responses=refusals)
    def remove(number: Number) -> Any:
        """An entry; its run folder stays."""
        return _changed(lambda: entries.remove(number))

    @app.post("/queue/work", response_model=Listed, responses=refusals)
    def work(body: WorkBody) -> Any:
        """Work it off from now on; or no further than the run under way."""
        return _changed(lambda: entries.work(body.active, body.ask))

    def _changed(change: Callable[[], None]) -> Any:
        """All entries after a change."""

        def make() -> Any:
            change()
            queue.show()
            return listed()

        return answer(make)


def _row(e: Entry) -> dict[str, Any]:
    kept = {"id": e.id, "name": e.label, "state": e.state, "run": e.run, "message": e.message}
    return kept | {"scan": e.scan is not None}
