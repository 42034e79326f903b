from setuptools import find_packages, setup

PACKAGE = "iptm_fmi"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "c/*.c", "c/*.h"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools", "casadi>=3.7", "numpy>=1.24"],
    # FMPy, see requirements/fmi.txt: the headers of FMI, and what loads an FMU.
    extras_require={"test": ["pytest"], "fmi": ["fmpy>=0.3.32"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Plant, controller and meter as FMUs, and a foreign FMU as the vehicle",
    license="Apache-2.0",
)
