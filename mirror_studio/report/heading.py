"""A mirror and its manifest in, what stands at the head of the report out: which part, which files, which day, whose names."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Mapping
from typing import Any

from mirror_cad.mirror import Mirror

SIGNATURES = ("made", "checked", "approved")
HANDS = {"left": "left: the driver sits on its right, x > 0", "right": "right: the driver sits on its left, x < 0"}


def today() -> str:
    """The day in UTC, 2026-11-22; SOURCE_DATE_EPOCH sets it, so that the same specification gives the same bytes."""
    return time.strftime("%Y-%m-%d", time.gmtime(int(os.environ.get("SOURCE_DATE_EPOCH", str(int(time.time()))))))


def heading(mirror: Mirror, manifest: Mapping[str, Any]) -> dict[str, Any]:
    """Part number and revision, None where none is stated; hand, title, specification with its hash, program and day."""
    spec = mirror.spec
    versions = manifest.get("versions") or {}
    program = " ".join(["mirror-cad", *([versions["mirror-cad"]] if "mirror-cad" in versions else [])])
    kernel = f", kernel cadquery-ocp {versions['cadquery-ocp']}" if "cadquery-ocp" in versions else ""
    return {
        "number": spec.part.number, "revision": spec.part.revision, "hand": spec.part.hand,
        "title": spec.part.title, "spec": spec.name,
        "spec_sha256": spec_digest(manifest["spec"]) if "spec" in manifest else None,
        "program": f"{program}{kernel}", "date": today(),
    }


def spec_digest(spec: Mapping[str, Any]) -> str:
    """SHA-256 of a specification as the manifest has it, written as JSON with sorted keys and without spaces."""
    return hashlib.sha256(json.dumps(spec, sort_keys=True, separators=(",", ":"), ensure_ascii=False).encode()).hexdigest()


def contradictions(mirror: Mirror) -> list[str]:
    """What in the specification speaks against the hand that it states."""
    spec = mirror.spec
    inboard = "right" if spec.part.hand == "left" else "left"
    if spec.eye.aligned in ("left", "right") and spec.eye.aligned != inboard:
        return [f"This is said to be a {spec.part.hand}-hand mirror, whose driver sits on its {inboard}, but the eye is "
                f"aligned with its {spec.eye.aligned} edge: part.hand names the part and mirrors nothing. Check the two before "
                "signing."]
    return []
