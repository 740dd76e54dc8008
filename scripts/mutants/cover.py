"""Which lines of `mirror_cad` and `raytrace` each test file executes, and its seconds: `.mutants/lines.json`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import coverage
from lab import ROOT, copy_of_project, in_child, pytest_run

# These start servers, browsers, other processes or hours; what they say of the mathematics, others say faster.
LEFT_OUT = {"test_bench", "test_bench_tracing", "test_cad_files", "test_desktop", "test_docstrings", "test_documents",
            "test_drawings", "test_examples", "test_file_fuzz", "test_fuzz_texts", "test_guarded", "test_imports",
            "test_installation", "test_interrupt", "test_pdf", "test_readme", "test_rules_gallery", "test_said",
            "test_same_everywhere", "test_studio_browser", "test_studio_engine", "test_studio_road", "test_studio_wire",
            "test_vehicles"}
TIMEOUT_S = 900.0


def main(names: list[str]) -> None:
    """Run the named test files (all but `LEFT_OUT`), and keep what is known of others."""
    kept = ROOT / ".mutants" / "lines.json"
    kept.parent.mkdir(exist_ok=True)
    found = json.loads(kept.read_text()) if kept.exists() and names else {}
    with copy_of_project() as folder:
        files = names or [path.stem for path in sorted(folder.glob("tests/test_*.py")) if path.stem not in LEFT_OUT]
        for name in files:
            data = folder / f"{name}.coverage"

            def covered(name: str = name, data: Path = data) -> int:
                seen = coverage.Coverage(data_file=str(data), source=["mirror_cad", "raytrace"], concurrency="thread")
                seen.start()
                code = pytest_run([f"tests/{name}.py"])
                seen.stop()
                seen.save()
                return code

            log = folder / "log.txt"
            code, seconds = in_child(covered, TIMEOUT_S, log)
            print(f"{name}: {code}, {seconds:.1f} s", flush=True)
            if code != 0:
                print(log.read_text(errors="replace")[-2000:], flush=True)
                continue
            lines = coverage.CoverageData(basename=str(data))
            lines.read()
            executed = {str(Path(path).relative_to(folder)): sorted(lines.lines(path) or ()) for path in lines.measured_files()}
            found[name] = {"seconds": round(seconds, 1), "lines": executed}
            kept.write_text(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1:])
