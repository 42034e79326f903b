from setuptools import find_packages, setup

PACKAGE = "iptm_studies"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "**/*.yaml", "**/*.json", "**/*.j2"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=[
        "setuptools",
        "matplotlib>=3.8",
        "numpy>=1.24",
        "pandas>=2.1",
        "pyarrow>=15",
        "rich>=13",
    ],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    entry_points={
        "console_scripts": ["studies = iptm_core.program:main"],
        "iptm.programs": ["studies = iptm_studies.cli:main"],
    },
    description="Closed loops without ROS, strategy and sensitivity studies of them",
    license="Apache-2.0",
)
