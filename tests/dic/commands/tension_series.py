"""A tension test of exactly known strains: its constants, and the gauges that read it."""

import numpy as np

E_MPA, YIELD_STRAIN, AREA_MM2, IMAGES = 70_000.0, 0.006, 20.0, 20
AXIAL = "axial=extensometer start=90,35 end=90,125 patch=30"
WIDTH = "width=area centre=90,80 size=130,100 direction_deg=0"
GAUGES = """
[[gauge]]
name = "axial"
kind = "extensometer"
start = [90, 35]
end = [90, 125]
patch = 30
[[gauge]]
name = "width"
kind = "area"
centre = [90, 80]
size = [130, 100]
direction_deg = 0
"""


def stress_mpa(strain):
    return np.minimum(E_MPA * strain, E_MPA * YIELD_STRAIN + 1500.0 * (strain - YIELD_STRAIN))
