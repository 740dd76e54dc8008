"""The messages of page and server: checked when they come in; figures and arrays go out as one binary message."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from mirror_cad.messages import sentence

MAGIC = b"MCS1"
LARGEST_MESSAGE = 2_000_000  # bytes: a specification with tables of some 50,000 rows
DEEPEST = 12  # levels of nesting: a specification has four
LARGEST_PICTURE = 4096  # pixels a side
MAX_DATA = 8  # files of one measured mirror
CHART = 3.0e38  # float32's largest: beyond, an array holds NaN


class WrongShapeError(Exception):
    """A message that is none of the protocol's: its connection is closed, with this reason."""


class StoppedError(Exception):
    """Raised by a progress callback: a newer request has come."""


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    id: Annotated[int, Field(ge=0, le=2**53)]


class ViewSettings(BaseModel):
    """How the mirror is turned and looked at: what a specification does not say.

    view : the picture on a plane, or the road that the mirror shows on a vehicle.   width, height : room for a picture.
    own : the name of an uploaded reflector to be seen beside the design.
    Before the picture: yaw_deg turns its face towards the driver's side, pitch_deg then turns it up.
    On the vehicle, as a scene has them: hand, flank_share and horizon_share say which mirror it is and how it is aimed,
    eye_x_m, eye_y_m, eye_z_m where the middle between the driver's ocular points is, eyes_apart_m how far apart they are.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    view: Literal["picture", "road"] = "picture"
    yaw_deg: Annotated[float, Field(ge=-45, le=45, allow_inf_nan=False)] = 0.0
    pitch_deg: Annotated[float, Field(ge=-45, le=45, allow_inf_nan=False)] = 0.0
    eyes: Literal["one", "both"] = "one"
    hand: Literal["left", "right"] = "left"
    flank_share: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] = 0.12
    horizon_share: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] = 0.6
    eye_x_m: Annotated[float, Field(ge=-5, le=5, allow_inf_nan=False)] = 0.0
    eye_y_m: Annotated[float, Field(ge=-5, le=5, allow_inf_nan=False)] = -0.49
    eye_z_m: Annotated[float, Field(gt=0, le=5, allow_inf_nan=False)] = 1.9
    eyes_apart_m: Annotated[float, Field(ge=0, le=0.2, allow_inf_nan=False)] = 0.065
    width: Annotated[int, Field(ge=16, le=LARGEST_PICTURE)] = 640
    height: Annotated[int, Field(ge=16, le=LARGEST_PICTURE)] = 480
    own: Annotated[str, Field(max_length=64)] | None = None


class Design(_Message):
    """Design this and show it. `fine`: with every edge smoothed and the deviations worked out, which takes longer."""

    type: Literal["design"]
    spec: dict[str, Any]
    look: ViewSettings
    fine: bool = False


class Probe(_Message):
    """What is seen at (x, y) mm of the picture plane in the design shown last."""

    type: Literal["probe"]
    x: Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
    y: Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
    eye: Annotated[int, Field(ge=0, le=1)] = 0


class Build(_Message):
    """Make the files of this design."""

    type: Literal["build"]
    spec: dict[str, Any]
    look: ViewSettings


class Pinned(_Message):
    """Show the pinned design, finely and beside the one that is worked on: no newer design takes its place."""

    type: Literal["pinned"]
    spec: dict[str, Any]
    look: ViewSettings


class Rules(_Message):
    """Hold the design shown last against the rule of the road that it names. `fine`: on the road with fields of vision."""

    type: Literal["rules"]
    fine: bool = False


class Inspect(_Message):
    """Lay measured data on this design.   data : the names of uploaded files; the rest as `mirror-cad inspect` has it."""

    type: Literal["inspect"]
    spec: dict[str, Any]
    look: ViewSettings
    data: Annotated[list[Annotated[str, Field(max_length=64)]], Field(min_length=1, max_length=MAX_DATA)]
    align: Literal["none", "321", "best-fit"] = "best-fit"
    sigma_mm: Annotated[float, Field(gt=0, le=10, allow_inf_nan=False)] | None = None


class Cancel(_Message):
    """Stop making files, or laying measured data on a design."""

    type: Literal["cancel"]
    what: Literal["build", "inspect"] = "build"


@dataclass(frozen=True, slots=True)
class Refused:
    """A request of the right shape whose look cannot be: which one, and what is wrong, in words."""

    type: Literal["design", "pinned", "build", "inspect"]
    id: int
    faults: tuple[str, ...]


AnyMessage = Design | Pinned | Probe | Build | Inspect | Rules | Cancel
_adapter: TypeAdapter[AnyMessage] = TypeAdapter(Annotated[AnyMessage, Field(discriminator="type")])


def read_message(text: str) -> AnyMessage | Refused:
    """A page's message; a request whose look has a key or value that it may not have is Refused.

    Raises: WrongShapeError for any other text.
    """
    if len(text) > LARGEST_MESSAGE:
        raise WrongShapeError(f"a message of {len(text)} characters; {LARGEST_MESSAGE} are read")
    try:
        raw = json.loads(text, parse_constant=_no_constant)
        if _depth(raw) > DEEPEST:
            raise WrongShapeError(f"a message nested deeper than {DEEPEST}")
        return _adapter.validate_python(raw)
    except (ValueError, RecursionError) as error:
        if isinstance(error, ValidationError):
            details = error.errors(include_url=False)
            if all(len(detail["loc"]) > 2 and detail["loc"][1] == "look" for detail in details):
                return Refused(raw["type"], raw["id"], look_faults(details, raw["look"]))
            first = details[0]
            raise WrongShapeError(f"{'.'.join(str(key) for key in first['loc'])}: {first['msg']}"[:100]) from None
        raise WrongShapeError("not a message in JSON") from None


def look_faults(details: list[Any], look: dict[str, Any]) -> tuple[str, ...]:
    """A look's validation errors as sentences: `look.yaw_deg = 60: must be at least -45 and at most 45`."""
    return tuple(sentence(detail | {"loc": ("look", detail["loc"][-1])}, {"look": look}, Build) for detail in details)


def _no_constant(name: str) -> Any:
    raise ValueError(f"{name} is no JSON")


def _depth(value: Any) -> int:
    deepest, waiting = 0, [(value, 1)]
    while waiting:
        here, level = waiting.pop()
        deepest = max(deepest, level)
        if level > DEEPEST:
            break
        if isinstance(here, dict):
            waiting += [(item, level + 1) for item in here.values()]
        elif isinstance(here, list):
            waiting += [(item, level + 1) for item in here]
    return deepest


def pack(header: dict[str, Any], pictures: dict[str, bytes], arrays: dict[str, NDArray[Any]]) -> bytes:
    """One binary message: MAGIC, the header's length (uint32, little-endian), the header as JSON with a list of `parts`.

    Then the parts: JPEG pictures and float32 arrays, each starting at a multiple of four bytes.
    """
    parts, bodies = [], []
    for name, data in pictures.items():
        parts.append({"name": name, "kind": "jpeg", "bytes": len(data)})
        bodies.append(data)
    for name, array in arrays.items():
        with np.errstate(over="ignore"):
            data = np.where(np.abs(array) < CHART, array, np.nan).astype("<f4").tobytes()
        parts.append({"name": name, "kind": "float32", "bytes": len(data), "shape": list(array.shape)})
        bodies.append(data)
    text = json.dumps(header | {"parts": parts}, allow_nan=False, ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    return b"".join([MAGIC, struct.pack("<I", len(text)), text, *(body + b"\0" * (-len(body) % 4) for body in bodies)])


def unpack(message: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """The header and the parts of a binary message: what the page does, for tests and other clients."""
    if message[:4] != MAGIC:
        raise WrongShapeError("not a message of the studio")
    (length,) = struct.unpack_from("<I", message, 4)
    header: dict[str, Any] = json.loads(message[8:8 + length])
    at, parts = 8 + length, {}
    for part in header["parts"]:
        data = message[at:at + part["bytes"]]
        parts[part["name"]] = data if part["kind"] == "jpeg" else np.frombuffer(data, "<f4").reshape(part["shape"])
        at += part["bytes"] + (-part["bytes"] % 4)
    return header, parts
