"""The tables of a simulated rig with small cameras, which render quickly."""

SMALL = {
    "driver": "simulated-camera",
    "width_px": 48,
    "height_px": 32,
    "exposure_us": 5000.0,
    "gain": 2.0,
}
TABLES = {
    "simulation": {"driver": "virtual-rig", "seed": 3},
    "stage": {"driver": "zaber-ascii", "port": "@stage_tcp", "angle_min_deg": -5.0, "angle_max_deg": 90.0},
    "load_frame": {
        "driver": "modbus-frame",
        "address": "@load_frame_rtu",
        "load_max_n": 5000.0,
        "displacement_max_mm": 2.0,
    },
    "cameras": {"front": SMALL, "side": SMALL | {"pan_deg": 20.0, "bits": 12}},
}
