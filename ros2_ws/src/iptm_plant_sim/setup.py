from setuptools import find_packages, setup

PACKAGE = "iptm_plant_sim"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "c/*.c", "c/*.h"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy>=1.24", "casadi>=3.7"],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Simulated vehicle with battery, aging and cooling loop",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["plant = iptm_core.program:main"],
        "iptm.programs": ["plant = iptm_plant_sim.node:main"],
    },
)
