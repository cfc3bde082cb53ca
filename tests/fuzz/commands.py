"""The tested commands, and the good files that each of them reads."""

COMMANDS: dict[str, list[str]] = {
    "correlate": ["dic", "correlate", "{image}", "{deformed}"],
    "correlate a TIFF": ["dic", "correlate", "{tiff}", "{deformed}"],
    "correlate a BMP": ["dic", "correlate", "{image}", "{bmp}"],
    "correlate in a mask": ["dic", "correlate", "{image}", "{deformed}", "--roi", "{mask}"],
    "correlate in polygons": ["dic", "correlate", "{image}", "{deformed}", "--polygon", "{polygons}"],
    "correlate in mm": ["dic", "correlate", "{image}", "{deformed}", "--calibration", "{calibration}"],
    "correlate by an alignment": [
        *("dic", "correlate", "{image}", "{deformed}", "--calibration", "{calibration}"),
        *("--motion", "rigid", "--alignment", "{alignment}"),
    ],
    "calibrate": ["dic", "calibrate", "{grid}"],
    "draw": [
        *("dic", "draw", "{image}", "--roi", "{polygons}", "--gauges", "{gauges}"),
        *("--calibration", "{calibration}", "-o", "{new}.html"),
    ],
    "quality": ["dic", "quality", "{image}"],
    "quality of two": ["dic", "quality", "{image}", "--second", "{deformed}", "--roi", "{mask}"],
    "study": [
        *("dic", "study", "{image}", "{deformed}", "--subsets", "21", "--steps", "10", "--windows", "3"),
        *("--shapes", "affine", "--roi", "{mask}", "--write", "{new}.toml"),
    ],
    "process": ["dic", "process", "{run}", "-o", "{new}.h5"],
    "gauges": ["dic", "gauges", "{results}", "{gauges}"],
    "plot gauges": ["dic", "plot", "gauges", "{results}", "{gauges}", "-o", "{new}.svg"],
    "plot cuts": [
        *("dic", "plot", "cuts", "{results}", "{gauges}", "-o", "{new}.png"),
        *("--gauge", "cut=cut start=20,20 end=60,60"),
    ],
    "plot an animation": ["dic", "plot", "animation", "{results}", "-o", "{new}.gif"],
    "compare": ["dic", "compare", "{results}", "{peer}", "--camera", "on_axis", "--image", "1"],
    "export": ["dic", "export", "{results}", "csv", "vtk", "mat", "-o", "{new}"],
    "correlate with gauges": ["dic", "correlate", "{image}", "{deformed}", "--gauges", "{gauges}"],
    "properties": [
        *("dic", "properties", "{curve}", "--load", "Load:kN", "--strain", "Strain:%", "--area-mm2", "20"),
        *("--json", "{new}.json"),
    ],
    "campaign": ["dic", "campaign", "{campaign}", "--json", "{new}.json", "--report", "{new}.html"],
    "gauges beside a record": [
        *("dic", "gauges", "{results}", "{gauges}", "--record", "{curve}", "--load", "Load:kN"),
        *("--time", "Time:s", "--image-interval-s", "1"),
    ],
    "properties of results": [
        *("dic", "properties", "{results}", "--gauges", "{gauges}", "--area-mm2", "20", "--gauge", "area"),
    ],
    "report": ["dic", "report", "{results}", "-o", "{new}.html"],
    "plan": ["rig", "plan", "{protocol}"],
    "plan a tension": ["rig", "plan", "{tension}", "--rig", "{rig}"],
    "run": ["rig", "run", "{protocol}", "--rig", "{rig}", "-o", "{new}.h5"],
    "check": ["rig", "check", "{rig}"],
    "verify": ["rig", "verify", "{run}"],
    "repair": ["rig", "repair", "{run}"],
    "replay": ["rig", "replay", "{run}"],
    "go on": ["rig", "run", "{protocol}", "--rig", "{rig}", "--continue", "{run}", "-o", "{new}.h5"],
    "status": ["rig", "status", "{rig}"],
    "hold": ["rig", "hold", "{rig}"],
    "unload": ["rig", "unload", "{rig}", "--yes"],
    "jog": ["rig", "jog", "{rig}", "--angle-deg", "1.0", "--yes"],
    "simulate": ["rig", "simulate", "{rig}"],
}
"""The command lines. ``{new}`` stands for a path at which no file exists."""
