// Files that the page has brought in: kept in the browser, so that a server that was restarted gets them again.

import { post } from "./wire.js";

const NAME = "mirror-cad-studio";

function open() {
  return new Promise((done, failed) => {
    const request = indexedDB.open(NAME, 1);
    request.onupgradeneeded = () => request.result.createObjectStore("files");
    request.onsuccess = () => done(request.result);
    request.onerror = () => failed(request.error);
  });
}

async function inStore(mode, work) {
  const base = await open();
  try {
    return await new Promise((done, failed) => {
      const request = work(base.transaction("files", mode).objectStore("files"));
      request.onsuccess = () => done(request.result);
      request.onerror = () => failed(request.error);
    });
  } finally { base.close(); }
}

export const endingOf = (file) => (file.name.match(/\.[^.]*$/)?.[0] ?? "").toLowerCase();

const to = (kind, ending, name) => `/upload/${kind}?ending=${encodeURIComponent(ending)}&name=${encodeURIComponent(name)}`;

// Send a file to the server; its name there is the hash of its content.
export async function bringIn(kind, file) {
  const ending = endingOf(file);
  const { name } = await post(to(kind, ending, file.name), file);
  await inStore("readwrite", (store) => store.put({ kind, ending, blob: file, shown: file.name }, name)).catch(() => {});
  return name;
}

export async function bringAgain(names) {
  for (const name of names) {
    const kept = await inStore("readonly", (store) => store.get(name)).catch(() => undefined);
    if (kept) await post(to(kept.kind, kept.ending, kept.shown), kept.blob).catch(() => {});
  }
}

export const choose = async (endings) => (await chooseSome(endings, false))[0];

export function chooseSome(endings, multiple = true) {
  return new Promise((done) => {
    const input = document.createElement("input");
    input.type = "file";
    input.multiple = multiple;
    input.accept = endings.join(",");
    input.onchange = () => done([...input.files]);
    input.click();
  });
}

// Files dropped on the page.   dropped(zone, files): on which of the zones that are shown meanwhile.
export function dropZones(zones, dropped) {
  const ofFiles = (event) => event.dataTransfer?.types.includes("Files");
  let inside = 0; // an element is entered before another is left
  const end = () => { inside = 0; zones.hidden = true; };
  addEventListener("dragenter", (event) => { if (ofFiles(event)) { event.preventDefault(); inside += 1; zones.hidden = false; } });
  addEventListener("dragleave", (event) => { if (ofFiles(event) && --inside <= 0) end(); });
  addEventListener("dragover", (event) => { if (ofFiles(event)) event.preventDefault(); });
  addEventListener("drop", (event) => {
    if (!ofFiles(event)) return;
    event.preventDefault();
    end();
    const files = [...event.dataTransfer.files];
    if (files.length) dropped(event.target.closest?.("[data-zone]")?.dataset.zone ?? "measured", files);
  });
}

export function save(name, content, type = "text/plain") {
  const link = document.createElement("a");
  link.href = typeof content === "string" && content.startsWith("/") ? content : URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  document.body.append(link);
  link.click();
  link.remove();
}
