"""The head of the report: which part, which files, which day, whose names."""

from __future__ import annotations

import hashlib
import json
import os
import time
from dataclasses import dataclass

from mirror_cad.mirror import Mirror
from mirror_studio.as_json import JsonObject
from mirror_studio.build.results import Manifest

SIGNATURES = ("made", "checked", "approved")
HANDS = {"left": "left: the driver sits on its right, x > 0", "right": "right: the driver sits on its left, x < 0"}


def today() -> str:
    """The day in UTC, 2026-11-22; SOURCE_DATE_EPOCH sets it, so that the same specification gives the same bytes."""
    return time.strftime("%Y-%m-%d", time.gmtime(int(os.environ.get("SOURCE_DATE_EPOCH", str(int(time.time()))))))


@dataclass(frozen=True, slots=True)
class Heading:
    """Part number and revision, None where none is stated; hand, title, specification with its hash, program and day."""

    number: str | None
    revision: str | None
    hand: str
    title: str | None
    spec: str
    spec_sha256: str | None
    program: str
    date: str


def heading(mirror: Mirror, manifest: Manifest) -> Heading:
    """What stands at the head of a mirror's report."""
    spec, versions = mirror.spec, manifest.versions
    program = " ".join(["mirror-cad", *([versions["mirror-cad"]] if "mirror-cad" in versions else [])])
    kernel = f", kernel cadquery-ocp {versions['cadquery-ocp']}" if "cadquery-ocp" in versions else ""
    return Heading(spec.part.number, spec.part.revision, spec.part.hand, spec.part.title, spec.name,
                   None if manifest.spec is None else spec_digest(manifest.spec), f"{program}{kernel}", today())


def spec_digest(spec: JsonObject) -> str:
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
