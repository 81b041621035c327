"""Tables and frames of a log, beside the readers that a notebook has."""

from __future__ import annotations

from pathlib import Path
from typing import List

import hydroline
import pytest


def test_libraries_take_a_table(logs: List[str]) -> None:
    numpy = pytest.importorskip("numpy")
    log = hydroline.read(logs[0])
    motion = log.motion
    assert len(motion) == log.counts["/vehicle/motion"] > 100
    pyarrow = pytest.importorskip("pyarrow")
    table = pyarrow.table(motion)
    assert table.column_names == motion.column_names and table.num_rows == len(motion)
    # No copy: two consumers see the same memory.
    address = [pyarrow.table(motion)["x_m"].chunk(0).buffers()[1].address for _ in range(2)]
    assert address[0] == address[1]
    assert numpy.array_equal(table["x_m"].to_numpy(), motion["x_m"])
    assert pyarrow.record_batch(motion).num_rows == len(motion)
    polars = pytest.importorskip("polars")
    assert polars.DataFrame(log.commands)["thrust_n"].to_list() == log.commands["thrust_n"].tolist()


def test_motion_is_what_another_reader_finds(logs: List[str]) -> None:
    mcap_reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_protobuf.decoder")
    log = hydroline.read(logs[1])
    with open(logs[1], "rb") as file:
        reader = mcap_reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        topics = ["/vehicle/motion", "/thruster/command"]
        found = list(reader.iter_decoded_messages(topics=topics, log_time_order=False))
    x_m = [d.x_m for _, c, _, d in found if c.topic == topics[0]]
    thrust_n = [d.thrust_n for _, c, _, d in found if c.topic == topics[1]]
    assert log.motion["x_m"].tolist() == x_m and log.commands["thrust_n"].tolist() == thrust_n


def test_frames_are_read_when_they_are_asked_for(logs: List[str]) -> None:
    log = hydroline.read(logs[4])
    frames = log.frames
    assert len(frames) == log.counts["/camera/image"] > 10
    assert frames[0].grey.shape == frames[0].shape and frames[0].grey.dtype == "uint8"
    assert frames[-1].timestamp_ns > frames[0].timestamp_ns
    assert [frame.sequence for frame in frames] == list(range(len(frames)))
    with pytest.raises(IndexError, match="from 0"):
        frames[len(frames)]


def test_a_log_that_is_cut_is_read_up_to_there(folder: Path, logs: List[str]) -> None:
    whole = Path(logs[0]).read_bytes()
    cut = folder / "cut.mcap"
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    log = hydroline.read(cut)
    assert log.end_missing and 0 < len(log.motion) < len(hydroline.read(logs[0]).motion)
    assert log.motion["x_m"].tolist() == hydroline.read(logs[0]).motion["x_m"][: len(log.motion)].tolist()


def test_the_head_of_a_log(logs: List[str]) -> None:
    log = hydroline.read(logs[0])
    assert log.rig is not None and log.rig.name == "lshpi" and log.calibration is None
    assert log.session["plan.name"] == "reversals" and log.metadata("nothing") is None
    # A rig out of a log serves like one from a file.
    assert hydroline.identify(logs[0], rig=log.rig).model == "surge"
