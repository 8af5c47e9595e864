"""Small files of every format, written here by hand or by other people's libraries: never by gonio."""

import json
import struct

import numpy as np

from gonio.brdf import Ggx, Lambert, Mixture
from gonio.geometry import from_angles

BRDF = Mixture([Lambert([0.1, 0.2, 0.3]), Ggx(0.25, f0=[0.5, 0.4, 0.3])], [0.3, 0.7])
GREY = Mixture([Lambert(0.2), Ggx(0.25, f0=0.4)], [0.3, 0.7])
RGB_TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
TEXTS = ("csv", "pab", "astm", "json", "zemax", "lighttools", "speos", "cornell")


def grid(step_i=15.0, step_o=10.0, step_phi=30.0):
    """theta_i, theta_o, phi_o (degrees), phi_i = 0."""
    parts = np.arange(0, 76, step_i), np.arange(0, 86, step_o), np.arange(0, 360, step_phi)
    return [a.ravel() for a in np.meshgrid(*parts, indexing="ij")]


def scattered(n=3000, seed=1):
    """Angles even in solid angle."""
    rng = np.random.default_rng(seed)
    theta_i, theta_o = np.degrees(np.arccos(rng.random((2, n)) * 0.95 + 0.05))
    return theta_i, theta_o, rng.random(n) * 360


def pairs(theta_i, theta_o, phi_o):
    wi = from_angles(np.radians(theta_i), 0 * theta_i)
    return wi, from_angles(np.radians(theta_o), np.radians(phi_o))


def table(names, columns, separator=","):
    rows = [separator.join(f"{v:.10g}" for v in row) for row in zip(*columns)]
    return "\n".join([separator.join(names), *rows]) + "\n"


OWN = ["theta_i_deg", "phi_i_deg", "theta_o_deg", "phi_o_deg", "f_R", "f_G", "f_B"]


def csv(angles=None, change=lambda f, wo: f):
    theta_i, theta_o, phi_o = grid() if angles is None else angles
    wi, wo = pairs(theta_i, theta_o, phi_o)
    return table(OWN, [theta_i, 0 * theta_i, theta_o, phi_o, *change(BRDF.eval(wi, wo), wo).T])


def pab(theta_i=30.0, form="DSF", head=None):
    _, theta_o, phi_o = grid(step_i=90)
    wi, wo = pairs(np.full(len(theta_o), theta_i), theta_o, phi_o)
    value = BRDF.eval(wi, wo) @ RGB_TO_XYZ.T * (wo[:, 2:] if form == "DSF" else 1)
    head = head or f"#intheta {theta_i}\n#inphi 0\n"
    lines = [f"{t:.3f} {p:.3f} " + " ".join(f"{v:.8g}" for v in row) for t, p, row in zip(theta_o, phi_o, value)]
    return f'#sample_name "x"\n#colorimetry: CIE-XYZ\n#format: theta phi {form}\n{head}' + "\n".join(lines) + "\n"


def astm():
    theta_i, theta_o, phi_o = np.radians(grid())
    f = BRDF.eval(from_angles(theta_i, 0 * theta_i + 0.3), from_angles(theta_o, phi_o + 0.3))
    head = f"ASTM E1392\nSAMPLE_ID x\nNUM_POINTS {len(f)}\nVARS theta_i,phi_i,theta_s,phi_s,R,G,B\n"
    return head + table(["x"], []).replace("x\n", "") + "\n".join(
        ",".join(f"{v:.10g}" for v in row) for row in zip(theta_i, 0 * theta_i + 0.3, theta_o, phi_o + 0.3, *f.T)
    )  # fmt: skip


def cornell():
    theta_i, theta_o, phi_o = np.radians(grid())
    f = BRDF.eval(from_angles(theta_i, 0 * theta_i), from_angles(theta_o, phi_o))
    phi_o = np.where(phi_o > np.pi, phi_o - 2 * np.pi, phi_o)
    return "\n".join(" ".join(f"{v:.10g}" for v in row) for row in zip(theta_i, 0 * theta_i, theta_o, phi_o, *f.T))


def brdf_json():
    theta_i, theta_o, phi_o = (np.repeat(a, 2) for a in grid())
    wi, wo = pairs(theta_i, theta_o, phi_o)
    f = GREY.eval(wi, wo)[:, 0] * np.tile([1.0, 0.5], len(wi) // 2)
    values = lambda a, unit: {"unit": unit, "values": a.tolist()}
    data = {
        "wavelength_i": values(np.tile([550, 650], len(wi) // 2), "nm"),
        "theta_i": values(theta_i, "°"), "phi_i": values(0 * theta_i, "°"),
        "theta_r": values(theta_o, "deg"), "phi_r": values(np.radians(phi_o), "rad"),
        "BRDF": values(f, "sr^-1"), "uBRDF": values(0 * f + 2.0, "%"),
    }  # fmt: skip
    return json.dumps({"metadata": {"type": "BRDF"}, "data": data})


def zemax():
    """Directions by rotating about the y axis, as the format's own description has it."""
    incidence, azimuth, radial = (
        np.array([10.0, 40.0, 60.0]),
        np.arange(0, 181, 30.0),
        np.array([0, 2, 5, 10, 20, 40.0]),
    )
    lines = ["# made by hand", "Source  Measured", "Symmetry  PlaneSymmetrical", "SpectralContent  Monochrome"]
    lines += ["ScatterType  BRDF", "SampleRotation  1", "0"]
    for key, angles in (("AngleOfIncidence", incidence), ("ScatterAzimuth", azimuth), ("ScatterRadial", radial)):
        lines += [f"{key} {len(angles)}", "\t".join(f"{a:g}" for a in angles)]
    lines += ["", "Monochrome", "DataBegin"]
    for i in np.radians(incidence):
        mirror = np.array([-np.sin(i), 0, np.cos(i)])
        up = np.array([np.cos(i), 0, np.sin(i)])  # at a right angle to it, towards the normal
        lines.append("TIS 0.5")
        for a in np.radians(azimuth):
            side = up * np.cos(a) + np.array([0, 1.0, 0]) * np.sin(a)
            wo = np.array([mirror * np.cos(r) + side * np.sin(r) for r in np.radians(radial)])
            wi = np.tile(from_angles(i, 0.0), (len(radial), 1))
            lines.append("\t".join(f"{v:.6e}" for v in GREY.eval(wi, wo)[:, 0]))
    return "\n".join([*lines, "DataEnd", ""])


def lighttools():
    azimuth, radial = np.arange(0, 360, 30.0), np.arange(0, 81, 10.0)
    lines = ["# made by hand", "Symmetry Asymmetric", "SpectralContent Monochrome"]
    for key, angles in (("ScatterAzimuth", azimuth), ("ScatterRadial", radial)):
        lines += [f"{key} {len(angles)}", " ".join(f"{a:g}" for a in angles)]
    lines.append("DataBegin")
    for side, kind, aoi in (("Front", "BRDF", 0), ("Front", "BRDF", 30), ("Front", "BTDF", 30), ("Back", "BRDF", 30)):
        lines += [f"AOI {aoi}", "POI 0", f"Side {side}", "Wavelength 550", f"ScatterType {kind}", "TIS 0.4"]
        for a in np.radians(azimuth):
            wo = from_angles(np.radians(radial), a)
            wi = np.tile(from_angles(np.radians(aoi), np.pi / 2), (len(radial), 1))
            lines.append(" ".join(f"{v:.6e}" for v in GREY.eval(wi, wo)[:, 0]))
    return "\n".join([*lines, "DataEnd", ""])


def speos(times=3.0):
    """Values `times` too large: the spectrum says how much there is, at 0 degrees."""
    theta, phi, incidence = np.arange(0, 91, 1.0), np.arange(0, 361, 5.0), np.array([0.0, 30.0])
    t, p = np.meshgrid(np.radians(theta), np.radians(phi), indexing="ij")
    wi = np.tile(from_angles(0.0, 0.0), (t.size, 1))
    f = GREY.eval(wi, from_angles(t.ravel(), p.ravel())).reshape(t.shape)
    weight = np.gradient(np.radians(theta))[:, None] * np.gradient(np.radians(phi))[None]
    weight[:, [0, -1]] /= 2
    albedo = float((f * np.cos(t) * np.sin(t) * weight).sum())
    lines = ["OPTIS - Anisotropic BSDF surface file v8.0", "0", "Comment", "23", "Measurement description"]
    lines += [
        "0\t1\t0",
        "1\t0",
        "1",
        "1",
        "0\t",
        "2",
        "0\t30\t",
        "0\t0",
        "",
        "2",
        f"350\t{100 * albedo}",
        f"850\t{100 * albedo}",
    ]
    for i in np.radians(incidence):
        wi = np.tile(from_angles(i, np.pi), (t.size, 1))  # the mirror direction is at phi 0
        f = times * GREY.eval(wi, from_angles(np.minimum(t, 1.5706).ravel(), p.ravel())).reshape(t.shape)
        lines += [f"{len(theta)} {len(phi)}", "\t" + "\t".join(f"{x:g}" for x in phi)]
        lines += [f"{a:g}\t" + "\t".join(f"{v:.6g}" for v in row) for a, row in zip(theta, f)]
    return "\n".join([*lines, "End of file", ""])


def text_of(kind: str) -> str:
    return {"csv": csv, "pab": pab, "astm": astm, "json": brdf_json, "zemax": zemax, "lighttools": lighttools,
            "speos": speos, "cornell": cornell}[kind]()  # fmt: skip


NAMES = {"csv": "x.csv", "pab": "x.txt", "astm": "x.astm", "json": "x.brdf", "zemax": "x.bsdf", "lighttools": "x.bsdf",
         "speos": "x.anisotropicbsdf", "cornell": "x.txt"}  # fmt: skip


def merl(path) -> None:
    """Constant but for a hole, and for what lies beyond theta_h 45 degrees."""
    data = np.full((3, 90, 90, 180), 1500 / np.pi * 0.5)
    data /= np.array([1, 1.15, 1.66])[:, None, None, None]
    data[:, 63:] *= 0.5
    data[:, :, 10:12, :] = -1
    path.write_bytes(struct.pack("<3i", 90, 90, 180) + data.astype("<f8").tobytes())
