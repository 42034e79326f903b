"""What the packages of the workspace have in common; the setup.py of each names the rest.

Name, version, description, license and maintainer of a package are those of its package.xml.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from xml.etree import ElementTree as ET

import setuptools

OLDEST = {
    "asn1tools": "0.166",
    "casadi": "3.6.5",
    "cma": "4.0",
    "jinja2": "3.1",
    "matplotlib": "3.8",
    "mcap": "1.6",
    "numpy": "1.24",
    "pandas": "2.1",
    "pyarrow": "15",
    "pyyaml": "6.0",
    "rich": "13",
    "rosbags": "0.11",
    "scipy": "1.10",
    "zstandard": "0.20",
}
"""Oldest version of each library that a package may require."""


def declare(
    *libraries: str,
    programs: Mapping[str, str] = MappingProxyType({}),
    extras: Mapping[str, list[str]] = MappingProxyType({}),
    shared: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Set up the package in the current folder.

    Args:
        libraries: that it requires, of `OLDEST`.
        programs: function that each executable runs, as ``module:function``.
        extras: requirements of optional features; "test" are added to those of the tests.
        shared: pattern of the files to install in each folder below the share folder of the package.
    """
    manifest = ET.parse("package.xml").getroot()  # noqa: S314  our own file
    package = manifest.findtext("name", "")
    (maintainer,) = manifest.findall("maintainer")
    data = [
        path
        for path in Path(package).rglob("*")
        if path.is_file() and path.suffix not in {".py", ".pyc"}
    ]
    setuptools.setup(
        name=package,
        version=manifest.findtext("version"),
        description=manifest.findtext("description"),
        license=manifest.findtext("license"),
        maintainer=maintainer.text,
        maintainer_email=maintainer.get("email"),
        packages=setuptools.find_packages(include=[package, f"{package}.*"]),
        package_data={package: sorted(str(path.relative_to(package)) for path in data)},
        data_files=[
            ("share/ament_index/resource_index/packages", [f"resource/{package}"]),
            (f"share/{package}", ["package.xml"]),
            *(
                (f"share/{package}/{folder}", sorted(map(str, Path().glob(pattern))))
                for folder, pattern in shared.items()
            ),
        ],
        install_requires=["setuptools", *(f"{name}>={OLDEST[name]}" for name in libraries)],
        extras_require={**extras, "test": ["pytest", *extras.get("test", [])]},
        python_requires=">=3.10",
        zip_safe=False,
        entry_points={
            "console_scripts": [f"{name} = iptm_core.program:main" for name in programs],
            "iptm.programs": [f"{name} = {function}" for name, function in programs.items()],
        },
    )
