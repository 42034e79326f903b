from setuptools import find_packages, setup

PACKAGE = "iptm_interfaces"

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "data/*.xml"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy>=1.24", "rosbags>=0.11"],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Topic table, message codecs and node support of the power and thermal suite",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "call = iptm_core.program:main",
            "param = iptm_core.program:main",
        ],
        "iptm.programs": [
            "call = iptm_interfaces.call:main",
            "param = iptm_interfaces.param:main",
        ],
    },
)
