// The road in the driver's view: the switch to it, what is said of aim and rays there, and whether what is shown is a draft.

import { el, find } from "./dom.js";
import { fixed } from "./numbers.js";

const metres = (value) => `${fixed(Math.abs(value), 2)} m`;

export const aimInWords = ({ yaw_deg, pitch_deg }) => `This aim: yaw ${fixed(yaw_deg, 2)}°, pitch ${fixed(pitch_deg, 2)}°`;

// What a ray meets: X behind the eyes, Y beside the vehicle's middle.
export function metInWords({ what, at_m: at }) {
  if (!at) return "goes into the sky";
  const [x, y, z] = at;
  const back = `X ${metres(x)} ${x < 0 ? "ahead" : "behind"}`, aside = `Y ${metres(y)} ${y < 0 ? "left" : "right"}`;
  if (what === "road" || what === "ground") return `lands on the ${what === "road" ? "road" : "grass"} at ${back}${x < 0 ? " of" : ""} the eyes, ${aside}`;
  return `meets the ${what} at ${back}, ${aside}, ${metres(z)} up`;
}

export class Road {
  // switched: called when another view is asked for.
  constructor(store, switched) {
    this.switched = switched;
    this.note = find("#draft");
    this.step = "";
    this.buttons = ["picture", "road"].map((view) => {
      const button = find(`#view-${view}`);
      button.addEventListener("click", () => { if (store.now.look.view !== view) store.edit(({ look }) => { look.view = view; }); });
      return [view, button];
    });
  }

  refresh({ look: { view } }, pinned) {
    const state = `${view} ${Boolean(pinned)}`;
    if (state === this.state) return;
    this.state = state;
    for (const [name, button] of this.buttons) button.setAttribute("aria-pressed", String(name === view));
    const road = view === "road";
    find("#side").classList.toggle("road", road);
    find("#eyes").title = road ? "From between the eyes, or the left and the right eye side by side (E)" : "One eye, or both side by side (E)";
    const mark = (kind, sign, words) => el("span", {}, el("b", { class: kind }, sign), words);
    const caption = road ? ["Ground seen, m", mark("both-eyes", "■", "both eyes"), mark("left-eye", "—", "left"), mark("right-eye", "—", "right"),
      ...(pinned ? [mark("of-a", "┄", "A")] : [])] : ["Seen of the picture plane, m"];
    find("#plan-caption").replaceChildren(...caption);
    find("#plan").setAttribute("aria-label", road
      ? "Plan of the road behind the eyes: the ground that the left eye, the right eye and both see in the mirror, lanes and vehicles"
      : "Where the rays by way of the outline land on the picture plane, with the lane");
    if (this.view !== view) {
      this.view = view;
      this.switched();
    }
  }

  shown({ road, fine }) {
    this.step = "";
    this.say(road && !fine ? "Draft" : "");
  }

  working({ step, share }) {
    const draft = this.note.dataset.draft === "yes" ? "Draft · " : "";
    this.step = share > 0 ? `${step} ${Math.round(100 * share)} %` : `${step} …`;
    this.note.textContent = draft + this.step;
    this.note.hidden = false;
  }

  failed() { this.say(this.note.dataset.draft === "yes" ? "Draft" : ""); }

  say(text) {
    this.note.dataset.draft = text ? "yes" : "no";
    if (this.note.textContent !== text) this.note.textContent = text;
    this.note.hidden = !text;
  }
}

// What the driver's view shows, as a PNG file; null while it is a draft.
export async function pictureOf({ answer, images }) {
  if (!answer?.road || !answer.fine) return null;
  const canvas = document.createElement("canvas");
  canvas.width = images.reduce((sum, image) => sum + image.width, 0);
  canvas.height = Math.max(...images.map((image) => image.height));
  const context = canvas.getContext("2d");
  images.reduce((x, image) => { context.drawImage(image, x, 0); return x + image.width; }, 0);
  return new Promise((done) => canvas.toBlob(done, "image/png"));
}
