"""Foreign clients need their own tools; where a tool is not installed its tests are not collected, and that is said."""

import shutil

TOOLS = {"test_node_opcua.py": ("node", "npm"), "test_milo.py": ("java", "mvn")}
MISSING = {file: [tool for tool in tools if shutil.which(tool) is None] for file, tools in TOOLS.items()}
collect_ignore = [file for file, missing in MISSING.items() if missing]


def pytest_report_header() -> list[str]:
    return [f"interop: {file} needs {' and '.join(missing)}" for file, missing in MISSING.items() if missing]
