// Bundles src/main.js and three.js into ../viewer.min.js: `npm ci && npm run build`. The same lock file gives the same bytes.
import { readFileSync } from "node:fs";
import { build } from "esbuild";

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
  banner: { js: `/*! collalign report viewer; contains three.js:\n${license}\n*/` },
});
