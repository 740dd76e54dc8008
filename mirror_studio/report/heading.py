"""The head of the report: which part, which files, which day, whose names."""

from __future__ import annotations

import hashlib
import json
import os
import time
from dataclasses import dataclass

from mirror_cad.mirror import Mirror
from mirror_studio.build.results import Manifest
from mirror_studio.json_types import JsonObject

SIGNATURES = ("made", "checked", "approved")
HANDS = {"left": "left: the driver sits on its right, x > 0",
         "right": "right: the driver sits on its left, x < 0. The files are the reflection in x = 0 of the design, in whose "
                  "frame laws, figures, tables and pictures are; the points to check are the file's"}


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
    if spec.eye.aligned != "left":
        return []
    if spec.part.hand == "left":
        return ["This is said to be a left-hand mirror, whose driver sits on its right, but the eye is aligned with its left "
                "edge. Check the two before signing."]
    return ["This is said to be a right-hand mirror, whose files are the reflection of what the laws say, but the eye is "
            "aligned with the left edge of the design, as if the laws had been written for the right-hand side already: they "
            "would then be reflected twice. Check the two before signing."]
