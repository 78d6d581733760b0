"""What MaterialX makes of a document, as JSON: whether it is valid, and a shader's numbers."""

import json
import re
import sys

import MaterialX as mx
from MaterialX import PyMaterialXGenGlsl as glsl
from MaterialX import PyMaterialXGenShader as shaders

library = mx.createDocument()
mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
document = mx.createDocument()
mx.readFromXmlFile(document, sys.argv[1])
document.importLibrary(library)
valid, message = document.validate()
surface = document.getNode("average")
known = {i.getName(): i.getType() for i in surface.getNodeDef().getActiveInputs()}
generator = glsl.GlslShaderGenerator.create()
context = shaders.GenContext(generator)
context.registerSourceCodeSearchPath(mx.getDefaultDataSearchPath())
(material,) = shaders.findRenderableElements(document)
source = generator.generate("block", material, context).getSourceCode(shaders.PIXEL_STAGE)
uniforms = re.findall(r"^uniform \w+ average_(\w+) = (?:vec3)?\(?([^;)]*)\)?;", source, re.M)
told = {
    "valid": valid,
    "message": message,
    "material": material.getName(),
    "inputs": {i.getName(): i.getType() == known.get(i.getName()) for i in surface.getInputs()},
    "uniforms": {name: [float(n) for n in value.split(",")] for name, value in uniforms if re.match(r"[-\d]", value)},
}
print(json.dumps(told))
