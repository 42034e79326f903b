from setuptools import find_packages, setup

PACKAGE = "iptm_its"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "car_following.json"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy>=1.24"],
    extras_require={
        "test": ["pytest"],
        "capture": ["dpkt"],
        "roadside": ["pycrate"],
        "security": ["cryptography"],
    },
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="Sender, signatures, roadside stations, captures, chain of vehicles ahead for the V2X bridge",
    license="Apache-2.0",
    entry_points={
        "console_scripts": ["sender = iptm_core.program:main"],
        "iptm.programs": ["sender = iptm_its.node_sender:main"],
    },
)
