"""How far `calibrate all` has come with a rig, as a rig file that names what was found; whoever goes on reads it."""

from pathlib import Path

import yaml

from gonio.atomic import write_text
from gonio.config.rig import CalibrationFiles, RigConfig
from gonio.rig.calibration import Dated, GeometryCalibration, RadiometryCalibration, load_calibration
from gonio.rig.errors import CalibrationMissing
from gonio.rig.stale import stale

STEPS: dict[str, type[Dated]] = {"geometry": GeometryCalibration, "radiometry": RadiometryCalibration}


class Calibrated:
    """`<folder>/<rig>.yaml`: the rig with the calibrations found so far. again: forget those."""

    def __init__(self, config: RigConfig, folder: Path, *, again: bool):
        self.path = folder / f"{config.name}.yaml"
        self.folder = folder
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
        write_text(self.path, f"# rig {self.config.name} as calibrated; written by `gonio calibrate all`\n{text}")

    def _read(self, config: RigConfig) -> dict[str, str]:
        """What the file names and still holds, of this very rig."""
        try:
            written = yaml.safe_load(self.path.read_text(encoding="utf-8"))
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
            if name is None:
                break  # what comes later was made with what comes before
            load_calibration(Path(name), model)
            done[step] = name
        files = config.calibration.model_copy(update=done)
        if old := stale(config.model_copy(update={"calibration": files})):
            raise CalibrationMissing(f"{next(iter(old.values()))}; begin anew with --again")
        return done
