"""What OpenVDB itself reads from a file: each grid's voxels as raw float32, and the rest as JSON."""

import json
import sys

import numpy as np

try:
    import openvdb as vdb  # Its name since OpenVDB 11.
except ImportError:
    import pyopenvdb as vdb

path, folder = sys.argv[1:]
grids, metadata = vdb.readAll(path)
told = {"metadata": metadata, "grids": {}}
for grid in grids:
    low, high = grid.evalActiveVoxelBoundingBox()
    cells = [h - l + 1 for l, h in zip(low, high)]
    vector = grid.valueTypeName != "float"
    values = np.full(cells + [3] * vector, np.nan, np.float32)
    grid.copyToArray(values, ijk=low)
    values.tofile(f"{folder}/{grid.name}.f32")
    told["grids"][grid.name] = {
        "type": grid.valueTypeName,
        "low": low,
        "cells": cells,
        "active": grid.activeVoxelCount(),
        "class": grid.gridClass,
        "first": grid.transform.indexToWorld((0, 0, 0)),
        "next": grid.transform.indexToWorld((1, 1, 1)),
        "uniform": grid.transform.typeName == "UniformScaleTranslateMap",
        "metadata": {k: v for k, v in grid.metadata.items() if isinstance(v, str)},
    }
print(json.dumps(told))
