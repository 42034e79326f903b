from setuptools import find_packages, setup

PACKAGE = "iptm_vehicle_interface"

setup(
    name=PACKAGE,
    version="0.3.0",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed", "vehicles/*/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
    ],
    install_requires=["setuptools", "numpy>=1.24", "rich>=13.0"],
    extras_require={"test": ["pytest"], "can": ["cantools", "msgpack", "python-can"]},
    python_requires=">=3.10",
    zip_safe=False,
    maintainer="iptm maintainers",
    maintainer_email="maintainers@iptm.example.org",
    description="A car on a CAN bus: signals, engagement, inner loop, last safety layer, bench car",
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "bench = iptm_core.program:main",
            "bench_car = iptm_core.program:main",
            "gateway = iptm_core.program:main",
            "vehicle_interface = iptm_core.program:main",
        ],
        "iptm.programs": [
            "bench = iptm_vehicle_interface.node_bench:main",
            "bench_car = iptm_vehicle_interface.bench_car_process:main",
            "gateway = iptm_vehicle_interface.gateway:main",
            "vehicle_interface = iptm_vehicle_interface.node:main",
        ],
    },
)
