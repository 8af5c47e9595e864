"""How far `calibrate all` has come with a rig, as a rig file that names what was found; whoever goes on reads it."""

from pathlib import Path

import yaml

from gonio.atomic import write_text
from gonio.config.loader import ConfigError
from gonio.config.rig import CalibrationFiles, RigConfig
from gonio.rig.calibration import Dated, GeometryCalibration, RadiometryCalibration, load_calibration
from gonio.rig.errors import CalibrationMissing
from gonio.rig.stale import stale

OURS = "written by `gonio calibrate all`"
STEPS: dict[str, type[Dated]] = {"geometry": GeometryCalibration, "radiometry": RadiometryCalibration}


class Calibrated:
    """`<folder>/<rig>.yaml`: the rig with the calibrations found so far. again: forget those.

    reference: digest of the one that is to be used; what was made with another is not gone on with. Raises
    CalibrationMissing; ConfigError where the file is somebody's own.
    """

    def __init__(self, config: RigConfig, folder: Path, reference: str, *, again: bool):
        self.path, self.reference = folder / f"{config.name}.yaml", reference
        if self.path.exists() and OURS not in self._text():
            raise ConfigError(f"{self.path}: is a rig file of your own; name another folder with --out")
        self.folder = folder
        writable(folder)
        self.done: dict[str, str] = {}
        if self.path.exists() and not again:
            self.done = self._read(config)
        self.config = config.model_copy(
            update={"calibration": config.calibration.model_copy(update={k: self.done.get(k) for k in STEPS})}
        )

    def add(self, step: str, path: Path) -> None:
        """A step was done: its file is named from now on."""
        self.done[step] = str(path)
        calibration = self.config.calibration.model_copy(update=self.done)
        self.config = self.config.model_copy(update={"calibration": calibration})
        text = yaml.safe_dump(self.config.model_dump(mode="json", exclude_defaults=True), sort_keys=False)
        write_text(self.path, f"# rig {self.config.name} as calibrated; {OURS}\n{text}")

    def _text(self) -> str:
        try:
            return self.path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as e:
            raise ConfigError(f"{self.path}: cannot be read ({type(e).__name__}); name another folder") from None

    def _read(self, config: RigConfig) -> dict[str, str]:
        """What the file names and still holds, of this very rig."""
        try:
            written = yaml.safe_load(self._text())
            files = CalibrationFiles.model_validate(written.pop("calibration", {}))
        except (ValueError, AttributeError, yaml.YAMLError):
            raise CalibrationMissing(f"{self.path}: is no rig file; remove it, or begin anew with --again") from None
        plain = config.model_dump(mode="json", exclude_defaults=True, exclude={"calibration"})
        if written != plain:
            raise CalibrationMissing(
                f"{self.path}: is of another rig, or this one was changed; begin anew with --again"
            )
        done = {}
        for step, model in STEPS.items():
            name = getattr(files, step)
            if name is None or not Path(name).is_file():
                break  # what comes later was made with what comes before
            found = load_calibration(Path(name), model)
            if isinstance(found, RadiometryCalibration) and found.reference not in (None, self.reference):
                raise CalibrationMissing(f"{name}: was made with another reference; begin anew with --again")
            done[step] = name
        files = config.calibration.model_copy(update=done)
        if old := stale(config.model_copy(update={"calibration": files})):
            raise CalibrationMissing(f"{next(iter(old.values()))}; begin anew with --again")
        return done


def about_to_make(config: RigConfig, kind: str, folder: Path) -> RigConfig:
    """The rig without a calibration of this kind that is missing: the one to be made takes its place.

    Raises ConfigError where the folder cannot be written, before anything is measured.
    """
    writable(folder)
    named = getattr(config.calibration, kind)
    if named is None or Path(named).is_file():
        return config
    return config.model_copy(update={"calibration": config.calibration.model_copy(update={kind: None})})


def writable(folder: Path) -> None:
    """Raises ConfigError where nothing can be kept there."""
    import tempfile

    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as e:
        raise ConfigError(f"{folder}: cannot be written ({e.strerror}); name another folder with --out") from None
