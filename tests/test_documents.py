"""The site of the documents: built strictly from this checkout, complete, and sufficient to itself."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from raytrace.measures.registry import registered

HOME = Path(__file__).resolve().parent.parent
# One build for all; workers that run tests beside each other share it.
pytestmark = pytest.mark.xdist_group("documents")
# What a browser fetches by itself when it opens a page; a link that a reader may follow is none of it.
LOADING = {"script": ("src",), "img": ("src", "srcset"), "link": ("href",), "iframe": ("src",), "source": ("src", "srcset"),
           "video": ("src", "poster"), "audio": ("src",), "object": ("data",), "embed": ("src",), "use": ("href", "xlink:href"),
           "image": ("href", "xlink:href"), "form": ("action",)}
ADDRESS = re.compile(r"^\s*(?:[a-z]+:)?//", re.IGNORECASE)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("documents") / "site"
    done = subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)], cwd=HOME,
                          env=os.environ | {"NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


class Loaded(HTMLParser):
    """Every address that a page loads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value for name, value in attrs if name in LOADING.get(tag, ()) and value]


def test_no_page_loads_anything_from_elsewhere(site: Path) -> None:
    """Neither page nor style sheet; the scripts are those of the theme and KaTeX, which fetch nothing that is not asked for."""
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 40
    for page in pages:
        for address in Loaded(page.read_text("utf-8")).addresses:
            assert not ADDRESS.match(address), (page, address)
    for sheet in site.rglob("*.css"):
        for address in re.findall(r"(?:url\(|@import)\s*[\"']?([^\"')\s]+)", sheet.read_text("utf-8")):
            assert not ADDRESS.match(address), (sheet, address)


def test_the_check_of_addresses_sees_one() -> None:
    seen = Loaded('<script src="//a.example/x.js"></script><a href="https://b.example"></a>'
                  '<link href="https://c.example/y.css">').addresses
    assert [address for address in seen if ADDRESS.match(address)] == ["//a.example/x.js", "https://c.example/y.css"]


def test_every_measure_has_its_definition_and_a_drawing(site: Path) -> None:
    page = (site / "measures.html").read_text("utf-8")
    for name, measure in registered().items():
        assert f'src="measures/{name}.svg"' in page, name
        assert (site / "measures" / f"{name}.svg").read_text("utf-8").startswith("<svg"), name
        assert measure.title.split(",")[0] in page, name


def test_no_two_measures_are_drawn_alike(site: Path) -> None:
    """Of those that have a drawing of their own; others have that of their group."""
    sys.path.insert(0, str(HOME))
    from scripts.site.drawings import DRAWINGS

    assert set(DRAWINGS) <= set(registered())
    texts = {re.sub(r'id="[^"]*"|#\w+', "", (site / "measures" / f"{name}.svg").read_text("utf-8")) for name in DRAWINGS}
    assert len(texts) == len(DRAWINGS)


def test_formulas_are_set_as_formulas(site: Path) -> None:
    """As many as the derivations mark; none of them is left as a block of code."""
    for source in (HOME / "docs" / "derivations").glob("*.md"):
        marked = len(re.findall(r"\$\$.*?\$\$", source.read_text("utf-8"), re.DOTALL))
        page = (site / "derivations" / f"{source.stem}.html").read_text("utf-8")
        assert page.count('class="arithmatex"') == marked, source
        unset = re.sub(r"\$\$.*?\$\$", "", source.read_text("utf-8"), flags=re.DOTALL)
        assert not re.search(r"\n\n {4,}.*[=≈]", unset), source
    assert (site / "assets" / "katex" / "katex.min.js").is_file()


def test_every_law_and_section_is_on_the_page_of_the_specification(site: Path) -> None:
    from mirror_cad.laws import registered as laws
    from mirror_cad.spec.schema import MirrorSpec

    page = (site / "specification.html").read_text("utf-8")
    for name in laws():
        assert f'law = "{name}"' in page.replace("&quot;", '"'), name
    for name in MirrorSpec.model_fields:
        if name not in ("name", "schema"):
            assert f"[{name}]" in page, name


def test_python_on_the_pages_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tutorial's script, the sweep, and the law and the measure that are added from a script; the law makes a mirror."""
    from mirror_cad.laws import registered as laws
    from mirror_cad.laws import unregister
    from raytrace.measures.registry import unregister as forget

    monkeypatch.chdir(tmp_path)
    made: dict[str, Any] = {}
    for page in ("tutorial.md", "how-to/scripts.md", "how-to/extend.md"):
        text = (HOME / "docs" / page).read_text("utf-8")
        for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
            names: dict[str, Any] = {}
            exec(compile(block, page, "exec", dont_inherit=True), names)
            made |= {"mirror": names["mirror"]} if "Cosine" in names else {}
    assert (tmp_path / "mirror.step").is_file()
    assert made["mirror"].fit.met
    assert made["mirror"].spec.horizontal.law == "cosine"
    assert "cosine" in laws()
    assert "box_aspect" in registered()
    unregister(laws()["cosine"])
    forget("box_aspect")


@pytest.mark.parametrize("page", ["tutorial.md", "specification.md", *(f"how-to/{page.name}" for page in
                                                                       sorted((HOME / "docs" / "how-to").glob("*.md")))])
def test_toml_on_the_pages_is_accepted(page: str, tmp_path: Path) -> None:
    """Whole specifications as they stand, parts of them with two laws, and scenes."""
    import tomllib

    from mirror_cad.spec.file import validate_spec
    from mirror_studio.scene_file import load_scene

    laws = {name: {"law": "constant", "radius_mm": 1200.0} for name in ("horizontal", "vertical")}
    nodes = [f"{x},{y},{0.2 * x},{0.1 * y},1" for x in (-100, 100) for y in (-150, 150)]
    for name in ("view.csv", "weight.csv"):
        (tmp_path / name).write_text("\n".join(["x_mm,y_mm,azimuth_deg,elevation_deg,weight", *nodes]), encoding="utf-8")
    for block in re.findall(r"```toml\n(.*?)```", (HOME / "docs" / page).read_text("utf-8"), re.DOTALL):
        if "[own_vehicle]" in block:
            (tmp_path / "scene.toml").write_text(block, encoding="utf-8")
            load_scene(tmp_path / "scene.toml")
        else:
            validate_spec({"name": "page", **laws, **tomllib.loads(block)}, "page", tmp_path)


@pytest.mark.long
def test_formulas_are_drawn_in_a_browser_that_has_no_connection(site: Path) -> None:
    """KaTeX sets every one, and the page asks for nothing but files."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path="/usr/bin/chromium", args=["--no-sandbox"])
        page = browser.new_page()
        asked: list[str] = []
        failed: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: failed.append(str(error)))
        for path in sorted((site / "derivations").glob("*.html")):
            page.goto(path.as_uri())
            count = page.locator(".arithmatex").count()
            assert page.locator(".arithmatex .katex").count() == count
            assert page.locator(".katex-error").count() == 0
        browser.close()
    assert not failed
    assert all(address.startswith(("file:", "data:")) for address in asked)
