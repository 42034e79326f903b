from setuptools import find_packages, setup

PACKAGE = "iptm_string"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", ["launch/string.launch.py"]),
    ],
    install_requires=["setuptools", "matplotlib>=3.8", "numpy>=1.24", "pandas>=2.1", "rich>=13"],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Strings of vehicles, each following the one ahead: drive, record, report",
    license="Apache-2.0",
)
