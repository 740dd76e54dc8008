// The eye's rays through the pixels of a picture, in mirror coordinates, and back.

export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const normal = (a) => { const size = Math.hypot(...a); return a.map((v) => v / size); };
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

// The ray through a pixel's place: base + column·across + row·down, as the server's cameras have it.
class Camera {
  constructor(eye, base, across, down, columns) { Object.assign(this, { eye, base, across, down, columns }); }

  // Where on the mirror's picture plane, z = 0, the eye looks through a place.
  plane(column, row) {
    const d = this.base.map((b, i) => b + column * this.across[i] + row * this.down[i]);
    const t = -this.eye[2] / d[2];
    return [this.eye[0] + t * d[0], this.eye[1] + t * d[1]];
  }

  // The place at which a direction is seen.
  pixel(direction) {
    const { base, across, down } = this, ahead = cross(across, down);
    const share = dot(ahead, base) / dot(ahead, direction);
    const off = direction.map((d, i) => share * d - base[i]);
    return [dot(off, across) / dot(across, across), dot(off, down) / dot(down, down)];
  }
}

// The camera of one of an answer's pictures: on the road as the server says it, else that of the frame on the plane z = 0.
export function cameraOf(answer, name, kind, eye) {
  const from = answer.eyes_mm[eye], given = answer.cameras?.[name];
  if (given) {
    const camera = new Camera(from, given.slice(0, 3), given.slice(3, 6), given.slice(6, 9), given[9]);
    camera.axes = { right: normal(camera.across), up: normal(camera.down.map((v) => -v)) };
    return camera;
  }
  const [left, top, pixel, columns] = answer.frames[kind];
  return new Camera(from, [left - from[0], top - from[1], -from[2]], [pixel, 0, 0], [0, -pixel, 0], columns);
}
