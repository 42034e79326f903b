from setuptools import find_packages, setup

PACKAGE = "iptm_drives"

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
        "matplotlib>=3.8",
        "numpy>=1.24",
        "pandas>=2.1",
        "rosbags>=0.11",
        "scipy>=1.10",
    ],
    extras_require={
        "test": ["pytest"],
        "can": ["asammdf", "cantools", "python-can"],
        "files": ["fitdecode", "openpyxl"],
    },
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Drives as the field writes them: GPX, FCD, CAN, MF4, bags, tables of other programs",
    license="Apache-2.0",
)
