from setuptools import find_packages, setup

PACKAGE = "iptm_core"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: ["py.typed"],
        f"{PACKAGE}.parameters": ["sets/*"],
        f"{PACKAGE}.routes": ["data/*", "data/**/*"],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=[
        "setuptools",
        "numpy>=1.24",
        "casadi>=3.7",
        "jinja2>=3.1",
        "PyYAML>=6.0",
    ],
    extras_require={"test": ["pytest", "hypothesis"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Model, parameters, routes and metrics of the power and thermal management suite",
    license="Apache-2.0",
)
