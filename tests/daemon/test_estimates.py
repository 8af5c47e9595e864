"""What is shown of a run after its end is final."""

import threading

import pytest

from gonio.daemon.estimates import FIRST, Estimator
from gonio.daemon.status_board import StatusBoard


class Asked(Estimator):
    """Each question waits until the test lets it answer."""

    def __init__(self, *args):
        self.questions = 0
        self.begun, self.answer = threading.Semaphore(0), threading.Semaphore(0)
        super().__init__(*args)

    def _ask(self):
        self.questions += 1
        number = self.questions
        self.begun.release()
        assert self.answer.acquire(timeout=60)
        return {"ess": number, "energy_error": None}


@pytest.fixture
def board(monkeypatch):
    monkeypatch.setattr("gonio.daemon.estimates.PAUSE_S", 0.001)
    board = StatusBoard({"name": "r"})
    board.begin({"run": "r"})
    board.job(progress={"measured": 2 * FIRST})
    return board


def test_an_answer_that_was_asked_before_the_end_does_not_come_after_it(board, tmp_path):
    e = Asked(tmp_path, board)
    assert e.begun.acquire(timeout=60)
    e.close(done=True)
    assert board.state()["job"]["estimate"] is None and board.state()["job"]["estimating"]
    e.answer.release()  # the old one
    assert e.begun.acquire(timeout=60)  # the last is asked
    assert board.state()["job"]["estimate"] is None
    e.answer.release()
    e.thread.join(60)
    assert board.state()["job"]["estimate"] == {"measured": 2 * FIRST, "ess": 2, "energy_error": None}
    assert e.questions == 2 and not board.state()["job"]["estimating"]


def test_a_last_estimate_that_cannot_be_made_is_not_waited_for(board, tmp_path, monkeypatch):
    monkeypatch.setattr(Estimator, "_ask", lambda self: None)
    e = Estimator(tmp_path, board)
    e.close(done=True)
    e.thread.join(60)
    job = board.state()["job"]
    assert job["estimate"] is None and job["estimating"] is False


def test_of_a_run_that_was_stopped_what_was_known_stays(board, tmp_path):
    e = Asked(tmp_path, board)
    assert e.begun.acquire(timeout=60)
    e.answer.release()
    board.job(progress={"measured": 20 * FIRST})
    assert e.begun.acquire(timeout=60)
    e.close(done=False)
    e.answer.release()
    e.thread.join(60)
    assert board.state()["job"]["estimate"]["ess"] == 1 and e.questions == 2
