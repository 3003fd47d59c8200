"""The project's tasks on a fresh machine: `python3 dev.py demo`, `python3 dev.py test`. Standard library only."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent
BIN = ROOT / ".venv" / ("Scripts" if os.name == "nt" else "bin")
LOCKS = {"requirements.txt": [], "requirements-dev.txt": ["--group", "dev"]}
UV = "uv==0.13.9"
# Set by another environment that this one is started from; they would reach into ours.
NOT_PASSED_ON = ("PYTHONHOME", "PYTHONPATH", "VIRTUAL_ENV", "CONDA_PREFIX", "__PYVENV_LAUNCHER__")


def run(*command: str | Path, **environment: str) -> None:
    """Run a command in the project's folder; leave with its exit status if it fails."""
    inherited = {name: value for name, value in os.environ.items() if name not in NOT_PASSED_ON}
    path = f"{BIN}{os.pathsep}{os.environ.get('PATH', '')}"
    with subprocess.Popen(
        [str(part) for part in command], cwd=ROOT, env={**inherited, "PATH": path, **environment}
    ) as process:
        while True:
            try:
                status = process.wait()
                break
            except KeyboardInterrupt:  # the command was interrupted too, and ends in its own way
                continue
    if status:
        sys.exit(status if status > 0 else 128 - status)


def python_with_pip() -> str:
    """Return a Python that has pip: this one, or the one this one's environment was made from."""
    for python in dict.fromkeys((sys.executable, getattr(sys, "_base_executable", sys.executable))):
        if subprocess.run([python, "-m", "pip", "--version"], capture_output=True, check=False).returncode == 0:
            return python
    sys.exit(
        "pip is missing: install it (on Debian: apt-get install python3-pip) or put uv on the PATH, then try again"
    )


def uv() -> list[str]:
    """Find uv, or install it beside the project: a plain `pip install` is refused on Debian 12."""
    if found := shutil.which("uv"):
        return [found]
    tools = ROOT / ".tools"
    if not (tools / "bin" / "uv").exists():
        run(python_with_pip(), "-m", "pip", "install", "--quiet", "--target", tools, UV, PIP_ROOT_USER_ACTION="ignore")
    return [str(tools / "bin" / "uv")]


def setup() -> None:
    """Make `.venv` hold exactly what the lock names, and the project itself."""
    stamp, lock = (
        ROOT / ".venv" / "lock",
        (ROOT / "requirements-dev.txt").read_text() + (ROOT / "pyproject.toml").read_text(),
    )
    if stamp.exists() and stamp.read_text() == lock:
        return
    print("setting up .venv from the lock", file=sys.stderr)
    if not (BIN / "python").exists():
        run(*uv(), "venv", "--quiet", "--python", "3.11", ".venv")
    environment = {"VIRTUAL_ENV": str(ROOT / ".venv")}
    sync = ("pip", "sync", "--quiet", "--compile-bytecode", "--require-hashes", "requirements-dev.txt")
    run(*uv(), *sync, **environment)
    run(*uv(), "pip", "install", "--quiet", "--no-deps", "--editable", ".", **environment)
    stamp.write_text(lock)


def install_test_tools() -> None:
    """Install what the tests need beside Python, where that is allowed: as root on Debian.

    Elsewhere the tests that need it are left out, which pytest says in its last lines.
    """
    tables = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["test-tools"]
    missing = sorted({tool for tools in tables["needs"].values() for tool in tools if not shutil.which(tool)})
    packages = sorted({package for tool in missing for package in tables["debian"][tool]})
    if not packages or not shutil.which("apt-get") or os.geteuid() != 0:
        return
    print(f"installing {' '.join(packages)} for the tests", file=sys.stderr)
    quiet = {"DEBIAN_FRONTEND": "noninteractive"}
    run("apt-get", "update", "-qq", **quiet)
    run("apt-get", "install", "-y", "-qq", "-o", "Dpkg::Use-Pty=0", "--no-install-recommends", *packages, **quiet)


def test(*options: str) -> None:
    """Run the tests. A file stays on one worker: its tests share a server. tests/conftest.py says which files begin."""
    install_test_tools()
    run(BIN / "pytest", "--numprocesses=3", "--dist=loadfile", "--no-loadscope-reorder", *options)


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
    "test": test,
    "check": check,
    "docs": lambda: run(BIN / "python", "docs/build.py"),
    "bench": lambda *rest: run(BIN / "opcua-skill", "bench", *rest),
    "lock": lock,
}

if __name__ == "__main__":
    task, rest = (sys.argv[1:2] or ["help"])[0], sys.argv[2:]
    if task not in TASKS:
        sys.exit(f"usage: python3 dev.py {' | '.join(TASKS)} [options of the task]")
    try:
        if task != "lock":
            setup()
        TASKS[task](*rest)
    except KeyboardInterrupt:
        sys.exit(130)
