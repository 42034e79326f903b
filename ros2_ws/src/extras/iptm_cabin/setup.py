from setuptools import find_packages, setup

PACKAGE = "iptm_cabin"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "cycle_maps.json", "cars/*.cabin"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools", "casadi>=3.7", "numpy>=1.24", "pandas>=2.0"],
    # CoolProp, see requirements/cabin.txt: only to fit the maps of refrigerants again.
    extras_require={"test": ["pytest"], "fit": ["coolprop>=8.0"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Cabin, heat pump, radiator and pack on one compressor",
    license="Apache-2.0",
)
