"""Path-traces a block in Mitsuba 3; prints the front face's radiance along its normal as JSON.

Takes a JSON file: cells [nx, ny, nz], spacing_mm, extinction and albedo (nz, ny, nx, flat), eta,
light "collimated" or "diffuse", region [x0, x1, y0, y1] in mm on the back face, samples, seed.
Prints {"parts": [[...], ...]}: eight independent maps, ny rows of nx, flat.

Mitsuba's z points out of the front face: the block is turned upside down, z' = depth - z.
"""

import glob
import json
import os
import sys

import numpy as np

# Debian's own libLLVM 15 ends the process inside Dr.Jit; 19 works.
found = [path for v in (19, 20, 21) for path in glob.glob(f"/usr/lib/*/libLLVM*.so*{v}*")]
found += [path for v in (19, 20, 21) for path in glob.glob(f"/usr/lib/*/libLLVM-{v}.so*")]
if found and "DRJIT_LIBLLVM_PATH" not in os.environ:
    os.environ["DRJIT_LIBLLVM_PATH"] = found[0]

import mitsuba as mi

mi.set_variant("llvm_ad_mono" if found else "scalar_rgb")
mi.set_log_level(mi.LogLevel.Error)
T = mi.ScalarTransform4f

with open(sys.argv[1], encoding="utf-8") as file:
    job = json.load(file)
nx, ny, nz = job["cells"]
size = np.array(job["cells"]) * np.array(job["spacing_mm"])
eta = job["eta"]
to_world = T().scale(list(size))


def volume(name):
    values = np.array(job[name], np.float32).reshape(nz, ny, nx, 1)[::-1]
    return {
        "type": "gridvolume",
        "grid": mi.VolumeGrid(np.ascontiguousarray(values)),
        "raw": True,
        "filter_type": "nearest",
        "to_world": to_world,
    }


black = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
clear = {"type": "null"}
surface = clear if eta == 1 else {"type": "dielectric", "int_ior": eta, "ext_ior": 1.0}
# Mitsuba's rays start that far from where they were.
gap = 1e-3 * (1 + float(size.max()))
x0, x1, y0, y1 = job["region"]


def rectangle(x0, x1, y0, y1, bsdf, **extra):
    place = T().translate([(x0 + x1) / 2, (y0 + y1) / 2, -gap])
    scale = T().scale([(x1 - x0) / 2, (y1 - y0) / 2, 1])
    return {"type": "rectangle", "to_world": place @ scale, "bsdf": bsdf, **extra}


collimated = job["light"] == "collimated"
scene = {
    "type": "scene",
    "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": 1 << 20},
    "block": {
        "type": "cube",
        "to_world": T().translate(list(size / 2)) @ T().scale(list(size / 2)),
        "bsdf": surface,
        "interior": {
            "type": "heterogeneous",
            "sigma_t": volume("extinction"),
            "albedo": volume("albedo"),
            "phase": {"type": "isotropic"},
            "sample_emitters": collimated,
            "has_spectral_extinction": False,
        },
    },
    "camera": {
        "type": "orthographic",
        "near_clip": 1e-3 * float(size.max()),
        "far_clip": 10 * float(size.max()),
        "to_world": T().look_at(
            origin=[size[0] / 2, size[1] / 2, size[2] + float(size.max())],
            target=[size[0] / 2, size[1] / 2, 0],
            up=[0, 1, 0],
        )
        # The film is as high as it is wide unless its pixels say otherwise.
        @ T().scale([size[0] / 2, size[1] / 2 * nx / ny, 1]),
        "film": {
            "type": "hdrfilm",
            "width": nx,
            "height": ny,
            "pixel_format": "luminance",
            "component_format": "float32",
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent"},
    },
}
if collimated:
    # A lamp at infinity, seen through an aperture of four black plates.
    scene["lamp"] = {
        "type": "directional",
        "direction": [0, 0, 1],
        "irradiance": {"type": "rgb", "value": 1.0},
    }
    far = 4 * float(size.max())
    plates = [(-far, x0, -far, far), (x1, far, -far, far), (x0, x1, -far, y0), (x0, x1, y1, far)]
    for i, plate in enumerate(plates):
        scene[f"plate{i}"] = rectangle(*plate, black)
else:
    emitter = {"type": "area", "radiance": {"type": "rgb", "value": 1 / np.pi}}
    scene["lamp"] = rectangle(x0, x1, y0, y1, clear, emitter=emitter)

scene = mi.load_dict(scene)
parts = []
for part in range(8):
    picture = np.array(mi.render(scene, spp=job["samples"] // 8, seed=job["seed"] + part))
    # The film's first row is its highest y.
    parts.append(picture.reshape(ny, nx, -1)[::-1, :, 0].ravel().tolist())
print(json.dumps({"parts": parts}))
