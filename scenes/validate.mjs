// Validates every scenes/*/*.gltf with the Khronos glTF validator.
//
// Install the validator in a scratch folder, then give that folder (or set
// NODE_PATH to its node_modules):
//   mkdir scratch && (cd scratch && npm install gltf-validator)
//   node scenes/validate.mjs scratch
// Exits 1 if a file has errors.
import { createRequire } from "node:module";
import { readFileSync, readdirSync, statSync } from "node:fs";
import { dirname, join, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const where = process.argv[2] ? resolve(process.argv[2]) + "/" : import.meta.url;
const validator = createRequire(where)("gltf-validator");

const scenes = dirname(fileURLToPath(import.meta.url));
const files = readdirSync(scenes)
  .map((name) => join(scenes, name))
  .filter((path) => statSync(path).isDirectory())
  .flatMap((path) => readdirSync(path).filter((f) => /\.(gltf|glb)$/.test(f)).map((f) => join(path, f)));

const kinds = ["error", "warning", "info", "hint"];
let errors = 0;
for (const file of files) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), {
    uri: file,
    externalResourceFunction: async (uri) => new Uint8Array(readFileSync(join(dirname(file), decodeURIComponent(uri)))),
  });
  const { numErrors, numWarnings, numInfos, numHints, messages } = report.issues;
  const { drawCallCount, totalVertexCount, totalTriangleCount } = report.info;
  console.log(`${file.slice(scenes.length + 1)}: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} infos, ${numHints} hints` +
    ` (${drawCallCount} draw calls, ${totalVertexCount} vertices, ${totalTriangleCount} triangles)`);
  for (const m of messages) console.log(`  ${kinds[m.severity]} ${m.code} ${m.pointer ?? ""}: ${m.message}`);
  errors += numErrors;
}
if (files.length === 0) console.error("no .gltf files found");
process.exit(errors > 0 || files.length === 0 ? 1 : 0);
