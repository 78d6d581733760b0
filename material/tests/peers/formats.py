"""What other people's programs read from exported files, as JSON: pynrrd, OpenEXR, NumPy."""

import json
import sys

import numpy as np
import nrrd
import OpenEXR

folder = sys.argv[1]
told = {}
# Fortran order: the first axis is the file's first, coefficients.
values, header = nrrd.read(f"{folder}/m.nrrd", index_order="F")
told["nrrd"] = {
    "values": values.transpose(0, 3, 2, 1).reshape(values.shape[0], -1).tolist(),
    "coefficients": header["coefficients"],
    "about": header["diaphane_header"],
    "directions": np.asarray(header["space directions"][1:], float).tolist(),
    "space": header["space"],
}
# Saved again as pynrrd does: by gzip, with the keys that it knows.
nrrd.write(f"{folder}/again.nrrd", values, header={k: header[k] for k in header if k != "encoding"}, index_order="F")
density, header = nrrd.read(f"{folder}/density.nrrd", index_order="F")
told["density"] = density.transpose(2, 1, 0).ravel().tolist()
with OpenEXR.File(f"{folder}/m.exr", separate_channels=True) as file:
    part = file.parts[0]
    told["exr"] = {name: c.pixels.ravel().tolist() for name, c in part.channels.items()}
    told["exr_about"] = part.header["diaphane_header"]
archive = np.load(f"{folder}/m.npz")
told["npz"] = {name: archive[name].ravel().tolist() for name in ("kappa", "mu")}
print(json.dumps(told))
