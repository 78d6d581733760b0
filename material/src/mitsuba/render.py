"""Renders scene.xml channel by channel, which leaves far less noise than all colours at once.

    python render.py [SAMPLES] [OUTPUT.exr]     needs: pip install mitsuba
"""

import os
import sys

import mitsuba as mi
import numpy as np

samples = int(sys.argv[1]) if len(sys.argv) > 1 else 64
output = sys.argv[2] if len(sys.argv) > 2 else "slab.exr"
mi.set_variant("scalar_rgb")
scene = mi.load_file(os.path.join(os.path.dirname(os.path.abspath(__file__)), "scene.xml"))
integrator = mi.load_dict({"type": "volpath", "max_depth": -1, "rr_depth": 1000000})
params = mi.traverse(scene)
keys = [key for key in params.keys() if key.endswith(("sigma_t.data", "albedo.data"))]
assert len(keys) == 2, f"expected the volumes sigma_t and albedo, found {keys}"
volumes = {key: np.array(params[key]) for key in keys}
channels = []
for channel in range(volumes[keys[0]].shape[-1]):
    for key, values in volumes.items():
        # Grey: all channels are this one.
        params[key] = np.repeat(values[..., channel : channel + 1], values.shape[-1], axis=-1)
    params.update()
    image = mi.render(scene, integrator=integrator, spp=samples, seed=channel)
    channels.append(np.array(image)[..., 0])
    print(f"channel {channel}: mean radiance {channels[-1].mean():.4g}", flush=True)
colour = np.stack(channels if len(channels) == 3 else channels * 3, axis=-1)
mi.Bitmap(colour.astype(np.float32)).write(output)
mi.util.write_bitmap(os.path.splitext(output)[0] + ".png", colour / max(colour.max(), 1e-12))
print(f"wrote {output}")
