from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "iptm_bringup"


def files(folder: str, pattern: str) -> list[str]:
    """The files of a folder, in a fixed order."""
    return sorted(str(path) for path in Path(folder).glob(pattern))


setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "**/*.yaml", "**/*.j2"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", files("launch", "*.launch.py")),
        # The launch files look for them here, as every ROS 2 package does.
        (f"share/{PACKAGE}/config/nodes", files(f"{PACKAGE}/config/nodes", "*.yaml")),
        (f"share/{PACKAGE}/config", files(f"{PACKAGE}/config", "*.yaml")),
        (f"share/{PACKAGE}/config/scenarios", files(f"{PACKAGE}/config/scenarios", "*.yaml")),
    ],
    install_requires=[
        "setuptools",
        "numpy>=1.24",
        "pandas>=2.1",
        "PyYAML>=6.0",
        "matplotlib>=3.8",
        "rich>=13",
    ],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Launch files, scenarios and the closed-loop runner",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "drive_file = iptm_core.program:main",
            "run_closed_loop = iptm_core.program:main",
            "run_string = iptm_core.program:main",
            "view = iptm_core.program:main",
        ],
        "iptm.programs": [
            "drive_file = iptm_bringup.recorded_drive:main",
            "run_closed_loop = iptm_bringup.run_closed_loop:main",
            "run_string = iptm_bringup.run_string:main",
            "view = iptm_bringup.view:main",
        ],
    },
)
