from setuptools import find_packages, setup

PACKAGE = "iptm_plan"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools", "matplotlib>=3.8", "numpy>=1.24", "rich>=13"],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Plan of the day: when to charge, how far, the price of a kelvin at departure and arrival",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["planner = iptm_core.program:main"],
        "iptm.programs": ["planner = iptm_plan.node:main"],
    },
)
