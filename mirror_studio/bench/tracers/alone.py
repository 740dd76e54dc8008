"""What one process needs to trace a reflector's file: the first trace's time, and the peak of its memory.

    python -m mirror_studio.bench.tracers.alone first FILE RAYS
    python -m mirror_studio.bench.tracers.alone reflect|fill FILE RAYS

Prints JSON. `fill` does all that `reflect` does but the last trace.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

EYE_MM = (115.0, 0.0, 753.3)  # near the driver's, whatever mirror it is


def measured(mode: str, path: Path, rays: int) -> dict[str, Any]:
    """Run this module in a process of its own."""
    answer = subprocess.run([sys.executable, "-m", __name__, mode, str(path), str(rays)], check=True, capture_output=True,
                            text=True)
    result: dict[str, Any] = json.loads(answer.stdout)
    return result


def first_call(path: str, rays: int) -> dict[str, float]:
    """Seconds of the imports, of reading the file, of the first trace and of the one after it."""
    times = [time.perf_counter()]

    def passed() -> float:
        times.append(time.perf_counter())
        return times[-1] - times[-2]

    import numpy as np

    import raytrace
    import raytrace.trace

    imports = passed()
    reflector = raytrace.load_reflector(path)
    load = passed()
    directions = _directions(rays)
    passed()
    raytrace.reflect(reflector, np.array(EYE_MM), directions)
    first = passed()
    raytrace.reflect(reflector, np.array(EYE_MM), directions)
    return {"import_s": imports, "load_s": load, "first_s": first, "second_s": passed()}


def peak_memory(path: str, rays: int, trace: bool) -> dict[str, float]:
    """The process's peak in MB, with inputs and outputs filled beforehand."""
    import numpy as np

    import raytrace
    from raytrace.rays import Trace

    reflector = raytrace.load_reflector(path)
    raytrace.reflect(reflector, np.array(EYE_MM), _directions(1000))
    directions, out = _directions(rays), Trace.empty(rays)
    for array in (out.status, out.points, out.normals, out.directions, out.distances):
        array.fill(0)
    if trace:
        raytrace.reflect(reflector, np.array(EYE_MM), directions, out=out)
    return {"peak_mb": _peak_kib() / 1024.0}


def _directions(rays: int) -> Any:
    """Rays to points all over the mirror, written in place: no array but the one that is returned."""
    import numpy as np

    directions = np.empty((rays, 3))
    rng = np.random.default_rng(3)
    for k, half in enumerate((115.0, 160.0)):
        rng.random(out=(column := np.empty(min(rays, 100_000))))
        for start in range(0, rays, len(column)):
            part = directions[start:start + len(column), k]
            part[:] = half * (2.0 * column[:len(part)] - 1.0) - EYE_MM[k]
    directions[:, 2] = -EYE_MM[2]
    return directions


def _peak_kib() -> int:
    """Of this program alone: getrusage would count what the parent used before it became this program."""
    for line in Path("/proc/self/status").read_text("ascii").splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1])
    raise OSError("/proc/self/status names no VmHWM")


if __name__ == "__main__":
    mode, path, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
    print(json.dumps(first_call(path, count) if mode == "first" else peak_memory(path, count, mode == "reflect")))
