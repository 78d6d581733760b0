"""Opens an exported block in Blender, lit from behind, and renders it.

    blender --background --python blender_open.py -- material.vdb block.png [SAMPLES [PIXELS]]

Works in any unit that the file was exported in. From Blender 4.5 on, Volume Coefficients takes
absorption and scattering as they are; before that, Principled Volume takes density and colour, which
gives every colour the extinction of the densest one.
"""

import math
import re
import sys

import bpy

arguments = sys.argv[sys.argv.index("--") + 1 :]
path, picture = arguments[:2]
samples = int(arguments[2]) if len(arguments) > 2 else 64
pixels = int(arguments[3]) if len(arguments) > 3 else 128

bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
bpy.ops.object.volume_import(filepath=path, align="WORLD", location=(0, 0, 0))
block = bpy.context.object
grids = block.data.grids
grids.load()
names = [grid.name for grid in grids]
# Active voxels go on around the block, for interpolation; its own are told in the file's metadata.
with open(path, "rb") as file:
    told = re.search(rb'"cells":\[(\d+),(\d+),(\d+)\]', file.read(1 << 20))
matrix = grids["density"].matrix_object
x, y, z = (int(cells) * matrix[axis][axis] for axis, cells in enumerate(told.groups()))

material = bpy.data.materials.new("block")
material.use_nodes = True
tree = material.node_tree
tree.nodes.clear()
output = tree.nodes.new("ShaderNodeOutputMaterial")
if hasattr(bpy.types, "ShaderNodeVolumeCoefficients"):
    volume = tree.nodes.new("ShaderNodeVolumeCoefficients")
    for name, socket in (("sigma_a", "Absorption Coefficients"), ("sigma_s", "Scatter Coefficients")):
        attribute = tree.nodes.new("ShaderNodeAttribute")
        attribute.attribute_name = name
        tree.links.new(attribute.outputs["Vector"], volume.inputs[socket])
else:
    volume = tree.nodes.new("ShaderNodeVolumePrincipled")
    volume.inputs["Density Attribute"].default_value = "density"
    volume.inputs["Color Attribute"].default_value = "color"
    volume.inputs["Color"].default_value = (1, 1, 1, 1)
    volume.inputs["Density"].default_value = 1
tree.links.new(volume.outputs[0], output.inputs["Volume"])
block.data.materials.append(material)
# As many steps as there are voxels.
block.data.render.step_size = 0

# Unit irradiance on the back face, which lies at z = 0.
light = bpy.data.materials.new("light")
light.use_nodes = True
nodes = light.node_tree.nodes
nodes.clear()
emission = nodes.new("ShaderNodeEmission")
emission.inputs["Strength"].default_value = 1 / math.pi
surface = nodes.new("ShaderNodeOutputMaterial").inputs["Surface"]
light.node_tree.links.new(emission.outputs[0], surface)
bpy.ops.mesh.primitive_plane_add(size=1, location=(x / 2, y / 2, -1e-3 * z))
bpy.context.object.scale = (x, y, 1)
bpy.context.object.data.materials.append(light)

# The rig's camera: it looks at the front face along -z, with +y up.
distance = 2 * max(x, y, z)
bpy.ops.object.camera_add(location=(x / 2, y / 2, z + distance), rotation=(0, 0, 0))
camera = bpy.context.object
camera.data.type = "ORTHO"
camera.data.ortho_scale = max(x, y)
camera.data.clip_end = 10 * distance
scene.camera = camera

scene.render.engine = "CYCLES"
cycles = scene.cycles
cycles.device = "CPU"
cycles.samples = samples
cycles.use_denoising = False
# Light that scatters hundreds of times is the rule here.
cycles.max_bounces = cycles.volume_bounces = cycles.transparent_max_bounces = 1024
cycles.min_light_bounces = 1024
cycles.sample_clamp_indirect = 0
cycles.volume_max_steps = 1024
scene.render.resolution_x = max(1, round(pixels * x / max(x, y)))
scene.render.resolution_y = max(1, round(pixels * y / max(x, y)))
scene.render.film_transparent = True
scene.render.filepath = picture
bpy.ops.render.render(write_still=True)
print(f"{path}: {', '.join(names)}; a block of {x:.4g} x {y:.4g} x {z:.4g}; wrote {picture}")
