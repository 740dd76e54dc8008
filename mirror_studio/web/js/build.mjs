// The page's modules and three.js in, one file that the server hands out and the licences of what is in it out.
import { build } from "esbuild";
import { createHash } from "node:crypto";
import { readdirSync, readFileSync, writeFileSync } from "node:fs";

const here = new URL("./", import.meta.url).pathname, out = new URL("../static/", import.meta.url).pathname;
// Which sources a bundle was made of: a test compares.
const sources = createHash("sha256");
for (const name of readdirSync(here).filter((one) => one.endsWith(".js")).sort()) sources.update(name).update(readFileSync(here + name));
await build({
  entryPoints: [new URL("main.js", import.meta.url).pathname],
  outfile: `${out}studio.js`,
  bundle: true, format: "esm", minify: true, target: "es2022", legalComments: "none", charset: "utf8",
  banner: { js: "/* Made by mirror_studio/web/js/build.mjs; contains three.js (MIT), see studio-licences.txt. */\n" +
    `/* sources: ${sources.digest("hex")} */` },
});
const three = JSON.parse(readFileSync(new URL("node_modules/three/package.json", import.meta.url)));
const licence = readFileSync(new URL("node_modules/three/LICENSE", import.meta.url), "utf8");
writeFileSync(`${out}studio-licences.txt`, `studio.js contains three.js ${three.version}:\n\n${licence}`);
