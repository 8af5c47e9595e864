"""Small RGL tables of an elliptic GGX lobe, made without the exporter."""

import numpy as np

from gonio.brdf.models.ndf import GgxNdf
from gonio.geometry import from_angles


def _tables(alpha_x, alpha_y, phi_i, theta_i, n, m):
    ndf = GgxNdf(alpha_x, alpha_y)
    x, y = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n))  # rows: azimuth
    theta = np.pi / 2 * x.ravel() ** 2
    h = from_angles(theta, np.pi * (2 * y.ravel() - 1))
    area = (2 * np.pi**2 * x.ravel() * np.sin(theta)).reshape(n, n)
    sigma = h[:, 2] * (1 + ndf.smith_lambda(h))
    vndf = np.zeros((len(phi_i), len(theta_i), n, n))
    for a, p in enumerate(phi_i):
        for b, t in enumerate(theta_i):
            wi = np.broadcast_to(from_angles(min(t, 1.56), p), h.shape)
            vndf[a, b] = ndf.pdf(wi, h).reshape(n, n) * area
    shade = np.linspace(0.5, 1.5, m)[:, None] + np.cos(2 * np.pi * np.linspace(0, 1, m))[:, None] * 0.1
    luminance = np.broadcast_to(np.ones((m, m)), (len(phi_i), len(theta_i), m, m)) * shade.mean()
    rgb = np.ones((len(phi_i), len(theta_i), 3, m, m)) * np.array([0.9, 0.5, 0.2])[:, None, None]
    fields = {
        "description": np.frombuffer(b"synthetic", np.uint8),
        "phi_i": phi_i,
        "theta_i": theta_i,
        "sigma": np.clip(sigma, 1e-6, None).reshape(n, n),
        "ndf": ndf.d(h).reshape(n, n),
        "vndf": vndf,
        "luminance": luminance,
        "rgb": rgb,
        "jacobian": np.array([1], np.uint8),
    }
    return {k: v if v.dtype == np.uint8 else v.astype(np.float32) for k, v in fields.items()}


def isotropic_fields(alpha=0.3, slices=6, n=48, m=8):
    fields = _tables(alpha, alpha, np.zeros(1), np.linspace(0, np.pi / 2, slices), n, m)
    # something to sample by: brighter towards one side, mirror symmetric in the azimuth
    v = np.abs(np.linspace(-1, 1, m))[:, None] * np.linspace(0.2, 1, m) + 0.3
    fields["luminance"] = np.broadcast_to(v, fields["luminance"].shape).astype(np.float32)
    return fields


def anisotropic_fields(turn, alpha_x=0.2, alpha_y=0.4, n=48, m=8):
    """Tables over a full turn of azimuths, a half (-pi..0), or a quarter (-pi..-pi/2)."""
    phi_i = np.linspace(-np.pi, -np.pi + 2 * np.pi / turn, 32 // turn + 1)
    return _tables(alpha_x, alpha_y, phi_i, np.linspace(0, np.pi / 2, 5), n, m)
