from setuptools import find_packages, setup

PACKAGE = "iptm_v2x_bridge"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "messages/cam.asn", "prediction/regression.json"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools", "asn1tools>=0.166", "numpy>=1.24"],
    extras_require={"test": ["pytest"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Predicted motion of the leader and slope of the road, with the faults of a link",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "bridge = iptm_core.program:main",
        ],
        "iptm.programs": [
            "bridge = iptm_v2x_bridge.node:main",
        ],
    },
)
