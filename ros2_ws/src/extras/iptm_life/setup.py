from setuptools import find_packages, setup

PACKAGE = "iptm_life"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy>=1.24", "pandas>=2.1"],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Capacity loss over years of use, by cause, climate and pattern of use",
    license="Apache-2.0",
)
