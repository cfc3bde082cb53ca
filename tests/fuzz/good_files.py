"""Make one good file of every kind that the commands read; bad inputs are made from these files."""

import json
import shutil
import zipfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import h5py

from tests.command_line import run_dic, run_rig
from tests.dic.regions.imagej_bytes import RECT, roi_bytes
from tests.places import EXAMPLES

ROTATION = """
kind = "rotation"
title = "Two small turns"
[sample]
name = "plate"
thickness_mm = 1.0
width_mm = 25.0
gauge_length_mm = 25.0
[rotation]
increment_deg = 2.0
total_deg = 4.0
[settle]
angle_tolerance_deg = 0.01
dwell_s = 0.5
timeout_s = 60.0
poll_s = 0.2
"""

RIG = """
[rig]
name = "a small virtual rig"
[simulation]
driver = "virtual-rig"
seed = 1
[cameras.on_axis]
driver = "simulated-camera"
width_px = 480
height_px = 480
focal_px = 1500.0
[stage]
driver = "zaber-ascii"
port = "@stage"
angle_min_deg = -5.0
angle_max_deg = 365.0
[load_frame]
driver = "modbus-frame"
address = "@load_frame"
load_max_n = 20000.0
displacement_max_mm = 6.0
[operator]
driver = "simulated-operator"
"""

POLYGONS = "x_px,y_px,polygon\n100,100,a\n300,100,a\n300,300,a\n150,350,b\n200,350,b\n200,380,b\n"

REGION = """
image_size_px = [480, 480]
polygons = [[[100, 100], [380, 100], [380, 380], [100, 380]]]
holes = [[[200, 200], [250, 200], [250, 250]]]
[[crack]]
path = [[300, 100], [310, 200]]
width_px = 4
"""

GAUGES = """
[[gauge]]
name = "axial"
kind = "extensometer"
start = [240, 160]
end = [240, 320]
patch = 40
[[gauge]]
name = "area"
kind = "area"
centre = [240, 240]
size = [80, 60]
"""

CURVE = "Time;Load;Strain\n(s);(kN);(%)\n" + "".join(
    f"{0.1 * k:.1f};{min(0.06 * k, 6.0 + 0.002 * k):.4f};{0.0015 * k + max(0, k - 100) * 0.02:.5f}\n"
    for k in range(200)
)

TEXTS = [("gauges", "toml", GAUGES), ("region", "toml", REGION), ("curve", "csv", CURVE)]

CAMPAIGN = """
[defaults]
load = "Load:kN"
strain = "Strain:%"
load_std_percent = 0.5
[[specimen]]
name = "first"
area_mm2 = 20.0
direction_deg = 45.0
file = "{curve}"
"""

ALIGNMENT = {
    "file_format": "offaxis-alignment",
    "slopes": [0.001, 0.0, 0.0, 0.0],
    "covariance": [[1e-8 if i == j else 0.0 for j in range(4)] for i in range(4)],
    "pivot_mm": [0.0, 0.0],
}


@dataclass(frozen=True)
class GoodFiles:
    """The good files, by their placeholder in a command, such as ``{image}``."""

    folder: Path
    files: dict[str, Path]


def make_good_files(folder: Path) -> GoodFiles:
    """Run a small rotation on the virtual rig, measure it, and return all its files."""
    texts = {"protocol": ROTATION, "rig": RIG, "polygons": POLYGONS}
    files = {}
    for name, text in texts.items():
        files[name] = folder / f"{name}.{'csv' if name == 'polygons' else 'toml'}"
        files[name].write_text(text)
    for name, ending, text in TEXTS:
        files[name] = folder / f"{name}.{ending}"
        files[name].write_text(text)
    files["areas"] = folder / "areas.zip"
    with zipfile.ZipFile(files["areas"], "w") as archive:
        archive.writestr("area.roi", roi_bytes(RECT, (100, 100, 380, 380)))
    files["campaign"] = folder / "campaign.toml"
    files["campaign"].write_text(CAMPAIGN.format(curve=files["curve"]))
    files["tension"] = Path(shutil.copy(EXAMPLES / "tension.toml", folder))
    files |= {name: folder / f"{name}.h5" for name in ("run", "results", "calibration")}
    _do(run_rig("run", files["protocol"], "--rig", files["rig"], "-o", files["run"]))
    files["heartbeat"] = folder / "run.heartbeat.json"
    _do(run_dic("process", files["run"], "-o", files["results"]))
    _do(run_dic("export", files["results"], "dice", "-o", folder / "exports"))
    files["peer"] = folder / "peer.txt"
    shutil.copy(next((folder / "exports" / "dice").rglob("*.txt")), files["peer"])
    files["alignment"] = folder / "alignment.json"
    files["alignment"].write_text(json.dumps(ALIGNMENT))
    with h5py.File(files["run"]) as run:
        frames = run["entry/instrument/on_axis/data"][()]
    for name, frame in zip(("grid", "image", "deformed"), frames, strict=False):
        files[name] = folder / f"{name}.png"
        cv2.imwrite(str(files[name]), frame)
    files["picture"] = files["image"]
    cv2.imwrite(str(folder / "image.tif"), frames[1])
    cv2.imwrite(str(folder / "image.bmp"), frames[1])
    files |= {"tiff": folder / "image.tif", "bmp": folder / "image.bmp", "mask": folder / "mask.png"}
    mask = frames[1].copy()
    mask[:], mask[100:380, 100:380] = 0, 255
    cv2.imwrite(str(files["mask"]), mask)
    _do(run_dic("calibrate", files["grid"], "--pitch-mm", "0.5", "-o", files["calibration"]))
    return GoodFiles(folder, files)


def _do(ended) -> None:
    assert ended.status in (0, 1), ended
