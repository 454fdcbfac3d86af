// Bundles src/main.js and three.js into ../viewer.min.js: `npm ci && npm run build`. The same lock file gives the same bytes.
// The first line holds a digest of the sources, by which the tests notice a bundle that was not built again.

import { createHash } from "node:crypto";
import { readFileSync, readdirSync } from "node:fs";
import { build } from "esbuild";

const digest = createHash("sha256");
for (const name of readdirSync("src").sort()) digest.update(readFileSync(`src/${name}`));
digest.update(readFileSync("package-lock.json"));
const license = readFileSync("node_modules/three/LICENSE", "utf8").trim();

await build({
  entryPoints: ["src/main.js"],
  outfile: "../viewer.min.js",
  bundle: true,
  minify: true,
  format: "iife",
  target: ["es2022"],
  charset: "ascii",
  legalComments: "none",
  banner: { js: `/*! collalign report viewer, sources ${digest.digest("hex")}; contains three.js:\n${license}\n*/` },
});
