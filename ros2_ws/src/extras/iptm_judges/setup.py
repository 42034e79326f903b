from setuptools import find_packages, setup

PACKAGE = "iptm_judges"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy>=1.24", "rich>=13"],
    # Loaded only where they are asked for, see requirements/judges.in.
    extras_require={"test": ["pytest"], "judges": ["blast-lite>=1.1.1", "pybamm>=26.10"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Ageing of a run by the laws of many cells",
    license="Apache-2.0",
)
