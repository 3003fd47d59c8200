"""The project's tasks on a fresh machine: `python3 dev.py demo`, `python3 dev.py test`. Standard library only."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent
BIN = ROOT / ".venv" / ("Scripts" if os.name == "nt" else "bin")
LOCKS = {"requirements.txt": [], "requirements-dev.txt": ["--group", "dev"]}


def run(*command: str | Path, **environment: str) -> None:
    """Run a command in the project's folder; leave with its exit status if it fails."""
    path = f"{BIN}{os.pathsep}{os.environ.get('PATH', '')}"
    done = subprocess.run([str(part) for part in command], cwd=ROOT, env={**os.environ, "PATH": path, **environment})
    if done.returncode:
        sys.exit(done.returncode)


def uv() -> list[str]:
    """Find uv, or install it beside the project: a plain `pip install` is refused on Debian 12."""
    if found := shutil.which("uv"):
        return [found]
    tools = ROOT / ".tools"
    if not (tools / "bin" / "uv").exists():
        run(sys.executable, "-m", "pip", "install", "--quiet", "--target", tools, "uv==0.13.9")
    return [str(tools / "bin" / "uv")]


def setup() -> None:
    """Make `.venv` hold exactly what the lock names, and the project itself."""
    stamp, lock = (
        ROOT / ".venv" / "lock",
        (ROOT / "requirements-dev.txt").read_text() + (ROOT / "pyproject.toml").read_text(),
    )
    if stamp.exists() and stamp.read_text() == lock:
        return
    if not (BIN / "python").exists():
        run(*uv(), "venv", "--quiet", "--python", "3.11", ".venv")
    environment = {"VIRTUAL_ENV": str(ROOT / ".venv")}
    run(*uv(), "pip", "sync", "--compile-bytecode", "--require-hashes", "requirements-dev.txt", **environment)
    run(*uv(), "pip", "install", "--quiet", "--no-deps", "--editable", ".", **environment)
    stamp.write_text(lock)


def lock() -> None:
    """Write the lock: exact versions and hashes for every platform, and no address of any package host."""
    for name, group in LOCKS.items():
        options = ["--universal", "--generate-hashes", "--no-emit-index-url", "--no-emit-find-links", "--no-header"]
        run(
            *uv(),
            "pip",
            "compile",
            "--quiet",
            *options,
            "--python-version",
            "3.11",
            "pyproject.toml",
            *group,
            "-o",
            name,
        )


def check() -> None:
    """Lint, format, import rules, types."""
    run(BIN / "ruff", "check", ".")
    run(BIN / "ruff", "format", "--check", ".")
    run(BIN / "lint-imports", "--no-cache")
    run(BIN / "pyright")


TASKS = {
    "setup": lambda: None,
    "demo": lambda *rest: run(BIN / "opcua-skill", "demo", *rest),
    # A file stays on one worker: its tests share a server. tests/conftest.py says which files begin.
    "test": lambda *rest: run(BIN / "pytest", "--numprocesses=3", "--dist=loadfile", "--no-loadscope-reorder", *rest),
    "check": check,
    "docs": lambda: run(BIN / "python", "docs/build.py"),
    "bench": lambda *rest: run(BIN / "opcua-skill", "bench", *rest),
    "lock": lock,
}

if __name__ == "__main__":
    task, rest = (sys.argv[1:2] or ["help"])[0], sys.argv[2:]
    if task not in TASKS:
        sys.exit(f"usage: python3 dev.py {' | '.join(TASKS)} [options of the task]")
    if task != "lock":
        setup()
    TASKS[task](*rest)
