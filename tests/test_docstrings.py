"""The list of files whose docstrings do not follow the numpy convention yet holds no file that does."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

HOME = Path(__file__).parents[1]
MAX_FILES = 10  # lower it with the list


def test_the_list_of_files_without_numpy_docstrings_only_becomes_shorter() -> None:
    lint = tomllib.loads((HOME / "pyproject.toml").read_text("utf-8"))["tool"]["ruff"]["lint"]
    assert "D" in lint["select"]
    listed = {file for file, rules in lint["per-file-ignores"].items() if "D" in rules and "/" in file and "*" not in file}
    assert len(listed) <= MAX_FILES
    assert not [file for file in listed if not (HOME / file).is_file()]
    found = subprocess.run(
        [sys.executable, "-m", "ruff", "check", "--isolated", "--select", "D", "--ignore", ",".join(
            rule for rule in lint["ignore"] if rule.startswith("D")), "--config", 'lint.pydocstyle.convention = "numpy"',
         "--output-format", "json", *sorted(listed)], cwd=HOME, capture_output=True, text=True, check=False)
    amiss = {str(Path(one["filename"]).relative_to(HOME)) for one in json.loads(found.stdout)}
    assert listed - amiss == set(), "these follow the convention: take them off the list"
