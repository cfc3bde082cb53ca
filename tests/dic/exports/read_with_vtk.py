"""Read a grid with VTK and a netCDF file with netCDF-C; runs in an environment that has both libraries."""

import json
import sys

import numpy as np
from netCDF4 import Dataset
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray
from vtkmodules.vtkIOXML import vtkXMLStructuredGridReader


def main(grid_file: str, netcdf_file: str, number: str, out: str) -> None:
    arrays, units = {}, {}
    reader = vtkXMLStructuredGridReader()
    reader.SetFileName(grid_file)
    reader.Update()
    values = reader.GetOutput().GetPointData()
    for k in range(values.GetNumberOfArrays()):
        array, key = values.GetArray(k), vtkDataArray.UNITS_LABEL()
        if array.GetNumberOfComponents() == 1:
            arrays[f"vtk_{array.GetName()}"] = vtk_to_numpy(array)
            known = array.HasInformation() and array.GetInformation().Has(key)
            units[f"vtk_{array.GetName()}"] = array.GetInformation().Get(key) if known else "1"
    with Dataset(netcdf_file) as file:
        (row,) = np.flatnonzero(file["image"][:] == int(number))
        for name, variable in file.variables.items():
            if "x_px" in variable.dimensions and name not in ("x_px", "active"):
                whole = variable[row] if "image" in variable.dimensions else variable[:]
                arrays[f"nc4_{name}"] = np.ma.filled(whole.astype(float), np.nan)
                units[f"nc4_{name}"] = variable.units
    np.savez(out, units=np.array(json.dumps(units)), **arrays)


if __name__ == "__main__":
    main(*sys.argv[1:])
