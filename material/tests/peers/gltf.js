// What Khronos' validator says of a glTF file, as JSON.

const { readFileSync } = require("fs");
const { validateBytes, version } = require("gltf-validator");

validateBytes(new Uint8Array(readFileSync(process.argv[2]))).then((report) => {
  const { issues, info } = report;
  console.log(JSON.stringify({ version: version(), messages: issues.messages, info }));
});
