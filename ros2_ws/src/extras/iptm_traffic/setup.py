from setuptools import find_packages, setup

PACKAGE = "iptm_traffic"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "corridor/*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy>=1.24", "rich>=13"],
    # SUMO is an extra: eclipse-sumo and traci, see requirements/traffic.txt.
    extras_require={"test": ["pytest"], "traffic": ["eclipse-sumo>=1.20", "traci>=1.20"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    entry_points={
        "console_scripts": ["traffic = iptm_core.program:main"],
        "iptm.programs": ["traffic = iptm_traffic.cli:main"],
    },
    description="The ego vehicle in simulated traffic (SUMO), in lock-step with its plant",
    license="Apache-2.0",
)
