from setuptools import find_packages, setup

PACKAGE = "iptm"

setup(
    name=PACKAGE,
    version="0.1.0",
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
        "rich>=13",
    ],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    entry_points={
        "console_scripts": ["compare = iptm_core.program:main"],
        "iptm.programs": ["compare = iptm.compare_cli:main"],
    },
    description="The suite as a library for notebooks and scripts",
    license="Apache-2.0",
)
