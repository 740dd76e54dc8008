"""What MkDocs is given beside the pages that are written by hand: the measures from their registry, the keys of a
specification from its schema, the examples from their folder."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pydantic import BaseModel
from pydantic.fields import FieldInfo

if TYPE_CHECKING:
    from raytrace.measures.registry import Measure

HOME = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(HOME))

from scripts.site.drawings import drawing  # noqa: E402  from this checkout, wherever it is built from

EXAMPLES = {  # by file: its title; the text is that of its docstring
    "design_to_step.py": "From laws to a STEP file", "deviation_report.py": "Deviation of the curvature",
    "own_outline.py": "An outline of one's own", "own_vehicle.py": "A vehicle of one's own",
    "own_step_traced.py": "Another program's STEP file, traced", "sweep_of_a_radius.py": "A sweep over a radius",
    "both_eyes.py": "Both eyes", "build123d_assembly.py": "Into a build123d assembly",
    "cadquery_handover.py": "Over to cadquery", "made_mirror.py": "A made mirror",
}


FIRST = ("index.md", "decoupled-surface.md", "compatible-pairs.md", "marching-rules.md", "first-hit.md")  # of a folder's pages


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Let a folder in the navigation stand for all of its pages."""
    for entry in config.nav or ():
        for title, pages in entry.items():
            if isinstance(pages, str) and pages.endswith("/"):
                names = sorted((path.name for path in (Path(config.docs_dir) / pages).glob("*.md")),
                               key=lambda name: (FIRST.index(name) if name in FIRST else len(FIRST), name))
                entry[title] = [pages + name for name in names]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages and drawings that are generated."""
    made = {"measures.md": measures_page(), "specification.md": specification_page(), "examples.md": examples_page(),
            "decisions/index.md": decisions_page(Path(config.docs_dir) / "decisions")}
    for name, group in measure_names():
        made[f"measures/{name}.svg"] = drawing(name, group)
    for name, text in made.items():
        template = files.get_file_from_path(name)
        if template is not None:
            text = template.content_string.replace("<!-- generated -->", text)
            files.remove(template)
        files.append(File.generated(config, name, content=text))
    return files


SUBSCRIPTS = (
    (re.compile(r"(?<![\w.])([^\W\d_]|∂[^\W\d_])_(?:\{([^}]+)\}|([^\W_]+))"), lambda m: f"{m[1]}<sub>{m[2] or m[3]}</sub>"),
    (re.compile(r"(?<![\w.])([Wegkr]|κ)(\d{1,2})(?![\d.])"), lambda m: f"{m[1]}<sub>{m[2]}</sub>"),
    (re.compile(r"κ([12])"), lambda m: f"κ<sub>{m[1]}</sub>"),
    (re.compile(r"(?<!\w)R([xy])(?![a-z])"), lambda m: f"R<sub>{m[1]}</sub>"),
    (re.compile(r"\^\(([^)]+)\)"), lambda m: f"<sup>{m[1]}</sup>"),
)
AS_IT_IS = re.compile(r"(\$\$.*?\$\$|```.*?```|`[^`]*`|\]\([^)]*\)|<!--.*?-->|^#.*?$)", re.DOTALL | re.MULTILINE)


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Set the indices of the derivations' running text low, and their links and formulas as they are."""
    if not page.file.src_uri.startswith("derivations/"):
        return markdown
    pieces = AS_IT_IS.split(markdown)
    for k in range(0, len(pieces), 2):
        for pattern, set_low in SUBSCRIPTS:
            pieces[k] = pattern.sub(set_low, pieces[k])
    names = {path.name for path in (Path(config.docs_dir) / "derivations").glob("*.md")}

    def link(found: re.Match[str]) -> str:
        return f"[{found[1].removesuffix('.md')}]({found[1]})" if found[1] in names else found[0]

    return re.sub(r"`([\w-]+\.md)`", link, "".join(pieces))


# ---- measures

def all_measures() -> Iterable[Measure]:
    """Every measure: the registered ones, and those that a scene such as `motorway` asks for at its distances."""
    from raytrace.measures.asked import Asked, Face, NearLane
    from raytrace.measures.in_use import MirrorInUse, OnVehicle
    from raytrace.measures.registry import measures_of

    asked = Asked(NearLane(-5250.0, -1750.0), -5250.0, Face(1800.0, 1450.0, -3500.0), distances=(20_000.0,),
                  column=(30_000.0, -12_000.0, 8000.0), widths_at=(20_000.0,), direct_view=1.6, hidden_height=800.0)
    # Only names and definitions are asked for: what would be measured need not be there.
    return measures_of(MirrorInUse(None, None, vehicle=OnVehicle(None, None, None, None, asked))).values()


def measure_names() -> list[tuple[str, str]]:
    return [(one.name, one.group) for one in all_measures()]


def measures_page() -> str:
    from raytrace.measures.registry import GROUPS, registered

    named, text = registered(), []
    for group in GROUPS:
        those = [one for one in all_measures() if one.group == group]
        text += [f"## {group}\n"] * bool(those)
        for one in those:
            better = {"more": "more of it serves the driver", "less": "less of it serves the driver", None: ""}[one.better]
            taken = {"setup": "the mirror alone, eye and lane as in [eye] and [scene]", "vehicle": "the mirror on its vehicle"}
            asked = "" if one.name in named else "One for each distance or height that the scene asks about. "
            module = getattr(one.value, "__module__", "")
            code = f" Code: `{module}`." if module.startswith("raytrace") else ""
            text.append(
                f"### `{one.name}`\n\n"
                f'<div class="measure" markdown>\n\n![{_plain(one.title)}](measures/{one.name}.svg)\n\n'
                f"**{_plain(one.title)}**{f', {one.unit}' if one.unit else ''}\n\n"
                f"{_sentence(_plain(one.definition))}\n\n{asked}Taken of {taken[one.scope]}"
                f"{f'; {better}' if better else ''}.{code}\n\n</div>\n")
    return "\n".join(text)


def _plain(text: str) -> str:
    """Text in which Markdown finds no table, no emphasis and no formula."""
    return text.replace("|", "&#124;").replace("*", "\\*").replace("_", "\\_")


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


# ---- the specification

def specification_page() -> str:
    from mirror_cad.laws import registered
    from mirror_cad.spec.schema import MirrorSpec

    text = []
    for name, info in MirrorSpec.model_fields.items():
        section = _model(info)
        if name in ("horizontal", "vertical"):
            continue
        if section is not None:
            text.append(f"## `[{name}]`\n\n{_first_paragraph(section)}\n\n{_keys(section)}")
    laws = ["## `[horizontal]` and `[vertical]`\n\nBoth take a law, named by the key `law`, with the keys of that law. Keys "
            "marked (horizontal) stand in `[horizontal]` alone.\n"]
    for name, law in registered().items():
        laws.append(f'### `law = "{name}"`\n\n{_first_paragraph(law)}\n\n{_keys(law, law.horizontal_only)}')
    return "\n".join([*laws, *text])


def _model(info: FieldInfo) -> type[BaseModel] | None:
    for kind in (info.annotation, *get_args(info.annotation)):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
    return None


def _first_paragraph(kind: type[BaseModel]) -> str:
    return " ".join(line.strip() for line in (kind.__doc__ or "").strip().split("\n\n")[0].splitlines()).replace("|", "&#124;")


def _keys(kind: type[BaseModel], horizontal_only: frozenset[str] = frozenset()) -> str:
    rows = ["| key | default | values | |", "|---|---|---|---|"]
    said = {key: text for base in reversed(kind.__mro__) for key, text in _attributes(base.__doc__ or "").items()}
    own_first = sorted(kind.model_fields.items(), key=lambda one: one[0] in horizontal_only)
    for key, info in own_first:
        if key == "law":
            continue
        inner = _model(info)
        known = "" if inner or info.default in (None, ()) else f"`{_toml(info.default)}`"
        default = "required" if info.is_required() else known
        shown = next((one for one in info.metadata if type(one).__name__ == "Shown"), None)
        title = getattr(shown, "label", "").replace("{axis}", "radius")
        what = said.get(key, title)
        remark = " ".join([what] * bool(what) + ["(horizontal)"] * (key in horizontal_only))
        rows.append(f"| `{info.alias or key}` | {default} | {_range(info)} | {remark} |")
    return "\n".join(rows) + "\n"


def _attributes(docstring: str) -> dict[str, str]:
    """What a docstring's section of attributes says of each key."""
    section = re.search(r"\n *(?:Attributes|Parameters)\n *-+\n(.*?)(?:\n *\n|\Z)", docstring, re.DOTALL)
    found: dict[str, str] = {}
    entry = re.compile(r"^ {4}(\w[\w, ]*) : [^\n]*\n((?: {8}[^\n]*\n?)+)", re.MULTILINE)
    for names, text in entry.findall(section[1] if section else ""):
        plain = " ".join(text.split()).replace("|", "&#124;")
        found |= dict.fromkeys(names.split(", "), plain)
    return found


def _toml(value: object) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(one) for one in value) + "]"
    return f'"{value}"' if isinstance(value, str) else str(value).lower() if isinstance(value, bool) else f"{value}"


def _range(info: FieldInfo) -> str:
    signs = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
    found = [f"{sign} {limit:g}" for one in _constraints(info) for name, sign in signs.items()
             if isinstance(limit := getattr(one, name, None), int | float)]
    words = [str(one) for one in get_args(info.annotation) if isinstance(one, str)]
    return ", ".join(found or [f"`{word}`" for word in words])


def _constraints(info: FieldInfo) -> list[object]:
    found: list[object] = []
    for one in info.metadata:
        found += getattr(one, "metadata", [one])
    return found


# ---- decisions and examples

def decisions_page(folder: Path) -> str:
    titles = {path.name: path.read_text("utf-8").split("\n", 1)[0].removeprefix("# ") for path in sorted(folder.glob("0*.md"))}
    return "\n".join(f"* [{title}]({name})" for name, title in titles.items())


def examples_page() -> str:
    text = []
    for name, title in EXAMPLES.items():
        source = (HOME / "examples" / name).read_text("utf-8")
        said, code = re.match(r'"""(.*?)"""\n+(.*)', source, re.DOTALL).groups()
        picture = next((HOME / "docs" / "pictures").glob(f"{Path(name).stem}.*")).name
        text.append(f"## {title}\n\n{' '.join(said.split())}\n\n![{title}](pictures/{picture})\n\n"
                    f"`examples/{name}`:\n\n```python\n{code.rstrip()}\n```\n")
    return "\n".join(text)
