from setuptools import find_packages, setup

PACKAGE = "iptm_bags"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=[
        "setuptools",
        "mcap>=1.6",
        "numpy>=1.24",
        "pandas>=2.1",
        "pyarrow>=15",
        "PyYAML>=6.0",
        "rich>=13.0",
        "rosbags>=0.11",
    ],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Tools for recorded bags: list, compare, export, replay, check, recover",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["player = iptm_core.program:main"],
        "iptm.programs": ["player = iptm_bags.player_cli:main"],
    },
)
