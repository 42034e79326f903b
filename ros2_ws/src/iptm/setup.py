from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "iptm"


def files(folder: str, pattern: str) -> list[str]:
    """The files of a folder, in a fixed order."""
    return sorted(str(path) for path in Path(folder).glob(pattern))


setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "**/*.yaml", "**/*.json", "**/*.j2"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", files("launch", "*.launch.py")),
        # The launch files look for them here, as every ROS 2 package does.
        (f"share/{PACKAGE}/config/nodes", files(f"{PACKAGE}/runner/config/nodes", "*.yaml")),
        (f"share/{PACKAGE}/config", files(f"{PACKAGE}/runner/config", "*.yaml")),
        (f"share/{PACKAGE}/trips", files(f"{PACKAGE}/trips", "*.yaml")),
    ],
    install_requires=[
        "setuptools",
        "matplotlib>=3.8",
        "numpy>=1.24",
        "pandas>=2.1",
        "PyYAML>=6.0",
        "rich>=13",
    ],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    entry_points={
        "console_scripts": [
            "iptm = iptm_core.program:main",
        ],
        "iptm.programs": [
            "iptm = iptm.commands.tree:main",
        ],
    },
    description="The suite as a library and its runner: scenarios, launch files, faults, studies",
    license="Apache-2.0",
)
