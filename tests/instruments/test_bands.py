"""A spectrometer by its description: 2,048 numbers of one answer become the material's channels."""

import numpy as np
import pytest

from gonio.config import ConfigError, load_config
from gonio.config.bands import Bands
from gonio.config.rig import RigConfig
from tests.conftest import ROOT
from tests.instruments.bench import Bench, answering, described

NM = np.linspace(380, 780, 2048)
RGB = [(600, 700), (500, 580), (420, 490)]
SPECTRUM = 100 + 30000 * np.exp(-(((NM - 560) / 60) ** 2))


def bands(**keys):
    return {"bands_nm": RGB, **({"wavelengths_nm": NM.tolist()} if not keys else keys)}


def test_channels_are_means_over_their_bands(tmp_path):
    said = np.round(SPECTRUM).astype(int)
    spectrometer = described(
        r"(?P<values>.*)",
        count=2048,
        unit="counts",
        integrates=True,
        overload_above=65000,
        ranges={"full_scale": [65535]},
    )
    b = Bench(tmp_path, spectrometer, answering(" ".join(map(str, said))), white=20000.0, bands=bands())
    b.detector.connect()
    r = b.detector.read(0.2)
    want = [said[(NM >= low) & (NM <= high)].mean() / 20000 for low, high in RGB]
    np.testing.assert_allclose(r.value, want, rtol=1e-12)  # counts grow with the time by themselves
    assert b.detector.channels == 3 and len(r.raw["range"]) == 3 and r.raw["exposure_s"] == 0.2
    said[1000] = 65535  # one pixel that clips
    b.device.altered = lambda _: " ".join(map(str, said))
    assert b.detector.read().saturated
    b.close()


def test_a_polynomial_says_the_wavelengths():
    a, b = Bands(**bands()), Bands(**bands(polynomial=(380.0, 400 / 2047), pixels=2048))
    np.testing.assert_allclose(a.binned(SPECTRUM), b.binned(SPECTRUM), rtol=1e-3)
    np.testing.assert_allclose(b.wavelengths, NM, rtol=1e-12)


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("wavelengths_nm: [400, 500, 450]", "wavelengths must grow from pixel to pixel"),
        ("wavelengths_nm: [400, 500]\n    polynomial: [1, 2]", "one of the two"),
        ("polynomial: [400, -1]", "wavelengths must grow"),
        ("wavelengths_nm: [700, 710]", "bands_nm: no pixel lies between 400 and 500 nm (700 to 710)"),
        ("wavelengths_nm: [400, 410]", "bands: 2 wavelengths for the 1 numbers of keithley_6485"),
        ("wavelengths_nm: [400, .nan]", "detector.bands.wavelengths_nm"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, keys, words):
    path = tmp_path / "rig.yaml"
    text = (ROOT / "configs/rigs/picoammeter.yaml").read_text()
    new = "detector:\n  kind: text\n  instrument: keithley_6485\n  bands:\n    bands_nm: [[400, 500]]\n    "
    new += f"{keys}\nlight: {{}}"
    path.write_text(text.replace("detector: {kind: text, instrument: keithley_6485, white: 3.0e-7}", new))
    with pytest.raises(ConfigError) as e:
        load_config(path, RigConfig)
    assert words in str(e.value) and "\n" not in str(e.value)
