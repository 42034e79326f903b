from setuptools import find_packages, setup

PACKAGE = "iptm_view"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: ["py.typed", "page/*", "layouts/*.json", "layouts/*.xml", "layouts/*.rviz"]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy>=1.24", "PyYAML>=6.0", "rosbags>=0.11"],
    # Loaded only where it is used; the page works without.
    extras_require={
        "test": ["pytest"],
        "foxglove": ["foxglove-sdk>=0.30"],
    },
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="A live view of a run or a bag in the browser, and layouts for other viewers",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["visualize = iptm_core.program:main"],
        "iptm.programs": ["visualize = iptm_view.visualizer_node:main"],
    },
)
