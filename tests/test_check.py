"""A plan that cannot start is no plan: what `acquire` refuses before it moves, `check` refuses in the same words."""

import io
import os
import re
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from gonio.brdf import Lambert
from gonio.load import save_brdf


def gonio(*args, cwd):
    command = [sys.executable, "-m", "gonio.cli", *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=300)


def tensor_file(path: Path, shape: tuple[int, ...], data: bytes = b"") -> Path:
    """An RGL container with one field of `shape`."""
    name = b"spectra"
    head = b"tensor_file\0" + bytes([1, 0]) + struct.pack("<IH", 1, len(name)) + name
    head += struct.pack(f"<HBQ{len(shape)}Q", len(shape), 10, 128, *shape)
    path.write_bytes(head.ljust(128, b"\0") + data)
    return path


def cut(tmp_path):
    path = tensor_file(tmp_path / "cut.bsdf", (4, 4), bytes(64))
    path.write_bytes(path.read_bytes()[:60])
    return ["--set", f"truth={path}"]


def terabytes(tmp_path):
    return ["--set", f"truth={tensor_file(tmp_path / 'huge.bsdf', (1 << 20, 1 << 20))}"]


def two_channels(tmp_path):
    save_brdf(Lambert([0.2, 0.3]), tmp_path / "two.npz")
    return ["--set", f"truth={tmp_path / 'two.npz'}"]


def not_a_brdf(tmp_path):
    np.savez(tmp_path / "odd.npz", a=np.zeros(3))
    return ["--set", f"truth={tmp_path / 'odd.npz'}"]


def npy(shape):
    head = repr({"descr": "<f8", "fortran_order": False, "shape": shape})
    head += " " * (63 - (len(head) + 10) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode()


def zipped(path, arrays):
    """An .npz of a Lambert whose albedo is these bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as held:
        for name, value in {"kind": "lambert", "format_version": 1}.items():
            buffer = io.BytesIO()
            np.save(buffer, np.array(value))
            held.writestr(f"{name}.npy", buffer.getvalue())
        with held.open("albedo.npy", "w", force_zip64=True) as stream:
            for part in arrays:
                stream.write(part)
    return ["--set", f"truth={path}"]


def claims_terabytes(tmp_path):
    return zipped(tmp_path / "claims.npz", [npy((1 << 40,))])


def unpacks_to_gigabytes(tmp_path):
    return zipped(tmp_path / "bomb.npz", [npy((1 << 28,)), *[bytes(1 << 24)] * 128])


def weights_that_claim_terabytes(tmp_path):
    zipped(tmp_path / "w.npz", [npy((1 << 40,))])
    return ["--set", "sampler.proposal=flow", "--set", f"sampler.flow.weights={tmp_path / 'w.npz'}"]


def endless_yaml(tmp_path):
    (tmp_path / "long.yaml").write_text("alpha: [0.1]\ncolour:\n" + "- [[1], [2]]\n" * 20_000)
    return ["--set", f"truth={tmp_path / 'long.yaml'}"]


def yaml_of_aliases(tmp_path):
    rows = ["a0: &a0 [1, 1]", *(f"a{k}: &a{k} [" + ", ".join([f"*a{k - 1}"] * 9) + "]" for k in range(1, 12))]
    (tmp_path / "many.yaml").write_text("\n".join([*rows, "alpha: *a11", "colour: *a11"]))
    return ["--set", f"truth={tmp_path / 'many.yaml'}"]


def nobody_writes(tmp_path):
    os.mkfifo(tmp_path / "pipe.bsdf")
    return ["--set", f"truth={tmp_path / 'pipe.bsdf'}"]


def no_weights(tmp_path):
    (tmp_path / "w.npz").write_bytes(b"PK")
    return ["--set", "sampler.proposal=flow", "--set", f"sampler.flow.weights={tmp_path / 'w.npz'}"]


def stale(tmp_path):
    (tmp_path / "r.yaml").write_text(
        "{id: r, date: 2020-01-01T00:00:00Z, rig: sim, gain: [1, 1, 1], gain_sigma: [0, 0, 0]}"
    )
    return ["--set", f"rig.calibration.radiometry={tmp_path / 'r.yaml'}", "--set", "rig.calibration.max_age_days=9"]


def nothing_reached(tmp_path):
    return ["--set", "rig.axes.light={lower_deg: 89, upper_deg: 89.5, velocity_deg_s: 60, acceleration_deg_s2: 120}",
            "--set", "rig.stay_out_deg=170"]  # fmt: skip


def folder_exists(tmp_path):
    (tmp_path / "run").mkdir()
    return ["--out", tmp_path / "run"]


def dangling_link(tmp_path):
    (tmp_path / "run").symlink_to(tmp_path / "nowhere")
    return ["--out", tmp_path / "run"]


def name_too_long(tmp_path):
    return ["--out", tmp_path / ("n" * 300)]


def no_place_for_runs(tmp_path):
    (tmp_path / "runs").write_text("")
    return []


def folder_below_a_file(tmp_path):
    (tmp_path / "file").write_text("")
    return ["--out", tmp_path / "file" / "run"]


def without_id(text):
    """The folder that a run would get by itself is of its moment."""
    return re.sub(r"\d{8}T\d{6}Z-[0-9a-f]{4}", "NEW", text)


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (cut, 2), (terabytes, 2), (claims_terabytes, 2), (unpacks_to_gigabytes, 2), (endless_yaml, 2),
        (weights_that_claim_terabytes, 2), (yaml_of_aliases, 2), (nobody_writes, 2), (two_channels, 2),
        (not_a_brdf, 2), (no_weights, 2), (stale, 5),
        (nothing_reached, 2), (folder_exists, 2), (folder_below_a_file, 2),
        (dangling_link, 2), (name_too_long, 2), (no_place_for_runs, 2),
        (lambda _: ["--set", "truth=nothing_like_it"], 2),
        (lambda _: ["--set", "truth=null"], 2),
        (lambda _: ["--rig", "bench", "--set", "truth=null"], 5),
        (lambda _: ["--rig", "bench", "--set", "truth=null", "--set", "rig.devices.photodiode=null"], 2),
    ],
)  # fmt: skip
def test_check_refuses_what_acquire_refuses(tmp_path, make, code):
    words = make(tmp_path)
    checked = gonio("check", "analytic_gloss", *words, cwd=tmp_path)
    tried = gonio("acquire", "analytic_gloss", *words, cwd=tmp_path)
    assert checked.returncode == tried.returncode == code, (checked.stderr, tried.stderr)
    assert (
        without_id(checked.stderr) == without_id(tried.stderr)
        and len(checked.stderr.splitlines()) == 1
        and checked.stdout == ""
    )
    assert not (tmp_path / "runs").is_dir()


def test_a_plan_that_can_start_is_told(tmp_path):
    said = gonio("check", "analytic_gloss", "--out", tmp_path / "new", cwd=tmp_path)
    assert said.returncode == 0 and "analytic material" in said.stdout and not (tmp_path / "new").exists()
