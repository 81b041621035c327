"""Logs as other programs write them, and every number in them as those programs' own readers have it.

    make.py DIR [KIND ...]      KIND: ros2 ros1 dataflash telemetry ulog foxglove;
                            recorded: the bags (.mcap) of the folder $HYDROLINE_BAGS, copied

Writes DIR/NAME and DIR/NAME.jsonl, one line per message: topic, stamp and log time [ns], fields by their paths.
"""
import dataclasses
import json
import math
import os
import random
import struct
import sys

N = 150
random.seed(39)


def pose(t):
    return (0.2 * t + 0.05 * math.sin(t), 0.1 * math.sin(0.3 * t), -0.8 + 0.02 * math.cos(t),
            0.05 * math.sin(1.1 * t), 0.03 * math.cos(0.9 * t), 0.6 * math.sin(0.2 * t))


def motion(k):
    """A vehicle that surges and turns, SI, z down: time, place, angles, velocity in the tank and in the body, rates."""
    t, h = 0.05 * k, 1e-5
    own = pose(t)
    dot = [(a - b) / (2 * h) for a, b in zip(pose(t + h), pose(t - h))]
    (phi, theta, psi), tank = own[3:], dot[:3]
    cf, sf, ct, st, cp, sp = (f(a) for a in (phi, theta, psi) for f in (math.cos, math.sin))
    turn = [[cp * ct, cp * st * sf - sp * cf, cp * st * cf + sp * sf],
            [sp * ct, sp * st * sf + cp * cf, sp * st * cf - cp * sf], [-st, ct * sf, ct * cf]]
    body = [sum(turn[i][j] * tank[i] for i in range(3)) for j in range(3)]
    rates = [dot[3] - st * dot[5], cf * dot[4] + sf * ct * dot[5], -sf * dot[4] + cf * ct * dot[5]]
    return t, own[:3], own[3:], tank, body, rates


def quaternion(roll, pitch, yaw):
    cr, sr, cp, sp, cy, sy = (f(a / 2) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return (cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy)


class Expected:
    def __init__(self, path):
        self.file = open(path + ".jsonl", "w")

    def add(self, topic, stamp, log, fields):
        # As text: readers of JSON round.
        own = {path: repr(value) for path, value in fields.items()}
        print(json.dumps({"topic": topic, "stamp_ns": stamp, "log_ns": log, "fields": own}), file=self.file)


def flat(value, path, out):
    import numpy
    if dataclasses.is_dataclass(value):
        for f in dataclasses.fields(value):
            if f.name != "__msgtype__":
                flat(getattr(value, f.name), f"{path}.{f.name}" if path else f.name, out)
    elif isinstance(value, (list, tuple, numpy.ndarray)):
        for i, v in enumerate(value):
            flat(v, f"{path}[{i}]", out)
    elif isinstance(value, (bool, numpy.bool_)):
        out[path] = int(value)
    elif isinstance(value, (int, numpy.integer)):
        out[path] = int(value)
    elif isinstance(value, (float, numpy.floating)):
        out[path] = float(value)


def ros2(folder):
    import numpy
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, Writer, StoragePlugin
    from rosbags.typesys import Stores, get_typestore
    from mcap.writer import CompressionType, Writer as McapWriter
    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = store.types
    new = lambda name, *a, **k: kinds[name](*a, **k)

    def header(ns, frame):
        stamp = new("builtin_interfaces/msg/Time", ns // 10**9, ns % 10**9)
        return new("std_msgs/msg/Header", stamp, frame)

    vector = lambda *v: new("geometry_msgs/msg/Vector3", *v)
    point = lambda *v: new("geometry_msgs/msg/Point", *v)

    def quat(rpy):
        w, x, y, z = quaternion(rpy[0], -rpy[1], -rpy[2])
        return new("geometry_msgs/msg/Quaternion", x, y, z, w)

    messages = []
    start = 1_700_000_000 * 10**9
    for k in range(N):
        t, p, rpy, tank, body, rates = motion(k)
        ns = start + int(t * 1e9) + random.randrange(1000)
        late = ns + random.randrange(200_000, 4_000_000)
        pose = new("geometry_msgs/msg/Pose", point(p[0], -p[1], -p[2]), quat(rpy))
        twist = new("geometry_msgs/msg/Twist", vector(body[0], -body[1], -body[2]), vector(rates[0], -rates[1], -rates[2]))
        cov = numpy.arange(36, dtype=numpy.float64) * 1e-5
        with_cov = new("geometry_msgs/msg/PoseWithCovariance", pose, cov)
        messages += [
            ("/odom", "nav_msgs/msg/Odometry", late, new("nav_msgs/msg/Odometry", header(ns, "tank"), "base_link", with_cov,
                                                         new("geometry_msgs/msg/TwistWithCovariance", twist, cov))),
            ("/pose", "geometry_msgs/msg/PoseStamped", late, new("geometry_msgs/msg/PoseStamped", header(ns, "tank"), pose)),
            ("/pose_cov", "geometry_msgs/msg/PoseWithCovarianceStamped", late,
             new("geometry_msgs/msg/PoseWithCovarianceStamped", header(ns, "tank"), with_cov)),
            ("/twist", "geometry_msgs/msg/TwistStamped", late, new("geometry_msgs/msg/TwistStamped", header(ns, "base_link"), twist)),
            ("/imu", "sensor_msgs/msg/Imu", late, new("sensor_msgs/msg/Imu", header(ns, "imu"), quat(rpy), numpy.zeros(9),
                                                      vector(rates[0], -rates[1], -rates[2]), numpy.zeros(9), vector(0.0, 0.0, 9.81), numpy.zeros(9))),
            ("/tf", "tf2_msgs/msg/TFMessage", late, new("tf2_msgs/msg/TFMessage", [
                new("geometry_msgs/msg/TransformStamped", header(ns, "tank"), child,
                    new("geometry_msgs/msg/Transform", vector(p[0] + i, -p[1], -p[2]), quat(rpy)))
                for i, child in enumerate(["base_link", "dock"])])),
            ("/cmd/surge", "std_msgs/msg/Float64", late, new("std_msgs/msg/Float64", 3.0 + (k // 40))),
            ("/thrusters", "std_msgs/msg/Float64MultiArray", late, new(
                "std_msgs/msg/Float64MultiArray", new("std_msgs/msg/MultiArrayLayout", [], 0), numpy.array([0.1 * k, -0.1 * k]))),
            ("/words", "std_msgs/msg/String", late, new("std_msgs/msg/String", "hello")),
            # Two bodies; the second drops out.
            ("/markers", "geometry_msgs/msg/PoseArray", late, new("geometry_msgs/msg/PoseArray", header(ns, "tank"), [
                new("geometry_msgs/msg/Pose", point(p[0] + 10 * i, -p[1], -p[2]), quat([a + 0.2 * i for a in rpy]))
                for i in range(2 if k % 10 else 1)])),
        ]
    messages.sort(key=lambda m: m[2])

    def expect(path, typed):
        own = Expected(path)
        for topic, schema, log, message in typed:
            fields = {}
            flat(message, "", fields)
            if schema == "tf2_msgs/msg/TFMessage":
                for i, tr in enumerate(message.transforms):
                    lead = f"transforms[{i}]."
                    stamp = tr.header.stamp
                    own.add(f"{topic}[{tr.child_frame_id}]", stamp.sec * 10**9 + stamp.nanosec, log,
                            {p.removeprefix(lead): v for p, v in fields.items() if p.startswith(lead)})
                continue
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            own.add(topic, stamp and stamp.sec * 10**9 + stamp.nanosec, log, fields)

    def write_bag(name, plugin, version, packed=False):
        path = os.path.join(folder, name)
        writer = Writer(path, version=version, storage_plugin=plugin)
        if packed:
            writer.set_compression(CompressionMode.FILE, CompressionFormat.ZSTD)
        with writer as bag:
            open_ = {}
            for topic, schema, log, message in messages:
                if topic not in open_:
                    open_[topic] = bag.add_connection(topic, schema, typestore=store)
                bag.write(open_[topic], log, store.serialize_cdr(message, schema))
        with Reader(path) as bag:
            expect(path, [(c.topic, c.msgtype, log, store.deserialize_cdr(raw, c.msgtype)) for c, log, raw in bag.messages()])

    write_bag("bag_db3", StoragePlugin.SQLITE3, 9)
    write_bag("bag_db3_old", StoragePlugin.SQLITE3, 8)
    write_bag("bag_mcap", StoragePlugin.MCAP, 9)
    write_bag("bag_packed", StoragePlugin.SQLITE3, 9, packed=True)
    for name, kind in [("none", CompressionType.NONE), ("lz4", CompressionType.LZ4), ("zstd", CompressionType.ZSTD)]:
        path = os.path.join(folder, f"{name}.mcap")
        with open(path, "wb") as file:
            log_file = McapWriter(file, compression=kind, chunk_size=20_000)
            log_file.start(profile="ros2")
            channels = {}
            for topic, schema, log, message in messages:
                if topic not in channels:
                    text, _ = store.generate_msgdef(schema, ros_version=2)
                    number = log_file.register_schema(schema, "ros2msg", text.encode())
                    channels[topic] = log_file.register_channel(topic, "cdr", number)
                log_file.add_message(channels[topic], log, bytes(store.serialize_cdr(message, schema)), log)
            log_file.finish()
        expect(path, messages)


def ros1(folder):
    """A bag of ROS 1, the same as rosbags-convert makes of it, and one as `mcap convert` does."""
    import pathlib
    import subprocess
    from mcap.writer import Writer as McapWriter
    from rosbags.rosbag1 import Reader, Writer
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS1_NOETIC)
    new = lambda name, *a: store.types[name](*a)
    bag, name = pathlib.Path(folder, "old.bag"), "geometry_msgs/msg/PoseStamped"
    with Writer(bag) as writer:
        connection = writer.add_connection("/pose", name, typestore=store)
        for k in range(N):
            t, p, rpy, _, _, _ = motion(k)
            ns = 1_700_000_000 * 10**9 + int(t * 1e9)
            stamp = new("builtin_interfaces/msg/Time", ns // 10**9, ns % 10**9)
            w, x, y, z = quaternion(rpy[0], -rpy[1], -rpy[2])
            pose = new("geometry_msgs/msg/Pose", new("geometry_msgs/msg/Point", p[0], -p[1], -p[2]),
                       new("geometry_msgs/msg/Quaternion", x, y, z, w))
            message = new(name, new("std_msgs/msg/Header", k, stamp, "tank"), pose)
            writer.write(connection, ns + 1000, store.serialize_ros1(message, name))
    with Reader(bag) as reader, open(os.path.join(folder, "old.mcap"), "wb") as file:
        log_file = McapWriter(file)
        log_file.start(profile="ros1")
        for connection in reader.connections:
            schema = log_file.register_schema("geometry_msgs/PoseStamped", "ros1msg", connection.msgdef.data.encode())
            channel = log_file.register_channel(connection.topic, "ros1", schema)
        for _, log, raw in reader.messages():
            log_file.add_message(channel, log, bytes(raw), log)
        log_file.finish()
    convert = os.path.join(os.path.dirname(sys.executable), "rosbags-convert")
    subprocess.run([convert, "--src", str(bag), "--dst", os.path.join(folder, "converted")], check=True)


def recorded(folder):
    """Bags of others as rosbags reads them; those that it cannot read are named and left out."""
    import pathlib
    import shutil
    from rosbags.highlevel import AnyReader, AnyReaderError
    for bag in sorted(pathlib.Path(os.environ["HYDROLINE_BAGS"]).glob("*.mcap")):
        path = os.path.join(folder, bag.name)
        try:
            with AnyReader([bag]) as reader:
                own = Expected(path)
                for connection, log, raw in reader.messages():
                    message = reader.deserialize(raw, connection.msgtype)
                    fields = {}
                    flat(message, "", fields)
                    # Capitals are a type's constants, which no message holds.
                    fields = {path: v for path, v in fields.items() if not path.split(".")[-1].isupper()}
                    stamp = getattr(getattr(message, "header", None), "stamp", None)
                    own.add(connection.topic, stamp and stamp.sec * 10**9 + stamp.nanosec, log, fields)
        except AnyReaderError as error:
            print(f"{bag.name}: rosbags cannot read it: {str(error)[:200]}", file=sys.stderr)
            continue
        own.file.close()
        shutil.copyfile(bag, path)


def foxglove(folder):
    """Protobuf and JSON with their schemas in the file."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from mcap.writer import Writer as McapWriter
    stamp = descriptor_pb2.FileDescriptorProto(name="google/protobuf/timestamp.proto", package="google.protobuf", syntax="proto3")
    m = stamp.message_type.add(name="Timestamp")
    m.field.add(name="seconds", number=1, type=3, label=1)
    m.field.add(name="nanos", number=2, type=5, label=1)
    fox = descriptor_pb2.FileDescriptorProto(name="foxglove.proto", package="foxglove", syntax="proto3",
                                             dependency=["google/protobuf/timestamp.proto"])
    for name, axes in [("Vector3", "xyz"), ("Quaternion", "xyzw")]:
        m = fox.message_type.add(name=name)
        for i, axis in enumerate(axes):
            m.field.add(name=axis, number=i + 1, type=1, label=1)
    m = fox.message_type.add(name="Pose")
    m.field.add(name="position", number=1, type=11, type_name=".foxglove.Vector3", label=1)
    m.field.add(name="orientation", number=2, type=11, type_name=".foxglove.Quaternion", label=1)
    m = fox.message_type.add(name="PoseInFrame")
    m.field.add(name="timestamp", number=1, type=11, type_name=".google.protobuf.Timestamp", label=1)
    m.field.add(name="frame_id", number=2, type=9, label=1)
    m.field.add(name="pose", number=3, type=11, type_name=".foxglove.Pose", label=1)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(stamp)
    pool.Add(fox)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName("foxglove.PoseInFrame"))
    both = descriptor_pb2.FileDescriptorSet(file=[stamp, fox]).SerializeToString()
    path = os.path.join(folder, "foxglove.mcap")
    own = Expected(path)
    with open(path, "wb") as file:
        log_file = McapWriter(file)
        log_file.start()
        pose = log_file.register_channel("/pose", "protobuf", log_file.register_schema("foxglove.PoseInFrame", "protobuf", both))
        load = log_file.register_channel("/cmd/surge", "json", log_file.register_schema("Load", "jsonschema", b'{"type":"object"}'))
        for k in range(N):
            t, p, rpy, tank, body, rates = motion(k)
            ns = 1_700_000_000 * 10**9 + int(t * 1e9)
            w, x, y, z = quaternion(*rpy)
            message = kind(frame_id="tank")
            message.timestamp.seconds, message.timestamp.nanos = ns // 10**9, ns % 10**9
            for axis, v in zip("xyz", p):
                setattr(message.pose.position, axis, v)
            for axis, v in zip("xyzw", (x, y, z, w)):
                setattr(message.pose.orientation, axis, v)
            log_file.add_message(pose, ns + 1000, message.SerializeToString(), ns)
            own.add("/pose", ns, ns + 1000, {
                "timestamp.seconds": ns // 10**9, "timestamp.nanos": ns % 10**9,
                **{f"pose.position.{a}": v for a, v in zip("xyz", p)},
                **{f"pose.orientation.{a}": v for a, v in zip("xyzw", (x, y, z, w))}})
            value = {"timestamp": {"sec": ns // 10**9, "nsec": ns % 10**9}, "data": 3.5 + k, "list": [k, 0.1 * k]}
            log_file.add_message(load, ns + 2000, json.dumps(value).encode(), ns)
            own.add("/cmd/surge", ns, ns + 2000, {
                "timestamp.sec": ns // 10**9, "timestamp.nsec": ns % 10**9, "data": 3.5 + k, "list[0]": k, "list[1]": 0.1 * k})
        log_file.finish()


FORMATS = {  # type: (name, letters, labels, units, multipliers)
    128: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", "-b---", "-----"),
    10: ("UNIT", "QbZ", "TimeUS,Id,Label", "s--", "F--"),
    11: ("MULT", "Qbd", "TimeUS,Id,Mult", "s--", "F--"),
    12: ("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", "s---", "F---"),
    20: ("ATT", "QccccCCccB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF", "sddddhhdh-", "FBBBBBBBB-"),
    21: ("XKF1", "QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH", "s#ddhnnnnmmmkkkm", "F-BBB0000000BBBB"),
    22: ("IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz", "s#EEEooo--O--zz", "F-000000-----00"),
    23: ("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4", "sYYYY", "F----"),
    24: ("TST", "QqhHiLdZg" , "TimeUS,A,B,C,D,Lat,E,Word,H", "s-----D--"[:9], "F--------"),
}
PACK = {"b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d", "n": "4s", "N": "16s", "Z": "64s",
        "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "q": "q", "Q": "Q", "g": "e"}


def dataflash(folder):
    from pymavlink import DFReader
    pack = lambda kind, *values: b"\xa3\x95" + bytes([kind]) + struct.pack("<" + "".join(PACK[c] for c in FORMATS[kind][1]), *values)
    size = lambda letters: 3 + struct.calcsize("<" + "".join(PACK[c] for c in letters))
    records = [pack(128, kind, size(f[1]), f[0].encode(), f[1].encode(), f[2].encode()) for kind, f in FORMATS.items()]
    units = {"s": "s", "d": "deg", "h": "degheading", "n": "m/s", "m": "m", "k": "deg/s", "E": "rad/s", "o": "m/s/s", "#": "instance",
             "Y": "us", "O": "degC", "z": "Hz", "-": "", "b": "B"}
    for letter, word in units.items():
        records.append(pack(10, 0, ord(letter), word.encode()))
    for letter, value in {"-": 0.0, "0": 1.0, "B": 1e-2, "F": 1e-6}.items():
        records.append(pack(11, 0, ord(letter), value))
    for kind, f in FORMATS.items():
        records.append(pack(12, 0, kind, f[3].encode(), f[4].encode()))
    # IMU at 100 Hz, the others at 20 Hz.
    for k in range(5 * N):
        t, p, (roll, pitch, yaw), tank, body, rates = motion(k / 5)
        us = 61_000_000 + 10_000 * k
        deg = [round(100 * math.degrees(a)) for a in (roll, pitch, yaw % (2 * math.pi))]
        records.append(pack(22, us + 3, 0, *rates, 0.1, 0.2, -9.8, 0, 0, 31.5, 1, 1, 1000, 1000))
        if k % 5 == 0:
            records.append(pack(20, us, 0, deg[0], 0, deg[1], 0, deg[2], 1, 2, 3))
            for core in (0, 1):
                records.append(pack(21, us + 1, core, *deg, *tank, 0.0,
                                    p[0] + core, p[1], p[2], 1, 2, 3, 7))
            records.append(pack(23, us + 2, 1500 + 10 * (k % 7), 1500, 1400 + k % 3, 1600))
            records.append(pack(24, us + 4, -2**40 - k, -3, 65000, -70000, 473977419, 1 / 3, b"word", 0.333))
    for name, damaged in [("clean.bin", False), ("damaged.bin", True)]:
        path = os.path.join(folder, name)
        with open(path, "wb") as file:
            for i, record in enumerate(records):
                if damaged and i in (300, 700):
                    # What a card leaves: bytes of nothing, and the end of a record that is lost.
                    file.write(bytes(37) + record[-11:])
                    continue
                file.write(record)
            if damaged:
                file.write(records[-1][:9])
        own = Expected(path)
        reader = DFReader.DFReader_binary(path)
        instances = {}
        while (message := reader.recv_msg()) is not None:
            name_ = message.get_type()
            if name_ in ("FMT", "UNIT", "MULT", "FMTU"):
                continue
            fields = {f: getattr(message, f) for f in message.get_fieldnames()}
            instance = {"XKF1": "C", "IMU": "I"}.get(name_)
            topic = f"{name_}[{fields[instance]}]" if instance else name_
            us = fields["TimeUS"]
            own.add(topic, us * 1000, us * 1000, {f: v for f, v in fields.items() if not isinstance(v, str)})


def telemetry(folder):
    os.environ["MAVLINK20"] = "1"
    from pymavlink import mavutil
    from pymavlink.dialects.v20 import ardupilotmega as dialect
    packets = []
    for system in (1, 255):
        mav = dialect.MAVLink(None, srcSystem=system, srcComponent=1 if system == 1 else 190)
        for k in range(N):
            t, p, (roll, pitch, yaw), tank, body, rates = motion(k)
            ms = 61_000 + 50 * k
            us = 1_700_000_000_000_000 + 50_000 * k + system
            send = lambda m: packets.append((us, m.pack(mav)))
            if system == 255:
                send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
                continue
            send(dialect.MAVLink_attitude_message(ms, roll, pitch, yaw, *rates))
            send(dialect.MAVLink_local_position_ned_message(ms, *p, *tank))
            send(dialect.MAVLink_servo_output_raw_message(ms * 1000, 0, *[1500 + k] * 16))
            send(dialect.MAVLink_vfr_hud_message(0.5, 0.6, k, 40, 1.5, 0.0))
            send(dialect.MAVLink_odometry_message(us, 1, 12, *p, list(quaternion(roll, pitch, yaw)), *body, *rates,
                                                  [0.1 * i for i in range(21)], [0.0] * 21, 0, 1))
    old = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    for k in range(N, N + 20):
        _, p, angles, tank, _, rates = motion(k)
        us = 1_700_000_000_000_000 + 50_000 * k
        ms = 61_000 + 50 * k
        packets.append((us, dialect.MAVLink_attitude_message(ms, *angles, *rates).pack(old, force_mavlink1=True)))
        packets.append((us, dialect.MAVLink_local_position_ned_message(ms, *p, *tank).pack(old, force_mavlink1=True)))
    packets.sort(key=lambda p: p[0])
    for name, damaged in [("clean.tlog", False), ("damaged.tlog", True)]:
        path = os.path.join(folder, name)
        with open(path, "wb") as file:
            for i, (us, data) in enumerate(packets):
                data = bytearray(data)
                if damaged and i == 200:
                    data[15] ^= 0x40
                if damaged and i == 400:
                    file.write(b"\x00\x11\x22" * 5)
                file.write(struct.pack(">Q", us) + data)
        # The damage that is known is left out: pymavlink reads the sound packets.
        own = Expected(path)
        sound = os.path.join(folder, "sound")
        with open(sound, "wb") as file:
            for i, (us, data) in enumerate(packets):
                if not (damaged and i == 200):
                    file.write(struct.pack(">Q", us) + data)
        reader = mavutil.mavlink_connection(sound, dialect="ardupilotmega")
        while (message := reader.recv_msg()) is not None:
            name_ = message.get_type()
            assert name_ != "BAD_DATA"
            if name_ == "HEARTBEAT":
                continue
            fields = {}
            for f in message.get_fieldnames():
                v = getattr(message, f)
                if isinstance(v, list):
                    fields.update({f"{f}[{i}]": x for i, x in enumerate(v)})
                elif not isinstance(v, str):
                    fields[f] = v
            # Stamps of packets are whole microseconds; the reader has them as a float.
            log = round(message._timestamp * 1e6) * 1000
            stamp = fields["time_boot_ms"] * 10**6 if "time_boot_ms" in fields else None
            own.add(name_, stamp, log, {f: v for f, v in fields.items() if not (isinstance(v, float) and math.isnan(v))})
        os.remove(sound)


def ulog(folder):
    import numpy
    from pyulog import ULog
    record = lambda kind, body: struct.pack("<HB", len(body), ord(kind)) + body
    formats = [
        "vehicle_local_position:uint64_t timestamp;float x;float y;float z;float vx;float vy;float vz;bool xy_valid;uint8_t[7] _padding0;",
        "vehicle_attitude:uint64_t timestamp;uint64_t timestamp_sample;float[4] q;uint8_t quat_reset_counter;uint8_t[7] _padding0;",
        "inner:uint16_t id;float[2] pair;",
        "outer:uint64_t timestamp;inner[2] each;inner one;int8_t last;",
    ]
    head = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000)
    definitions = record("B", bytes(40)) + record("I", bytes([len(b"char[3] sys")]) + b"char[3] sys" + b"PX4")
    definitions += b"".join(record("F", f.encode()) for f in formats)
    subscribed = [(0, 0, "vehicle_local_position"), (1, 0, "vehicle_attitude"), (2, 1, "vehicle_attitude"), (3, 0, "outer")]
    definitions += b"".join(record("A", struct.pack("<BH", multi, number) + name.encode()) for number, multi, name in subscribed)
    sync = record("S", bytes([0x2f, 0x73, 0x13, 0x20, 0x25, 0x0c, 0xbb, 0x12]))
    data = []
    for k in range(N):
        t, p, rpy, tank, body, rates = motion(k)
        us = 61_000_000 + 50_000 * k
        data.append(record("D", struct.pack("<HQffffffB", 0, us, *p, *tank, 1)))
        for number in (1, 2):
            data.append(record("D", struct.pack("<HQQffffB", number, us + number, us, *quaternion(*rpy), 0)))
        data.append(record("D", struct.pack("<HQHffHffHffb", 3, us + 9, 1, 0.5, k, 2, 1.5, -k, 3, 2.5, 0.1 * k, -7)))
        if k % 25 == 0:
            data.append(sync)
        if k == 60:
            data.append(record("O", struct.pack("<H", 12)))
    for name, damaged in [("clean.ulg", False), ("damaged.ulg", True)]:
        path = os.path.join(folder, name)
        good = os.path.join(folder, "good")
        with open(path, "wb") as file, open(good, "wb") as sound:
            for f in (file, sound):
                f.write(head + definitions)
            for i, d in enumerate(data):
                if damaged and i == 90:
                    file.write(b"\xff\x77\x00garbage" + d[:20])
                    continue
                file.write(d)
                sound.write(d)
        own = Expected(path)
        for d in ULog(good).data_list:
            topic = d.name if d.multi_id == 0 else f"{d.name}[{d.multi_id}]"
            for i in range(len(d.data["timestamp"])):
                us = int(d.data["timestamp"][i])
                fields = {f: (float(v[i]) if numpy.issubdtype(v.dtype, numpy.floating) else int(v[i])) for f, v in d.data.items()}
                own.add(topic, us * 1000, us * 1000, fields)
        os.remove(good)


if __name__ == "__main__":
    target, kinds = sys.argv[1], sys.argv[2:] or ["ros2", "foxglove", "dataflash", "telemetry", "ulog"]
    os.makedirs(target, exist_ok=True)
    for kind in kinds:
        globals()[kind](target)
