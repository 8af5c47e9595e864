"""The functions of gonio once more, as their papers write them, for numbers of any precision.

`m` is a namespace of elementary functions: mpmath (scalars of 50 digits) or numpy (arrays of extended precision, to
look at a million inputs at once). Directions are triples of numbers and are made unit vectors first.
"""

from typing import Any

Vector = tuple[Any, Any, Any]


class Extended:
    """numpy's elementary functions under mpmath's names, for arrays of np.longdouble. No erfc: see Case.extended."""

    def __init__(self):
        import numpy as np

        self.atan2, self.hypot, self.sqrt, self.exp = np.arctan2, np.hypot, np.sqrt, np.exp
        self.pi = np.longdouble("3.14159265358979323846264338327950288")


def normalised(m, v: Vector) -> Vector:
    length = m.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    return v[0] / length, v[1] / length, v[2] / length


def dot(a: Vector, b: Vector):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def half(m, wi: Vector, wo: Vector) -> Vector:
    return normalised(m, (wi[0] + wo[0], wi[1] + wo[1], wi[2] + wo[2]))


def theta_h(m, wi: Vector, wo: Vector):
    h = half(m, wi, wo)
    return m.atan2(m.hypot(h[0], h[1]), h[2])


def theta_d(m, wi: Vector, wo: Vector):
    s = wi[0] + wo[0], wi[1] + wo[1], wi[2] + wo[2]
    t = wi[0] - wo[0], wi[1] - wo[1], wi[2] - wo[2]
    return m.atan2(m.sqrt(dot(t, t)), m.sqrt(dot(s, s)))


def ggx_d(m, h: Vector, a):
    """Trowbridge & Reitz 1975: a^2 / (pi cos^4 (a^2 + tan^2)^2)."""
    tan2 = (h[0] * h[0] + h[1] * h[1]) / (h[2] * h[2])
    return a * a / (m.pi * h[2] ** 4 * (a * a + tan2) ** 2)


def ggx_lambda(m, w: Vector, a):
    tan2 = (w[0] * w[0] + w[1] * w[1]) / (w[2] * w[2])
    return (m.sqrt(1 + a * a * tan2) - 1) / 2


def beckmann_d(m, h: Vector, a):
    tan2 = (h[0] * h[0] + h[1] * h[1]) / (h[2] * h[2])
    return m.exp(-tan2 / (a * a)) / (m.pi * a * a * h[2] ** 4)


def beckmann_lambda(m, w: Vector, a):
    c = w[2] / (a * m.hypot(w[0], w[1]))
    return (m.exp(-c * c) / (c * m.sqrt(m.pi)) - m.erfc(c)) / 2


def student_d(m, h: Vector, a, gamma):
    tan2 = (h[0] * h[0] + h[1] * h[1]) / (h[2] * h[2])
    return (gamma - 1) / (m.pi * a * a * h[2] ** 4) * (1 + tan2 / (a * a)) ** -gamma


def schlick(m, c, f0):
    return f0 + (1 - f0) * (1 - c) ** 5


def conductor(m, c, eta, k):
    """The mean of |rs|^2 and |rp|^2 of a complex index, in real numbers (Born & Wolf 14.4)."""
    s2 = 1 - c * c
    t0 = eta * eta - k * k - s2
    ab = m.sqrt(t0 * t0 + 4 * eta * eta * k * k)
    a = m.sqrt((ab + t0) / 2)
    rs = (ab + c * c - 2 * a * c) / (ab + c * c + 2 * a * c)
    t = c * c * ab + s2 * s2
    return (rs + rs * (t - 2 * a * c * s2) / (t + 2 * a * c * s2)) / 2


def microfacet(m, wi: Vector, wo: Vector, d, la, lb, f0):
    h = half(m, wi, wo)
    return schlick(m, dot(wi, h), f0) * d / ((1 + la + lb) * 4 * wi[2] * wo[2])


def ggx(m, wi: Vector, wo: Vector, a, f0):
    h = half(m, wi, wo)
    return microfacet(m, wi, wo, ggx_d(m, h, a), ggx_lambda(m, wi, a), ggx_lambda(m, wo, a), f0)


def beckmann(m, wi: Vector, wo: Vector, a, f0):
    h = half(m, wi, wo)
    return microfacet(m, wi, wo, beckmann_d(m, h, a), beckmann_lambda(m, wi, a), beckmann_lambda(m, wo, a), f0)


def ggx_pdf(m, wi: Vector, wo: Vector, a):
    """Density of visible normals over |dwo / dh| (Heitz 2018): D G1 / (4 cos theta_i)."""
    h = half(m, wi, wo)
    return ggx_d(m, h, a) / ((1 + ggx_lambda(m, wi, a)) * 4 * wi[2])


def smaller(a, b):
    """The smaller of two, by what numbers of any kind can do."""
    return (a + b - abs(a - b)) / 2


def abc(m, wi: Vector, wo: Vector, b, c, eta):
    """Löw et al. 2012, eq. 11, of a = 1 and kd = 0: F S G / (cos theta_i cos theta_o)."""
    h = half(m, wi, wo)
    cos_d = dot(wi, h)
    g = smaller(1 + 0 * h[2], 2 * h[2] * smaller(wi[2], wo[2]) / cos_d)
    one_minus = (h[0] * h[0] + h[1] * h[1]) / (1 + h[2])
    return conductor(m, cos_d, eta, 0 * eta) * g * (1 + b * one_minus) ** -c / (wi[2] * wo[2])
