"""A picture of what a picture uses: itself, the material's share of it, and the directions that enter it."""

from pathlib import Path

from gonio.atomic import beside
from gonio.render.scene.record import Recorded
from gonio.render.scene.used import Used, slices
from gonio.render.shade import to_srgb


def draw(found: Recorded, known: Used, path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15, 3.9), layout="constrained")
    scene, share, angles, around = figure.subplots(1, 4)
    scene.imshow(to_srgb(found.image))
    scene.set_title("the picture, the material grey")
    shown = share.imshow(found.mask, cmap="magma", vmin=0, vmax=1)
    share.set_title("share of the light off the material")
    figure.colorbar(shown, ax=share, shrink=0.8)
    for axis in (scene, share):
        axis.set_axis_off()
    by_theta, by_phi = slices(found.picture)
    for axis, table, names, across in (
        (angles, by_theta, ("theta_o, to the eye [deg]", "theta_i, to the light [deg]"), 90),
        (around, by_phi, ("phi between them [deg]", "theta_o [deg]"), 180),
    ):
        shown = axis.imshow(table, origin="lower", extent=(0, across, 0, 90), aspect="auto", cmap="viridis")
        axis.set_xlabel(names[0])
        axis.set_ylabel(names[1])
        figure.colorbar(shown, ax=axis, shrink=0.8)
    angles.set_title(f"where it looks; rig time about 1 : {known.fewer:.1f}")
    around.set_title(f"{known.domain:.0%} of all pairs bring 95 % of it")
    with beside(path) as part:
        figure.savefig(part, format="png", dpi=110)
