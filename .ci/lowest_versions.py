"""Print the lowest versions that pyproject.toml states, as requirements: ``name==version``."""

import re
import sys
import tomllib
from pathlib import Path

project = tomllib.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))["project"]
for stated in (*project["dependencies"], *project["optional-dependencies"]["test"]):
    requirement, _, marker = stated.partition(";")
    name, lowest = re.fullmatch(r"([\w.-]+)[=>]=([\d.]+?)(?:\.\*)?(?:,.*)?", requirement).groups()
    print(f"{name}=={lowest}" + (f";{marker}" if marker else ""))
