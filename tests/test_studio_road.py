"""The studio's road: the picture and figures that `mirror-cad drive` has, on the wire and in the page, and a control for every
key of a specification."""

from __future__ import annotations

import contextlib
import io
import json
import math
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page, expect
from pydantic import BaseModel
from websockets.sync.client import ClientConnection, connect

from mirror_cad.design_stages import design
from mirror_cad.errors import MirrorError
from mirror_cad.laws import Law, registered
from mirror_cad.spec import MirrorSpec
from mirror_cad.spec.file import load_spec
from mirror_studio.drive.measured import asked_of
from mirror_studio.drive.mirrors import driven_mirror
from mirror_studio.drive.pictures import eye_picture
from mirror_studio.scene_file import load_scene
from mirror_studio.web import engine, motorway, road, state
from mirror_studio.web.backdrop import Backdrops
from mirror_studio.web.controls import groups
from mirror_studio.web.protocol import StoppedError, ViewSettings, unpack
from mirror_studio.web.state import as_state
from mirror_studio.web.uploads import Uploads
from raytrace.measures.blind_zone import blind_zone
from raytrace.measures.ground import nearest_at_flank, seen_widths
from raytrace.reflector import Reflector
from raytrace.viewing.camera import Camera
from raytrace.visibility.image_points import image_points
from tests.studio_page import (
    CHROMIUM,
    SOON,
    address_comes_to,
    becomes,
    chromium,
    figure,
    opened,
    revision,
    revision_after,
    settled,
)
from tests.studio_server import Studio, running

SMALL = {"view": "road", "width": 160, "height": 180}
HAND_MS = 66  # of a picture's way while a slider moves, as the page promises it on 2 cores that nothing else uses


def silent(step: str, share: float) -> None:
    """Nobody listens."""


def seen(spec: MirrorSpec, fine: bool = False, **look: Any) -> engine.Shown:
    return road.show(spec, ViewSettings(**(SMALL | look)), fine, None, silent)


def decoded(picture: bytes) -> np.ndarray[Any, np.dtype[np.float64]]:
    with Image.open(io.BytesIO(picture)) as image:
        return np.asarray(image, dtype=np.float64)


# --- what is shown ----------------------------------------------------------------------------------------------------


def test_a_look_begins_where_the_scene_has_eyes_mirror_and_aim() -> None:
    scene, stand = load_scene("motorway"), motorway.MountParameters.of(ViewSettings())
    assert scene.aim
    assert stand == (scene.mirror.hand, scene.aim.flank_share, scene.aim.horizon_share, scene.eyes.middle_m,
                     scene.eyes.separation_m)
    assert motorway.scene_for(stand) == scene


def test_fine_picture_aim_and_ground_are_those_of_drive() -> None:
    """`mirror-cad drive` reads the mirror back from its STEP file, 1e-11 mm from the one here; JPEG changes the picture."""
    scene = load_scene("motorway")
    driven = driven_mirror("progressive-c", scene)
    shown = seen(load_spec("progressive-c"), fine=True, eyes="both")
    world = motorway.world(lambda text: None)
    width, height = (int(size) for size in shown.header["cameras"]["picture0"][-2:])
    wanted, _ = eye_picture(driven, driven.views.right, world, world.beside(driven), width, height)
    off = np.abs(decoded(shown.pictures["picture1"]) - wanted)
    assert off.mean() < 2.0
    assert np.percentile(off, 99) < 20.0
    found = shown.header["road"]
    assert found["yaw_deg"] == pytest.approx(math.degrees(driven.pose.yaw), abs=1e-7)
    assert found["pitch_deg"] == pytest.approx(math.degrees(driven.pose.pitch), abs=1e-7)
    subject = asked_of(scene, {name: body for name, body in world.named if name})
    views = driven.views.left, driven.views.right
    assert found["figures"]["seen_width_m"] == [pytest.approx([1e-3 * one.x_mm, 1e-3 * one.either_mm], rel=1e-6)
                                                for one in seen_widths(*views, driven.host, subject.widths_at)]
    assert found["figures"]["nearest_m"] == pytest.approx(1e-3 * nearest_at_flank(*views, driven.host)[0], rel=1e-6)
    assert found["figures"]["blind_length_m"] == pytest.approx(
        1e-3 * blind_zone(*views, driven.host, subject.lane, 0.0, subject.direct_view).length_mm, rel=1e-6)


def test_outlines_hold_the_widths() -> None:
    """At X = 20 m the edge of the ground that either eye sees lies where the figure has it, outward of the flank."""
    shown = seen(load_spec("sphere-950"), fine=True)
    own = load_scene("motorway").own_vehicle
    edges = [_crossings(shown.arrays[name], 20.0) for name in ("seen_left", "seen_right")]
    outward = -min(min(one) for one in edges) - 0.5 * own.width_m
    assert outward == pytest.approx(dict(map(tuple, shown.header["road"]["figures"]["seen_width_m"]))[20.0], rel=1e-3)
    assert len(_crossings(shown.arrays["seen_both"], 20.0)) == 2


def _crossings(outline: Any, x: float) -> list[float]:
    a, b = outline[:-1], outline[1:]
    with np.errstate(invalid="ignore"):
        k = np.flatnonzero((a[:, 0] - x) * (b[:, 0] - x) < 0.0)
    share = (x - a[k, 0]) / (b[k, 0] - a[k, 0])
    return (a[k, 1] + share * (b[k, 1] - a[k, 1])).tolist()  # type: ignore[no-any-return]


def test_a_draft_shows_the_same_with_fewer_pixels() -> None:
    """Its pixels are as many as its time allows, and hold what the fine picture has there."""
    spec = load_spec("progressive-c")
    fine, draft = seen(spec, True, width=640, height=720), seen(spec, width=640, height=720)
    small, large = (decoded(one.pictures["picture0"]) for one in (draft, fine))
    assert small.shape[0] < large.shape[0]
    scaled = np.asarray(Image.fromarray(large.astype(np.uint8)).resize(small.shape[1::-1], Image.Resampling.BOX), dtype=float)
    assert np.abs(small - scaled).mean() < 8.0
    cameras = [one.header["cameras"]["picture0"] for one in (draft, fine)]
    across = [np.linalg.norm(camera[3:6]) * camera[9] for camera in cameras]
    assert across[0] == pytest.approx(across[1], rel=1e-2)
    assert draft.header["road"]["yaw_deg"] == fine.header["road"]["yaw_deg"]
    assert "seen_both" not in draft.arrays


def test_what_is_past_the_mirror_is_kept_from_draft_to_draft_of_an_eye() -> None:
    """Through the pixels that it was made for it shows what rays show; another aim finds it, another eye does not."""
    world = motorway.world(lambda text: None).past
    eye = np.array([0.0, -490.0, 1250.0])
    camera = Camera.looking_at(eye, eye + [-900.0, -700.0, -150.0], np.array([0.0, 0.0, 1.0]), 0.5, 60, 70)
    pixel = 0.5 / 60
    backdrops = Backdrops()
    assert backdrops.of(world, camera, pixel) is None
    kept = backdrops.of(world, camera, pixel)
    assert kept is not None
    column, row = 0.5 + np.indices((60, 70))
    directions = camera.rays_through(column, row).reshape(-1, 3)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    off = np.abs(kept.radiance(eye, directions, np.zeros(1)) - world.radiance(eye, directions, 0.5 * pixel))
    assert np.quantile(off, 0.99) <= 1e-9  # rounding moves a ray over an edge here and there
    aimed = replace(camera, base=camera.base + 3.0 * camera.across)
    assert backdrops.of(world, aimed, pixel) is kept
    assert backdrops.of(world, replace(camera, base=camera.base + 20.0 * camera.across), pixel) is not kept
    assert backdrops.of(world, replace(camera, eye=eye + 1.0), pixel) is None


@pytest.mark.parametrize("hand", ["left", "right"])
def test_later_drafts_of_an_eye_show_what_its_first_shows(hand: str) -> None:
    spec = load_spec("progressive-c")
    made, stand = motorway.world(lambda text: None), motorway.MountParameters.of(ViewSettings(hand=hand, eye_y_m=0.013))
    mirror = motorway.driven(engine.designed(spec), stand)
    view = mirror.views.middle
    first, _, third = (decoded(engine.jpeg(road.draft(mirror, view, made, *road.camera_at(mirror, view, 140, 160)), 95))
                       for _ in range(3))
    assert np.abs(third - first).mean() < 1.0


def test_the_right_hand_mirror_is_the_reflection_of_the_left_one() -> None:
    """With the eyes reflected too, it is turned alike and shows as much ground."""
    spec = load_spec("progressive-c")
    left, right = (seen(spec, True, hand=hand, eye_y_m=y).header["road"] for hand, y in (("left", -0.49), ("right", 0.49)))
    for key in ("yaw_deg", "pitch_deg"):
        assert left[key] == pytest.approx(right[key], abs=1e-6)
    assert left["figures"]["nearest_m"] == pytest.approx(right["figures"]["nearest_m"], rel=1e-6)
    assert left["figures"]["blind_length_m"] == pytest.approx(right["figures"]["blind_length_m"], rel=1e-6)
    assert left["mirror_m"][1] == pytest.approx(-right["mirror_m"][1])


@pytest.mark.parametrize("eyes", ["one", "both"])
def test_what_a_probe_lands_on_is_seen_where_it_was_asked(eyes: str) -> None:
    """The way back: `image_points` looks for the point on the road, and finds the place."""
    look = ViewSettings(**(SMALL | {"eyes": eyes}))
    one = engine.designed(load_spec("progressive-c"))
    views = road.views_of(motorway.driven(one, motorway.MountParameters.of(look)), look)
    for eye, view in enumerate(views):
        found = road.probe(one, look, 20.0, -120.0, eye)
        assert found
        assert found["road"]["what"] == "road"
        x, y, z = found["road"]["at_m"]
        assert x > 2.0
        assert y < -0.87
        assert z == pytest.approx(0.0, abs=1e-9)
        place, shown = image_points(view, 1e3 * np.array([[x, y, z]]))
        assert shown[0]
        assert place[0] == pytest.approx([20.0, -120.0], abs=1e-4)
    assert road.probe(one, look, 500.0, 0.0, 0) is None


def test_a_probe_names_what_its_ray_meets() -> None:
    look, one = ViewSettings(**SMALL), engine.designed(load_spec("progressive-c"))
    met = {road.probe(one, look, float(x), float(y), 0)["road"]["what"]  # type: ignore[index]
           for x in range(-100, 101, 20) for y in range(-110, 111, 20)}
    assert {"road", "saloon", "suv", "sky", "host vehicle", "ground"} <= met


def test_own_mirror_is_aimed_alike() -> None:
    """At equal aim the same mirror, read from elsewhere, gives the same picture."""
    spec = load_spec("sphere-950")
    shown = road.show(spec, ViewSettings(**SMALL), True, Reflector.from_mirror(design(spec)), silent)
    assert np.abs(decoded(shown.pictures["picture0"]) - decoded(shown.pictures["own0"])).mean() < 0.5


@pytest.mark.parametrize(("look", "words"), [
    ({"eye_x_m": -2.0}, "ahead of the mirror"), ({"eye_x_m": -0.54, "eye_y_m": -1.01, "eye_z_m": 1.76}, "inside the mirror")])
def test_an_aim_that_cannot_be_met_says_why(look: dict[str, float], words: str) -> None:
    with pytest.raises(MirrorError, match=words):
        seen(load_spec("progressive-c"), **look)


def test_a_newer_request_ends_a_fine_picture() -> None:
    heard = []

    def stop(step: str, share: float) -> None:
        heard.append(share)
        if share > 0.1:
            raise StoppedError

    with pytest.raises(StoppedError):
        road.show(load_spec("sphere-950"), ViewSettings(view="road", width=640, height=720), True, None, stop)
    assert max(heard) < 0.5


def test_nothing_of_the_road_is_loaded_before_it_is_asked_for() -> None:
    code = ("import sys; from mirror_studio.web import engine, server; from mirror_studio.web.protocol import ViewSettings; "
            "from mirror_cad.spec.file import load_spec; engine.show(load_spec('sphere-950'), ViewSettings()); "
            "print([name for name in sys.modules if name.startswith(('mirror_studio.drive', 'raytrace.scene.lit_world', "
            "'mirror_studio.web.road', 'mirror_studio.scene_file'))])")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "[]\n"


# --- a control for every key ------------------------------------------------------------------------------------------


def keys_of(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Every key of a specification, with dots; those of all laws."""
    for name, info in ((info.alias or name, info) for name, info in model.model_fields.items()):
        if info.annotation is Law:
            for law in registered().values():
                yield from keys_of(law, f"{prefix}{name}.")
            continue
        kinds = [info.annotation, *get_args(info.annotation)]
        kinds += [inner for kind in kinds for inner in get_args(kind)]
        sections = [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)]
        if not sections:
            yield prefix + name
        for section in sections:
            yield from keys_of(section, f"{prefix}{name}.")


# Tables have rows of inputs, and files buttons.
WITHOUT_CONTROL = {f"{law}.{key}" for law in ("horizontal", "vertical") for key in ("x_mm", "curvature_per_mm", "file")}
WITHOUT_CONTROL |= {f"vertical.{key}" for key in ("level_at", "span_mm", "match.sphere_mm", "match.h_fov_deg")}  # refused there
# A wanted view is drawn over the picture; what else it has is the file's.
WITHOUT_CONTROL |= {f"target.{key}" for key in ("projection", "azimuth_deg", "elevation_deg", "x_mm", "y_mm", "eye", "convex",
                                               "file")}
WITHOUT_CONTROL |= {f"target.weight.{key}" for key in ("x_mm", "y_mm", "weight", "file")}
# The panel of rules has what is asked for (tests/test_studio_rules.py); the spherometer's legs are the file's.
WITHOUT_CONTROL |= {f"rules.{key}" for key in (
    "rule", "class", "leg_mm", "reflectance_percent", "reflectance_night_percent")}
WITHOUT_CONTROL |= {f"outline.{key}" for key in ("file", "layer", "join_mm", "loop")}  # how the file is read: its TOML's


def test_every_key_of_a_specification_is_among_the_controls() -> None:
    """Tables have rows of inputs, files have buttons, limits of figures stand under these."""
    held = {re.sub(r"\.[01]$", "", control.key) for group in groups() for control in group.controls}
    others = WITHOUT_CONTROL | {f"limits.{key}" for key in ("h_fov_deg", "v_fov_left_deg", "lane_straightness_percent")}
    found = set(keys_of(MirrorSpec))
    assert {"part.number", "part.hand", "horizontal.match.sphere_mm", "scene.lane.slope"} <= found
    assert found - held - others == set()
    looked = {f"look.{key}" for key in state.as_look(ViewSettings()) if key not in ("view", "eyes")}  # these two have buttons
    assert looked == {key for key in held if key.startswith("look.")}


def test_toml_holds_the_look_and_the_part() -> None:
    uploads = Uploads()
    try:
        held = as_state(load_spec("progressive-c"))
        held["part"] = {"number": "A 123 456 78", "revision": "b", "hand": "right", "title": "Mirror, right"}
        look = ViewSettings(view="road", hand="right", flank_share=0.2, eye_z_m=2.1, width=999)
        text = state.as_toml(state.as_spec(held, uploads), look)
        again, looked = state.read_toml(text, uploads)
        assert again == held
        assert looked == state.as_look(look)
        assert "999" not in text
    finally:
        uploads.close()


# --- on the wire ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def studio() -> Iterator[Studio]:
    with running() as one:
        yield one


@contextlib.contextmanager
def wire(studio: Studio) -> Iterator[ClientConnection]:
    with connect(f"ws://127.0.0.1:{studio.port}/ws", max_size=None, open_timeout=30) as connection:
        yield connection


def asked(kind: str, number: int, fine: bool | None = None, **look: Any) -> str:
    message = {"type": kind, "id": number, "spec": as_state(load_spec("progressive-c")), "look": SMALL | look}
    return json.dumps(message if fine is None else message | {"fine": fine})


def answers(connection: ClientConnection, last: str) -> list[dict[str, Any]]:
    """Messages up to one of a type; names of pictures and arrays under `named`."""
    heard: list[dict[str, Any]] = []
    while not heard or heard[-1]["type"] != last:
        message = connection.recv(timeout=60)
        if isinstance(message, str):
            heard.append(json.loads(message))
        else:
            header, parts = unpack(message)
            heard.append(header | {"named": list(parts)})
    return heard


def test_the_ground_comes_before_the_fine_picture_and_a_newer_design_stops_it(studio: Studio) -> None:
    with wire(studio) as connection:
        connection.send(asked("design", 1, True))
        heard = answers(connection, "shown")
        kinds = [one["type"] for one in heard]
        assert heard[0]["step"] == motorway.READING
        assert kinds.index("early") < kinds.index("shown")
        early = heard[kinds.index("early")]
        assert early["road"]["figures"] == heard[-1]["road"]["figures"]
        assert {"seen_left", "seen_right", "seen_both"} == set(early["named"])
        assert heard[-1]["fine"]
        connection.send(asked("design", 2, True, width=2000, height=2000))
        answers(connection, "early")
        connection.send(asked("design", 3, False))
        heard = answers(connection, "shown")
        assert [one["id"] for one in heard if one["type"] == "stopped"] == [2]
        assert heard[-1]["id"] == 3
        connection.send(json.dumps({"type": "probe", "id": 4, "x": 20.0, "y": -120.0}))
        assert answers(connection, "probed")[-1]["found"]["road"]["what"] == "road"


def test_a_pinned_design_is_shown_beside_the_others(studio: Studio) -> None:
    with wire(studio) as connection:
        connection.send(asked("pinned", 1))
        connection.send(asked("design", 2, False))
        heard = answers(connection, "pinned")
        assert heard[-1]["id"] == 1
        assert heard[-1]["road"]["figures"]["seen_width_m"]
        connection.send(asked("pinned", 3, eye_x_m=-2.0))
        assert "ahead of the mirror" in answers(connection, "unpinned")[-1]["faults"][0]


# --- in the page ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if not CHROMIUM.exists():
        pytest.skip(f"no Chromium at {CHROMIUM}: the page cannot be opened")
    with chromium() as one:
        yield one


@pytest.fixture
def page(browser: Browser, studio: Studio) -> Iterator[Page]:
    """A page that shows the road, finely; nothing may have gone wrong in it."""
    with opened(browser, studio, "#progressive-c&look.view=road") as one:
        settled(one)
        yield one


def test_the_switch_shows_the_road_by_mouse_and_by_key_and_back(page: Page) -> None:
    expect(page.locator("#view-road")).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_test_id("draft")).to_be_hidden()
    assert figure(page, "width-20") == pytest.approx(16.92, abs=0.01)
    assert figure(page, "blind") == pytest.approx(2.54, abs=0.01)
    expect(page.get_by_test_id("aim")).to_contain_text("yaw 14.61°, pitch 3.12°")
    expect(page.locator("#plan-caption")).to_contain_text("Ground seen")
    before = revision(page)
    page.keyboard.press("r")
    revision_after(page, before)
    settled(page)
    expect(page.locator("#view-picture")).to_have_attribute("aria-pressed", "true")
    expect(page.get_by_test_id("width-20")).to_be_hidden()
    expect(page.get_by_test_id("straightness")).to_have_text("40.91")
    address_comes_to(page, "look.view", hold=False)
    page.click("#undo")
    expect(page.locator("#view-road")).to_have_attribute("aria-pressed", "true")


@pytest.mark.parametrize("size", [(1280, 800), (1920, 1080)])
def test_the_road_fits_without_scrolling(size: tuple[int, int], page: Page) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    for selector in ("#driver-view", "#mirror-3d", "#plan", "#figures", "#unpin", "#view-road", "#aim", "[data-testid=blind]"):
        box = page.locator(selector).bounding_box()
        assert box, selector
        assert 0 <= box["x"] <= box["x"] + box["width"] <= size[0] + 0.5, selector
        assert 0 <= box["y"] <= box["y"] + box["height"] <= size[1] + 0.5, selector
    assert page.evaluate("() => [document.documentElement.scrollWidth, document.documentElement.scrollHeight]") == list(size)


def test_a_slider_gives_drafts_and_a_rest_the_fine_picture(page: Page) -> None:
    page.keyboard.press("p")
    width, before = figure(page, "width-20"), revision(page)
    page.get_by_label("Host flank", exact=True).first.focus()
    for _ in range(6):
        page.keyboard.press("ArrowRight")
        page.wait_for_timeout(30)
    expect(page.get_by_test_id("draft")).to_contain_text("Draft", timeout=SOON)
    revision_after(page, before)
    settled(page)
    expect(page.get_by_test_id("draft")).to_be_hidden()
    address_comes_to(page, "look.flank_share=0.18")
    assert figure(page, "width-20") < width  # more of the host vehicle's flank, less of the road
    expect(page.locator("#figures tr.pinned td >> nth=12")).to_have_text(f"{width:.2f}")
    page.keyboard.press("Control+z")
    becomes(page, "look.flank_share", 0.12)


def test_pointer_and_keys_say_what_lies_there_with_both_eyes(page: Page) -> None:
    before = revision(page)
    page.keyboard.press("e")
    revision_after(page, before)
    settled(page)
    box = page.get_by_test_id("driver-view").bounding_box()
    assert box
    page.get_by_test_id("driver-view").hover(position={"x": 0.25 * box["width"], "y": 0.8 * box["height"]})
    said = r"0\.\d+ × 0\.\d+ of flat .* lands on the road at X \d+\.\d\d m behind the eyes, Y \d+\.\d\d m left"
    expect(page.locator("#readout")).to_contain_text(re.compile(said), timeout=SOON)
    page.get_by_test_id("driver-view").focus()
    page.keyboard.press("ArrowUp")
    expect(page.locator("#readout")).to_contain_text(re.compile("X .* m behind"), timeout=SOON)


def test_an_impossible_aim_leaves_the_last_good_view_and_says_why(page: Page) -> None:
    shown = revision(page)
    page.get_by_label("Eyes rearward in m").fill("-3")
    expect(page.get_by_test_id("error")).to_contain_text("ahead of the mirror", timeout=SOON)
    settled(page)
    assert revision(page) == shown
    page.get_by_label("Eyes rearward in m").fill("0.1")
    revision_after(page, shown)
    expect(page.get_by_test_id("error")).to_have_text("")


def test_a_design_pinned_before_the_picture_has_its_road_too(page: Page) -> None:
    page.click("#view-picture")
    settled(page)
    page.keyboard.press("p")
    page.locator('input[name="vertical.left_mm"]').fill("900")
    page.click("#view-road")
    settled(page)
    expect(page.locator("#figures tr.pinned td >> nth=12")).to_have_text("16.92", timeout=SOON)
    assert figure(page, "width-20") == pytest.approx(16.92, abs=0.2)
    expect(page.locator("#plan-caption")).to_contain_text("A")
    page.click("#swap")
    becomes(page, "vertical.left_mm", 1350)
    expect(page.locator("#view-road")).to_have_attribute("aria-pressed", "true")


def test_the_road_is_taken_away_as_a_picture(page: Page, tmp_path: Path) -> None:
    with page.expect_download(timeout=SOON) as download:
        page.click('[data-take="picture"]')
    assert download.value.suggested_filename == "progressive-c-road.png"
    download.value.save_as(tmp_path / "road.png")
    with Image.open(tmp_path / "road.png") as picture:
        assert min(picture.size) > 400


def test_every_key_has_its_input_in_the_page(page: Page) -> None:
    """By the key's name, or for a pair by its parts'; matched laws' and tables' keys have inputs once they are there."""
    names = set(page.evaluate("() => [...document.querySelectorAll('[name]')].map((element) => element.name)"))
    missing = {key for key in keys_of(MirrorSpec) if key not in names and f"{key}.0" not in names} - WITHOUT_CONTROL
    assert missing == set()
    page.locator('details:has(> summary:text-is("Part")) > summary').click()
    page.locator('input[name="part.number"]').fill("B 77")
    page.keyboard.press("Enter")
    page.wait_for_function("() => location.hash.includes('part.number=')", timeout=SOON)
    page.select_option('select[name="part.hand"]', label="right-hand")
    page.wait_for_function("() => location.hash.includes('part.hand=right')", timeout=SOON)
    settled(page)
    expect(page.get_by_test_id("error")).to_have_text("")
    assert math.isfinite(figure(page, "h-fov"))


STEPS_OF_A_HAND = """async (count) => {
  const view = document.querySelector('[data-testid=driver-view]');
  const slider = document.querySelector('input[name="horizontal.left_mm"]');
  const revision = () => Number(view.dataset.revision), times = [];
  for (let i = 0; i < count; i++) {
    await new Promise((done) => setTimeout(done, 15));
    const before = revision(), begun = performance.now();
    slider.value = 400 + ((37 * i) % 200);
    slider.dispatchEvent(new Event('input', { bubbles: true }));
    await new Promise((done) => { const look = () => (revision() > before ? done() : requestAnimationFrame(look)); look(); });
    times.push(performance.now() - begun);
  }
  times.sort((a, b) => a - b);
  return { median: times[Math.floor(count / 2)], most: times[Math.floor(0.95 * count)] };
}"""


@pytest.mark.long
def test_from_slider_to_draft(page: Page, capsys: pytest.CaptureFixture[str]) -> None:
    page.evaluate(STEPS_OF_A_HAND, 10)
    found = page.evaluate(STEPS_OF_A_HAND, 40)
    with capsys.disabled():
        print("\nfrom slider to draft:", json.dumps(found))
    assert found["median"] <= HAND_MS
