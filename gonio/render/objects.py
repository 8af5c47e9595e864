"""Our own preview object: a sphere, a rounded box and a bent cloth patch, as triangle meshes with normals."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array, from_angles, unit


@dataclass(frozen=True)
class Mesh:
    """vertices, normals (V, 3), uv (V, 2), faces (F, 3)."""

    vertices: Array
    normals: Array
    uv: Array
    faces: NDArray[np.int64]

    def write_obj(self, path) -> None:
        """Wavefront OBJ; v, vt and vn share an index."""
        rows = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in self.vertices]
        rows += [f"vt {u:.6f} {v:.6f}" for u, v in self.uv]
        rows += [f"vn {x:.6f} {y:.6f} {z:.6f}" for x, y, z in self.normals]
        rows += ["f " + " ".join(f"{i}/{i}/{i}" for i in face + 1) for face in self.faces]
        with open(path, "w") as out:
            out.write("\n".join(rows) + "\n")


def sphere(centre=(0.0, 0.0, 0.0), radius: float = 1.0, n: int = 96) -> Mesh:
    u, v = np.meshgrid(np.linspace(0, 1, 2 * n), np.linspace(0, 1, n))
    normals = from_angles(np.pi * v.ravel(), 2 * np.pi * u.ravel())
    return Mesh(np.asarray(centre) + radius * normals, normals, np.stack([u.ravel(), v.ravel()], -1), _faces(n, 2 * n))


def rounded_box(centre, half=(0.7, 0.7, 0.7), corner: float = 0.2, n: int = 96) -> Mesh:
    """The sphere's normals pushed out to a box of half extents `half` with edges of radius `corner`."""
    ball = sphere(n=n)
    inner = np.asarray(half) - corner
    # a soft sign spreads the flat faces over the directions near each axis
    towards = np.clip(3.0 * ball.normals, -1, 1)
    vertices = np.asarray(centre) + inner * towards + corner * ball.normals
    return Mesh(vertices, _vertex_normals(vertices, ball.faces, n, 2 * n), ball.uv, ball.faces)


def cloth(centre, size: float = 1.6, n: int = 96) -> Mesh:
    """A patch bent in two waves."""
    u, v = np.meshgrid(np.linspace(-1, 1, n), np.linspace(-1, 1, n))
    z = 0.25 * np.cos(2.5 * u + 0.6 * v) + 0.18 * np.sin(2.2 * v) - 0.15 * u * v
    vertices = np.asarray(centre) + 0.5 * size * np.stack([u.ravel(), v.ravel(), 2 / size * z.ravel()], -1)
    faces = _faces(n, n)
    normals = _vertex_normals(vertices, faces, 0, 0)
    return Mesh(vertices, normals, np.stack([u.ravel(), v.ravel()], -1) * 0.5 + 0.5, faces)


def preview() -> list[Mesh]:
    """The three of them, side by side on z = 0."""
    return [
        sphere((-1.15, 0.1, 0.7), 0.7),
        rounded_box((0.55, 0.3, 0.6), (0.6, 0.6, 0.6)),
        cloth((0.0, -1.1, 0.35), 1.5),
    ]


def _faces(rows: int, columns: int) -> NDArray[np.int64]:
    i = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = i[:-1, :-1].ravel(), i[:-1, 1:].ravel(), i[1:, 1:].ravel(), i[1:, :-1].ravel()
    return np.concatenate([np.stack([a, d, b], -1), np.stack([b, d, c], -1)])


def _vertex_normals(vertices: Array, faces: NDArray[np.int64], rows: int, columns: int) -> Array:
    """Area-weighted; vertices that coincide (a sphere's seam and poles) share theirs."""
    p = vertices[faces]
    area = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    _, same = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)
    total = np.zeros((same.max() + 1, 3))
    for k in range(3):
        np.add.at(total, same.ravel()[faces[:, k]], area)
    return unit(total[same.ravel()])
