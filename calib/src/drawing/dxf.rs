//! DXF R12 (AC1009) in ASCII: what every mill and laser cutter reads. Units are mm
//! (R12 has no unit of its own; $MEASUREMENT 1 and the 100 mm line say so).

use std::fmt::Write;

use super::{Shape, Sheet};

/// The sheet as DXF R12.
pub fn write(sheet: &Sheet) -> String {
    let mut out = String::new();
    let mut put = |code: i32, value: &str| {
        let _ = writeln!(out, "{code:>3}\n{value}");
    };
    put(999, &ascii(&sheet.title));
    put(0, "SECTION");
    put(2, "HEADER");
    put(9, "$ACADVER");
    put(1, "AC1009");
    put(9, "$MEASUREMENT");
    put(70, "1");
    put(0, "ENDSEC");
    put(0, "SECTION");
    put(2, "TABLES");
    put(0, "TABLE");
    put(2, "LAYER");
    put(70, "5");
    for (name, colour) in [
        ("CUT", "7"),
        ("MARK", "3"),
        ("LIGHT", "2"),
        ("BLOCK", "5"),
        ("NOTE", "1"),
    ] {
        put(0, "LAYER");
        put(2, name);
        put(70, "0");
        put(62, colour);
        put(6, "CONTINUOUS");
    }
    put(0, "ENDTAB");
    put(0, "ENDSEC");
    put(0, "SECTION");
    put(2, "ENTITIES");
    let mm = |v: f64| format!("{:.4}", if v.abs() < 5e-5 { 0.0 } else { v });
    for shape in &sheet.shapes {
        match shape {
            Shape::Polygon(layer, points) => {
                put(0, "POLYLINE");
                put(8, layer.name());
                put(66, "1");
                put(10, "0.0");
                put(20, "0.0");
                put(70, "1");
                for p in points {
                    put(0, "VERTEX");
                    put(8, layer.name());
                    put(10, &mm(p[0]));
                    put(20, &mm(p[1]));
                }
                put(0, "SEQEND");
                put(8, layer.name());
            }
            Shape::Circle(layer, at, diameter) => {
                put(0, "CIRCLE");
                put(8, layer.name());
                put(10, &mm(at[0]));
                put(20, &mm(at[1]));
                put(40, &mm(0.5 * diameter));
            }
            Shape::Line(layer, a, b) => {
                put(0, "LINE");
                put(8, layer.name());
                put(10, &mm(a[0]));
                put(20, &mm(a[1]));
                put(11, &mm(b[0]));
                put(21, &mm(b[1]));
            }
            Shape::Text(at, height, words) => {
                put(0, "TEXT");
                put(8, "NOTE");
                put(10, &mm(at[0]));
                put(20, &mm(at[1]));
                put(40, &mm(*height));
                put(1, &ascii(words));
            }
        }
    }
    put(0, "ENDSEC");
    put(0, "EOF");
    out
}

/// R12 knows ASCII only, and a value ends with its line.
fn ascii(text: &str) -> String {
    text.chars()
        .map(|c| {
            if c.is_ascii() && !c.is_ascii_control() {
                c
            } else {
                '?'
            }
        })
        .collect()
}
