from setuptools import find_packages, setup

PACKAGE = "iptm_ros"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "data/*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=[
        "setuptools",
        "numpy>=1.24",
        "PyYAML>=6.0",
        "zstandard>=0.20",
        "lz4>=4.1",
        "mcap>=1.6",
        "pyarrow>=15",
        "rosbags>=0.11",
    ],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Topic table, message codecs, node support, and bags",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "call = iptm_core.program:main",
            "recorder = iptm_core.program:main",
        ],
        "iptm.programs": [
            "call = iptm_ros.call:main",
            "recorder = iptm_ros.recording.recorder_cli:main",
        ],
    },
)
