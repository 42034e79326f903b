from setuptools import find_packages, setup

PACKAGE = "iptm_faults"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Faults over ROS 2: an injector of messages, and nodes with faults inside",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "injector = iptm_core.program:main",
            "controller_with_solver_faults = iptm_core.program:main",
            "plant_with_actuator_faults = iptm_core.program:main",
        ],
        "iptm.programs": [
            "injector = iptm_faults.node:main",
            "controller_with_solver_faults = iptm_faults.node_controller:main",
            "plant_with_actuator_faults = iptm_faults.node_plant:main",
        ],
    },
)
