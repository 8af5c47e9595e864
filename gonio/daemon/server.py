"""HTTP: what may be asked of a rig, as a FastAPI app. Handlers run in a pool of threads and only ever ask the control
thread; a request that hangs, or an event loop that dies, leaves the run alone.

Errors are one line, `{"detail", "code"}`, code being what the command line exits with.
"""

import asyncio
import json
from collections.abc import AsyncIterator
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import FastAPI, Header, Query, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, Response, StreamingResponse
from pydantic import BaseModel, ConfigDict, Field

import gonio
from gonio.config import ConfigError, Material
from gonio.config.scan import Scan
from gonio.daemon import jobs, manual
from gonio.daemon.control import Busy, Control
from gonio.daemon.queue.requests import add_requests
from gonio.daemon.queue.worker import Queue
from gonio.daemon.request_paths import RUN, run_folder, scene_file, truth_name, weights_file
from gonio.run.check import plan_of
from gonio.run.prepare import new_name

PAGE = {"app.js": "text/javascript", "hemisphere.js": "text/javascript", "style.css": "text/css"}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src data:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
TICK_S = 0.1
STATUS = {2: 422, 3: 503, 4: 409, 5: 409}
Angle = Annotated[float, Field(ge=-360, le=360)]


class Body(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class AcquireBody(Body):
    material: Material
    run: str | None = Field(None, pattern=RUN, description="below the runs folder; none = <material>/<stamp>")


class RunBody(AcquireBody):
    scan: Scan | None = Field(None, description="directions to measure in place of the chain's")


class ResumeBody(Body):
    run: str = Field(pattern=RUN)
    set: list[Annotated[str, Field(max_length=200)]] = Field(default_factory=list, max_length=20)


class JogBody(Body):
    axis: str = Field(max_length=100)
    degrees: Angle


class MeasureBody(Body):
    theta_i_deg: float = Field(ge=0, lt=90)
    phi_i_deg: Angle = 0.0
    theta_o_deg: float = Field(ge=0, lt=90)
    phi_o_deg: Angle = 180.0
    truth: str | None = Field(None, max_length=200, description="a simulated rig shows it: a material's name")


class Accepted(BaseModel):
    job: int


class Refused(BaseModel):
    detail: str
    code: int


class Plan(BaseModel):
    plan: str
    figures: dict[str, Any] = Field(description="the same as numbers: what `gonio check --json` prints")
    busy: str = Field(description="with what, in words; empty where a run could begin now")


class Said(BaseModel):
    done: bool


def make_app(control: Control, runs: Path, queue: Queue | None = None) -> FastAPI:
    """The app of one rig; run folders are made below `runs`. queue: worked off if it was started."""
    refusals: dict[int | str, dict[str, Any]] = {k: {"model": Refused} for k in (409, 422, 503)}
    app = FastAPI(title="gonio", version=gonio.__version__, docs_url=None, redoc_url=None)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(Exception, _bug)
    board = control.board

    def submit(kind: str, prepare) -> Any:
        return answer(lambda: {"job": control.submit(kind, prepare)})

    def answer(make) -> Any:
        try:
            return make()
        except Exception as e:
            code = getattr(e, "exit_code", None)
            if code is None:
                raise
            return _refused(409 if isinstance(e, Busy) else STATUS.get(code, 422), str(e), code)

    @app.get("/state")
    def state() -> dict[str, Any]:
        """Rig, job, progress, pose, devices, now."""
        return {**board.state(), "runs": str(runs.resolve()), "gonio": gonio.__version__}

    @app.post("/jobs/acquire", status_code=202, response_model=Accepted, responses=refusals)
    def acquire(body: RunBody) -> Any:
        """Measure a material, by a chain or a list. The client has resolved its config."""
        return submit(
            "acquire" if body.scan is None else "scan", lambda: jobs.acquire(control, *_named(runs, body), body.scan)
        )

    @app.post("/check", response_model=Plan, responses=refusals)
    def check(body: AcquireBody) -> Any:
        """What `/jobs/acquire` would do, without doing it; refused as that would be, but for what the rig does now."""

        def plan():
            material, folder = _named(runs, body)
            found = plan_of(material, control.config, folder)
            return {"plan": found.text, "figures": found.figures, "busy": control.busy()}

        return answer(plan)

    @app.post("/jobs/resume", status_code=202, response_model=Accepted, responses=refusals)
    def resume(body: ResumeBody) -> Any:
        """Go on with an interrupted run of this rig."""
        return submit("resume", lambda: jobs.go_on_with(control, run_folder(runs, body.run), tuple(body.set)))

    @app.post("/jobs/home", status_code=202, response_model=Accepted, responses=refusals)
    def home() -> Any:
        """Confirm the zero of every axis."""
        return submit("home", lambda: jobs.by_hand(manual.home))

    @app.post("/jobs/park", status_code=202, response_model=Accepted, responses=refusals)
    def park() -> Any:
        """Light off, arms to their pose of rest."""
        return submit("park", lambda: jobs.by_hand(manual.park))

    @app.post("/jobs/jog", status_code=202, response_model=Accepted, responses=refusals)
    def jog(body: JogBody) -> Any:
        """Turn one axis."""
        return submit("jog", lambda: jobs.by_hand(manual.jog, body.axis, body.degrees))

    @app.post("/jobs/measure", status_code=202, response_model=Accepted, responses=refusals)
    def measure(body: MeasureBody) -> Any:
        """One reading."""
        angles = (body.theta_i_deg, body.phi_i_deg, body.theta_o_deg, body.phi_o_deg)

        def prepare():
            truth = None if body.truth is None else truth_name(runs, body.truth)
            return jobs.by_hand(manual.measure, angles, truth)

        return submit("measure", prepare)

    @app.post("/pause", response_model=Said)
    def pause() -> dict[str, bool]:
        """Hold after the measurement under way."""
        return {"done": control.pause()}

    @app.post("/continue", response_model=Said)
    def go_on() -> dict[str, bool]:
        """End a pause."""
        return {"done": control.go_on()}

    @app.post("/stop", response_model=Said)
    def stop() -> dict[str, bool]:
        """Motors halt now; what was measured is stored."""
        return {"done": control.stop()}

    add_requests(app, queue or Queue(control, runs), answer, lambda material: _checked(runs, material), refusals)

    @app.get("/events", include_in_schema=False)
    async def events(last_event_id: Annotated[str, Header()] = "") -> StreamingResponse:
        """Server-sent events: `state`, and `samples` with those that are new. Never ends."""
        return StreamingResponse(_events(control, last_event_id), media_type="text/event-stream", headers=HEADERS)

    @app.get("/", include_in_schema=False)
    def index(token: Annotated[str, Query(max_length=200)] = "") -> Response:
        text = (files("gonio.daemon") / "page" / "index.html").read_text(encoding="utf-8")
        text = text.replace("?TOKEN", f"?token={quote(token)}" if token else "")
        return Response(text, media_type="text/html", headers=HEADERS)

    @app.get("/page/{name}", include_in_schema=False)
    def page(name: str) -> Response:
        if name not in PAGE:
            return _refused(404, "no such file", 2)
        text = (files("gonio.daemon") / "page" / name).read_text(encoding="utf-8")
        return Response(text, media_type=PAGE[name], headers=HEADERS)

    return app


async def _events(control: Control, last_event_id: str) -> AsyncIterator[str]:
    job, _, since = (last_event_id if last_event_id.count(":") == 1 else "0:0").partition(":")
    seen_job, count = (int(v) if v.isascii() and v.isdigit() and len(v) < 15 else 0 for v in (job, since))
    version, quiet = -1, 0.0
    board = control.board
    yield "retry: 1000\n\n"
    while True:
        if board.version != version:
            quiet = 0.0
            state = board.state()
            version = state["version"]
            number, total, rows = board.samples(seen_job, count)
            if rows or number != seen_job:
                fresh = number != seen_job
                seen_job, count = number, total
                body = {"job": number, "count": total, "fresh": fresh, "rows": rows}
                yield f"event: samples\nid: {number}:{total}\ndata: {json.dumps(body)}\n\n"
            yield f"event: state\ndata: {json.dumps(state)}\n\n"
        elif (quiet := quiet + TICK_S) > 5:
            quiet = 0.0
            yield ": still here\n\n"
        await asyncio.sleep(TICK_S)


def _named(runs: Path, body: AcquireBody) -> tuple[Material, Path]:
    """The material, its files found, and the folder of its run. Raises ConfigError."""
    material = _checked(runs, body.material)
    return material, run_folder(runs, body.run or f"{material.name}/{new_name()}")


def _checked(runs: Path, material: Material) -> Material:
    """Its files found, if they may be opened. Raises ConfigError."""
    if material.truth is not None:
        material = material.model_copy(update={"truth": truth_name(runs, material.truth)})
    if (weights := material.sampler.flow.weights) is not None:
        flow = material.sampler.flow.model_copy(update={"weights": weights_file(runs, weights)})
        material = material.model_copy(update={"sampler": material.sampler.model_copy(update={"flow": flow})})
    if (scene := material.sampler.target.scene) is not None:
        target = material.sampler.target.model_copy(update={"scene": scene_file(runs, scene)})
        material = material.model_copy(update={"sampler": material.sampler.model_copy(update={"target": target})})
    _must_be_text(material)
    return material


def _must_be_text(material: Material) -> None:
    """Lone surrogates pass JSON, and no file can hold them. Raises ConfigError."""
    try:
        json.dumps(material.model_dump(), ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise ConfigError("material: holds characters that are not text") from None


def _refused(status: int, detail: str, code: int) -> JSONResponse:
    text = " ".join(detail.split()).encode("utf-8", "replace").decode()
    return JSONResponse({"detail": text, "code": code}, status)


async def _invalid(request: Request, e: Exception) -> Response:
    assert isinstance(e, RequestValidationError)
    first = e.errors()[0]
    where = ".".join(str(k) for k in first["loc"] if k != "body")
    return _refused(422, f"{where or 'body'}: {first['msg']}", 2)


async def _bug(request: Request, e: Exception) -> Response:
    return _refused(500, f"bug: {type(e).__name__}; the daemon's log says more", 1)
