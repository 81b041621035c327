"""A simulated run as other people's instruments would have written it.

    vehicle.py KIND RUN.csv OUT       KIND: table bag dataflash; RUN.csv from `hydroline export --merged`

table:     a towing tank's camera system: tab-separated, two lines of head, mm and degrees, the load beside it
bag:       a ROS 2 bag: nav_msgs/Odometry (x ahead, y port, z up), one std_msgs/Float64 of surge load
dataflash: an ArduPilot log: XKF1 (place, angles), RCOU (pulses of four horizontal thrusters)
"""
import csv
import math
import os
import struct
import sys
import tomllib

sys.path.insert(0, os.path.dirname(__file__))
import make


def rows(path):
    for row in csv.DictReader(open(path)):
        yield {k: float(v) for k, v in row.items() if v}


def table(run, out):
    with open(out, "w") as file:
        print("Towing tank, camera system\tFrequency\t25", file=file)
        print("Time\tX\tY\tZ\tRoll\tPitch\tYaw\tThrust", file=file)
        print("s\tmm\tmm\tmm\tdeg\tdeg\tdeg\tN", file=file)
        for r in rows(run):
            own = [r["t_s"], *(1000 * r[k] for k in ("x_m", "y_m", "z_m")),
                   *(math.degrees(r[k]) for k in ("phi_rad", "theta_rad", "psi_rad")), r.get("surge_n", 0.0)]
            print("\t".join(f"{v:.5f}" for v in own), file=file)


def bag(run, out):
    import numpy
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS2_HUMBLE)
    new = lambda name, *a: store.types[name](*a)
    with Writer(out, version=9, storage_plugin=StoragePlugin.MCAP) as file:
        odom = file.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=store)
        load = file.add_connection("/cmd/surge", "std_msgs/msg/Float64", typestore=store)
        for r in rows(run):
            ns = int(r["timestamp_ns"])
            w, x, y, z = make.quaternion(r["phi_rad"], -r["theta_rad"], -r["psi_rad"])
            pose = new("geometry_msgs/msg/Pose", new("geometry_msgs/msg/Point", r["x_m"], -r["y_m"], -r["z_m"]),
                       new("geometry_msgs/msg/Quaternion", x, y, z, w))
            nothing = new("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
            twist = new("geometry_msgs/msg/Twist", nothing, nothing)
            cov = numpy.zeros(36)
            message = new("nav_msgs/msg/Odometry",
                          new("std_msgs/msg/Header", new("builtin_interfaces/msg/Time", ns // 10**9, ns % 10**9), "odom"), "base_link",
                          new("geometry_msgs/msg/PoseWithCovariance", pose, cov), new("geometry_msgs/msg/TwistWithCovariance", twist, cov))
            file.write(odom, ns + 1_500_000, store.serialize_cdr(message, "nav_msgs/msg/Odometry"))
            file.write(load, ns, store.serialize_cdr(new("std_msgs/msg/Float64", r.get("surge_n", 0.0)), "std_msgs/msg/Float64"))


# BlueROV2's horizontal thrusters in its own order, and our names of them.
CHANNELS = ["h_fore_stbd", "h_fore_port", "h_aft_stbd", "h_aft_port"]


def dataflash(run, out):
    rig = os.path.join(os.path.dirname(__file__), "../../../rigs/lshpi.toml")
    points = sorted((force, pulse) for pulse, force in tomllib.load(open(rig, "rb"))["thrusters"]["curve"])

    def pulse(force):
        for (f0, p0), (f1, p1) in zip(points, points[1:]):
            if f0 < f1 and f0 <= force <= f1:
                return round(p0 + (p1 - p0) * (force - f0) / (f1 - f0))
        return 1500

    pack = lambda kind, *v: b"\xa3\x95" + bytes([kind]) + struct.pack("<" + "".join(make.PACK[c] for c in make.FORMATS[kind][1]), *v)
    size = lambda letters: 3 + struct.calcsize("<" + "".join(make.PACK[c] for c in letters))
    kinds = (128, 10, 11, 12, 21, 23)
    with open(out, "wb") as file:
        for kind in kinds:
            f = make.FORMATS[kind]
            file.write(pack(128, kind, size(f[1]), f[0].encode(), f[1].encode(), f[2].encode()))
        for letter, word in {"s": "s", "d": "deg", "h": "degheading", "n": "m/s", "m": "m", "k": "deg/s", "#": "instance", "Y": "us", "-": ""}.items():
            file.write(pack(10, 0, ord(letter), word.encode()))
        for letter, value in {"-": 0.0, "0": 1.0, "B": 1e-2, "F": 1e-6}.items():
            file.write(pack(11, 0, ord(letter), value))
        for kind in kinds:
            f = make.FORMATS[kind]
            file.write(pack(12, 0, kind, f[3].encode(), f[4].encode()))
        for r in rows(run):
            us = 30_000_000 + int(1e6 * r["t_s"])
            deg = [round(100 * math.degrees(a)) for a in (r["phi_rad"], r["theta_rad"], r["psi_rad"] % (2 * math.pi))]
            file.write(pack(23, us, *(pulse(r.get(f"thrust_{name}_n", 0.0)) for name in CHANNELS)))
            file.write(pack(21, us + 40, 0, *deg, 0.0, 0.0, 0.0, 0.0, r["x_m"], r["y_m"], r["z_m"], 1, 2, 3, 7))


if __name__ == "__main__":
    globals()[sys.argv[1]](sys.argv[2], sys.argv[3])
