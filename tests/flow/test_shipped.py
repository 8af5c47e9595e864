"""What ships: small, whole, and at home among the materials it was made of."""

import numpy as np
import pytest

from gonio.flow import shipped
from gonio.flow.flow import FlowError
from gonio.flow.material_code import FARTHEST


def test_small_and_whole():
    assert sum(p.stat().st_size for p in shipped.FOLDER.glob("*.npz")) <= 3_000_000
    assert len(shipped.zoo()) == 8
    flow, codes = shipped.conditional()
    assert codes.table.shape[1] == flow.shape.code


def test_the_zoo_is_told_apart_by_draws():
    rng = np.random.default_rng(0)
    flows = [q for _, q in shipped.zoo()]
    for k in (0, 4, 7):
        x, _ = flows[k].from_base(rng.random((2000, 3)))
        assert int(np.argmax([q.log_prob(x).mean() for q in flows])) == k


@pytest.mark.slow
def test_a_code_is_found_again():
    flow, codes = shipped.conditional()
    rng = np.random.default_rng(1)
    for k in (3, 20):
        x, log_q = flow.at(codes.table[k]).from_base(rng.random((300, 3)))
        found = flow.at(codes.fit(flow, x, np.ones(300)))
        assert log_q.mean() - found.log_prob(x).mean() < 0.1


def test_a_code_stays_near_the_training():
    flow, codes = shipped.conditional()
    x = np.tile([[1.0, 1.0, 1.0]], (50, 1)) - 1e-6 * np.random.default_rng(2).random((50, 3))
    far = codes.fit(flow, x, np.ones(50))
    assert np.isfinite(far).all()
    assert np.abs(codes.unit(far)).max() <= FARTHEST + 1e-6
    assert np.isfinite(flow.at(far).log_prob(x)).all()


@pytest.mark.parametrize("spoil", ["cut", "shape", "version", "nan", "text"])
def test_a_spoilt_file_is_one_line(tmp_path, spoil):
    source = shipped.FOLDER / "code.npz"
    path = tmp_path / "code.npz"
    with np.load(source) as d:
        arrays = {k: d[k] for k in d.files}
    if spoil == "shape":
        arrays["weight.0.in.b"] = arrays["weight.0.in.b"][:-1]
    if spoil == "version":
        del arrays["shape.encoding"]
    if spoil == "nan":
        arrays["weight.0.in.b"] = arrays["weight.0.in.b"] * np.nan
    np.savez(path, **arrays)
    if spoil == "cut":
        path.write_bytes(path.read_bytes()[:5000])
    if spoil == "text":
        path.write_text("no")
    with pytest.raises(FlowError) as e:
        shipped.load_flow(path)
    assert "\n" not in str(e.value) and str(path) in str(e.value)


def test_a_flow_over_other_coordinates_is_refused(tmp_path):
    from gonio.flow.flow import Flow, Shape

    flow = Flow.fresh(Shape(code=3, hidden=8, bins=4), np.random.default_rng(0))  # its first coordinate does not lead
    np.savez(tmp_path / "raw.npz", **flow.to_arrays(), codes=np.zeros((5, 3)))
    with pytest.raises(FlowError, match="other coordinates"):
        shipped.load_conditional(tmp_path / "raw.npz")
