import os

from gonio.api.material import Material as Material
from gonio.api.measuring import acquire as acquire
from gonio.api.measuring import make_sampler as make_sampler
from gonio.api.measuring import resume as resume
from gonio.api.plot import PlottedBrdf
from gonio.api.rig import OpenRig as OpenRig
from gonio.api.rig import open_rig as open_rig
from gonio.api.run import Run as Run
from gonio.api.run import open_run as open_run
from gonio.geometry import from_angles as from_angles
from gonio.reconstruct.samples import Samples as Samples

__version__: str

def load_brdf(path: str | os.PathLike[str]) -> PlottedBrdf: ...
