#!/usr/bin/env python3
"""Writes src/import/recorded/mavlink.tsv from pymavlink's ardupilotmega dialect (which includes common).

One message per line: id, name, CRC extra, and its fields in the order of the wire as
name:type:elements:unit. Which messages there are is a fact about the protocol (mavlink.io); nothing else is taken over.
    pip install pymavlink && python3 src/import/generate/mavlink.py > src/import/recorded/mavlink.tsv
"""
import os
os.environ["MAVLINK20"] = "1"
from pymavlink.dialects.v20 import ardupilotmega as dialect

SHORT = {"uint8_t": "u8", "int8_t": "i8", "char": "c", "uint16_t": "u16", "int16_t": "i16", "uint32_t": "u32",
         "int32_t": "i32", "float": "f32", "uint64_t": "u64", "int64_t": "i64", "double": "f64"}
for number, message in sorted(dialect.mavlink_map.items()):
    types = dict(zip(message.fieldnames, message.fieldtypes))
    fields = []
    for name, elements in zip(message.ordered_fieldnames, message.array_lengths):
        unit = message.fieldunits_by_name.get(name, "")
        fields.append(f"{name}:{SHORT[types[name]]}:{elements}:{unit}")
    print(number, message.msgname, message.crc_extra, *fields, sep="\t")
