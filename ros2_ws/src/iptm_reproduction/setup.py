from setuptools import find_packages, setup

PACKAGE = "iptm_reproduction"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "**/*.j2", "**/*.yaml", "**/*.csv"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=[
        "setuptools",
        "cma>=4.0",
        "jinja2>=3.1",
        "matplotlib>=3.8",
        "numpy>=1.24",
        "pandas>=2.1",
        "PyYAML>=6.0",
        "rich>=13",
    ],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    entry_points={
        "console_scripts": [
            "identify = iptm_core.program:main",
            "reproduce = iptm_core.program:main",
        ],
        "iptm.programs": [
            "identify = iptm_reproduction.identification.cli:main",
            "reproduce = iptm_reproduction.cli:main",
        ],
    },
    description="The paper's results compared with this project's: statements, tables, figures, one page",
    license="Apache-2.0",
)
