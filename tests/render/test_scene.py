"""What a picture asks of a material: against Mitsuba's own integrator, against what is known, and from spoilt files."""

import numpy as np
import pytest
from typer.testing import CliRunner

from gonio import picture
from gonio.cli import app
from gonio.config import ConfigError, Material, load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.geometry import from_angles, from_height, to_angles
from gonio.picture import BINS, Picture, PictureError, of_hits
from gonio.render.scene.files import FOLDER, find_scene, put, read_scene

RNG = np.random.default_rng(4)


@pytest.fixture(scope="module")
def mi():
    pytest.importorskip("mitsuba", reason="needs the extra `render`")
    from gonio.render.mitsuba import load_mitsuba

    mitsuba = load_mitsuba()
    if not mitsuba.variant().startswith("llvm"):
        pytest.skip("no LLVM 19 here: Mitsuba's llvm variant is what records")
    return mitsuba


def even(count, rng=RNG):
    """Pairs with wi cosine-distributed, wo cosine-distributed."""
    return (from_height(np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)) for _ in range(2))


# ---- the density


def test_hits_that_are_everywhere_alike_have_density_one():
    """W = cos theta_i cos theta_o / pi^2 is w = cos theta_i / pi^2: twice cos theta_i, of mean 1."""
    wi, wo = even(400_000)
    p = of_hits(wi, wo, np.ones(len(wi)), 1.0, "even", RNG, 256)
    a, b = even(4000)
    a, b = a[(a[:, 2] > 0.1) & (b[:, 2] > 0.1)], b[(a[:, 2] > 0.1) & (b[:, 2] > 0.1)]
    ratio = p(a, b) / (2 * a[:, 2])
    assert np.abs(ratio - 1).mean() < 0.08 and abs(ratio.mean() - 1) < 0.02


def test_the_mean_of_the_density_is_one():
    wi, wo = even(200_000)
    tilted = wi[:, 2] ** 4 * (1 + wo[:, 0])
    p = of_hits(wi, wo, tilted, 1.0, "tilted", RNG, 256)
    u = from_height(RNG.random(200_000), 2 * np.pi * RNG.random(200_000))
    v = from_height(np.sqrt(RNG.random(200_000)), 2 * np.pi * RNG.random(200_000))
    assert p(u, v).mean() == pytest.approx(1, abs=0.03)


def test_the_hits_kept_stand_for_all():
    """A mean over them is the weighted mean over all: of cos theta_i, and of a material's error."""
    wi, wo = even(100_000)
    w = np.exp(3 * wi[:, 0])
    p = of_hits(wi, wo, w, 1.0, "x", np.random.default_rng(0), 4096)
    assert (p.weight * p.wi[:, 2]).mean() == pytest.approx(np.average(wi[:, 2], weights=w), abs=0.015)
    f = np.ones((len(p.wi), 3))
    assert p.error(0.1 * f, f) == pytest.approx(0.1)
    assert p.error(np.where(p.wi[:, :1] > 0, 0.2, 0.0) * f, f) == pytest.approx(
        0.2 * np.average(wi[:, 0] > 0, weights=w), abs=0.015
    )


def test_nobody_sees_it():
    with pytest.raises(PictureError, match="no light comes off the material"):
        of_hits(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), 0.0, "x", RNG, 16)


def made():
    wi, wo = even(2000)
    return of_hits(wi, wo, np.ones(len(wi)), 0.5, "made", RNG, 64)


def test_file_round_trip(tmp_path):
    p = made()
    p.save(tmp_path / "p.npz")
    q = picture.load(tmp_path / "p.npz")
    wi, wo = even(500)
    assert np.allclose(p(wi, wo), q(wi, wo), rtol=1e-5) and q.share == 0.5 and q.name == "made"


def test_spoilt_files_are_one_line(tmp_path):
    p = tmp_path / "p.npz"
    made().save(p)
    whole = p.read_bytes()
    rng = np.random.default_rng(1)
    for k in range(300):
        spoilt = bytearray(whole[: rng.integers(len(whole))] if k % 3 == 0 else whole)
        for at in rng.integers(0, max(len(spoilt), 1), 1 + k % 7):
            if spoilt:
                spoilt[at] = rng.integers(256)
        p.write_bytes(bytes(spoilt))
        try:
            assert isinstance(picture.load(p), Picture)
        except PictureError as e:
            assert "\n" not in str(e) and str(p) in str(e)
    np.savez(p, density=np.zeros(BINS), wi=np.zeros((2, 3)), wo=np.zeros((2, 3)), weight=np.ones(2), share=1, name="x")
    with pytest.raises(PictureError, match="not what `gonio scene` writes"):
        picture.load(p)
    with pytest.raises(PictureError, match="cannot be read"):
        picture.load(tmp_path / "none.npz")


# ---- recording


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sky", "panel"])
def test_the_recorder_sees_what_mitsuba_sees(mi, name):
    from gonio.render.scene.record import load, record

    path = find_scene(name)
    ours = record(path, "measured", size=32, spp=64)
    scene = load(put(read_scene(path), "measured", path, None), path)
    theirs = np.array(mi.render(scene, spp=64))[..., :3]
    assert np.allclose(ours.image.mean((0, 1)), theirs.mean((0, 1)), rtol=0.03)
    assert 0 < ours.picture.share <= 1 and ours.hits > 1000


FURNACE = """<scene version="3.0.0">
  <sensor type="orthographic"><transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/></film></sensor>
  <bsdf type="diffuse" id="plate"><rgb name="reflectance" value="0.9"/></bsdf>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/></transform><ref id="plate"/></shape>
  <emitter type="constant"/>
</scene>"""


@pytest.mark.slow
def test_a_plate_under_an_even_sky(mi, tmp_path):
    """Seen from above: all light leaves along the normal, and arrives as cos theta_i."""
    from gonio.render.scene.record import record

    path = tmp_path / "plate.xml"
    path.write_text(FURNACE)
    p = record(path, "plate", size=16, spp=256).picture
    assert p.share == pytest.approx(1, abs=1e-6)
    assert np.degrees(to_angles(p.wo)[0]).max() < 1
    theta_i = to_angles(p.wi)[0]
    for share in (0.1, 0.5, 0.9):  # cosine: P(theta < t) = sin^2 t
        assert np.sin(np.quantile(theta_i, share)) ** 2 == pytest.approx(share, abs=0.02)
    assert p(from_angles([0.5], [0.0]), from_angles([1.0], [0.0]))[0] == 0


# ---- the command, and what is measured by it


@pytest.mark.slow
def test_scene_to_run(mi, tmp_path, monkeypatch):
    """The command writes a file; a run by it looks where the picture does, ends on its error, and resumes only with
    the very file."""
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["scene", "panel", "--size", "32", "--spp", "32", "--preview", "p.png"])
    assert done.exit_code == 0, done.output
    assert "rig time about 1 :" in done.output and (tmp_path / "p.png").stat().st_size > 10_000
    from gonio.run.start import resume, start

    seen = picture.load("panel.npz")
    asked = {"target": {"scene": "panel.npz"}}
    base = {"name": "x", "truth": "analytic_gloss", "seed": 2, "budget": {"measurements": 260}}
    rig = load_config(find_config("ideal", "rigs"), RigConfig)
    runs = {}
    for name, more in (("plain", {}), ("for it", {"sampler": asked, "stop": {"scene_error": 0.2}})):
        run = start(Material.model_validate(base | more), rig, tmp_path / name)
        reason = run()
        m = run.store.measured()
        run.close()
        runs[name] = seen(m.asked[24:, :3], m.asked[24:, 3:]).mean(), reason
    assert runs["for it"][0] > 1.3 * runs["plain"][0]
    assert "estimated error in the picture" in runs["for it"][1] and "budget" in runs["plain"][1]
    from gonio.run.products import evaluate_run, judge, make_brdf

    errors = []
    for name in runs:
        make_brdf(tmp_path / name)
        line = judge(tmp_path / name)
        assert ("Good: estimated error in the picture" in line) == (name == "for it"), line
        errors.append(evaluate_run(str(tmp_path / name), None).get("scene_error"))
    assert errors[0] is None and 0 < errors[1] < 0.3
    made().save("panel.npz")
    with pytest.raises(ConfigError, match=r"panel.npz is missing or not the file that the run began with"):
        resume(tmp_path / "for it")


@pytest.mark.parametrize(
    "section, says",
    [
        ({"sampler": {"proposal": "independence", "target": {"scene": "x.npz"}}}, "scene: a target of kind `unknown`"),
        ({"stop": {"scene_error": 0.1}}, "stop.scene_error: of which picture?"),
    ],
)
def test_configs_that_cannot_be_meant(section, says):
    with pytest.raises(ValueError, match=says):
        Material.model_validate({"name": "x"} | section)


@pytest.mark.parametrize(
    "text, says",
    [
        ("", "not XML"),
        ("<scene>", "not XML"),
        ("<html/>", "its first element is <html>"),
        ("<scene/>", "there are: none has an id"),
        ('<scene><bsdf id="paint" type="diffuse"/></scene>', "there are: paint; name one with --bsdf"),
        ('<!DOCTYPE s [<!ENTITY a "aaaa">]><scene>&a;</scene>', "defines entities"),
    ],
)
def test_scenes_that_cannot_be_used_are_one_line(tmp_path, text, says):
    path = tmp_path / "s.xml"
    path.write_text(text)
    with pytest.raises(ConfigError) as e:
        put(read_scene(path), "measured", path, None)
    assert says in str(e.value) and "\n" not in str(e.value) and str(path) in str(e.value)


def test_unknown_scene_names_those_that_ship():
    with pytest.raises(ConfigError, match=r"none of the scenes that ship \(interior, panel, sky\)"):
        find_scene("attic")
    assert {p.stem for p in FOLDER.glob("*.xml")} == {"interior", "panel", "sky"}
