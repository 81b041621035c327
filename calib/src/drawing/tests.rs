use super::*;
use hydroline_rigs::{GaugeBlock, Slab};

fn board(pattern: BoardPattern) -> Board {
    Board {
        name: "wc <50> & co".into(),
        pattern,
        columns: 11,
        rows: 9,
        pitch_m: 0.05,
        margin_m: 0.025,
        thickness_m: 0.006,
        blocks: vec![GaugeBlock {
            centre_m: [-0.175, -0.125],
            size_m: [0.03, 0.02],
            height_m: 0.01,
        }],
    }
}

fn hexagons() -> Target {
    Target {
        name: "hexagons".into(),
        slabs: vec![
            Slab {
                name: "board".into(),
                outline: SlabOutline::Rectangle {
                    x0_m: 0.0,
                    x1_m: 6.0 * 3f64.sqrt() * 0.12,
                    width_m: 0.3,
                },
                top_m: 0.02,
                albedo: 1.0,
            },
            Slab {
                name: "hexagons".into(),
                outline: SlabOutline::HexagonChain {
                    x0_m: 0.0,
                    side_m: 0.12,
                    count: 6,
                },
                top_m: 0.04,
                albedo: 1.0,
            },
        ],
        origin: [0.0; 3],
    }
}

/// Entities of a DXF, by an own reader of group codes.
fn read_dxf(text: &str) -> Vec<(String, String, Vec<[f64; 2]>, f64)> {
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len() % 2, 0, "code and value in pairs");
    let mut found: Vec<(String, String, Vec<[f64; 2]>, f64)> = Vec::new();
    let mut entities = false;
    for pair in lines.chunks(2) {
        let code: i32 = pair[0].trim().parse().unwrap();
        let value = pair[1];
        match code {
            2 if value == "ENTITIES" => entities = true,
            0 if entities && value != "VERTEX" && value != "SEQEND" => {
                found.push((value.into(), String::new(), Vec::new(), 0.0));
            }
            _ if !entities || found.is_empty() => {}
            8 => found.last_mut().unwrap().1 = value.into(),
            10 | 11 => found
                .last_mut()
                .unwrap()
                .2
                .push([value.parse().unwrap(), 0.0]),
            20 | 21 => found.last_mut().unwrap().2.last_mut().unwrap()[1] = value.parse().unwrap(),
            40 => found.last_mut().unwrap().3 = value.parse().unwrap(),
            _ => {}
        }
    }
    for entity in &mut found {
        if entity.0 == "POLYLINE" {
            entity.2.remove(0); // the polyline's own dummy point
        }
    }
    found
}

/// All numbers of an attribute of the elements of one class.
fn attribute(svg: &str, element: &str, class: &str, name: &str) -> Vec<Vec<f64>> {
    svg.lines()
        .filter(|l| l.starts_with(&format!("<{element} class=\"{class}\"")))
        .map(|l| {
            let from = l.find(&format!(" {name}=\"")).unwrap() + name.len() + 3;
            l[from..from + l[from..].find('"').unwrap()]
                .split([',', ' '])
                .map(|v| v.parse().unwrap())
                .collect()
        })
        .collect()
}

fn extent(points: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|k| {
        let v: Vec<f64> = points.iter().map(|p| p[k]).collect();
        v.iter().copied().fold(f64::MIN, f64::max) - v.iter().copied().fold(f64::MAX, f64::min)
    })
}

#[test]
fn dots_read_back_at_true_scale() {
    let b = board(BoardPattern::Dots { diameter_m: 0.015 });
    let sheet = board_sheet(&b);
    let dxf = read_dxf(&dxf::write(&sheet));
    let dots: Vec<_> = dxf
        .iter()
        .filter(|e| e.0 == "CIRCLE" && (e.3 - 7.5).abs() < 1e-6)
        .collect();
    assert_eq!(dots.len(), 99);
    // Pitch 50 mm, and node (0, 0) at the lower RIGHT as the camera sees it.
    let (first, second) = (dots[0].2[0], dots[1].2[0]);
    assert!(
        (first[0] - second[0] - 50.0).abs() < 1e-3,
        "{first:?} {second:?}"
    );
    let plate = dxf
        .iter()
        .find(|e| e.0 == "POLYLINE" && e.1 == "CUT")
        .unwrap();
    let size = extent(&plate.2);
    assert!((size[0] - 550.0).abs() < 1e-3 && (size[1] - 450.0).abs() < 1e-3);
    let block = dxf.iter().find(|e| e.1 == "BLOCK").unwrap();
    let size = extent(&block.2);
    assert!((size[0] - 30.0).abs() < 1e-3 && (size[1] - 20.0).abs() < 1e-3);
    // Block centre against the middle of the plate: ξ −175 mm is to the right.
    let middle =
        |e: &[[f64; 2]]| [0, 1].map(|k| e.iter().map(|p| p[k]).sum::<f64>() / e.len() as f64);
    let (p, q) = (middle(&plate.2), middle(&block.2));
    assert!((q[0] - p[0] - 175.0).abs() < 1e-3 && (q[1] - p[1] + 125.0).abs() < 1e-3);

    let svg = svg::write(&sheet);
    // One unit is one millimetre, or nothing below means anything.
    let [w, h] = sheet.size_mm;
    assert!(svg.contains(&format!(
        "width=\"{w}mm\" height=\"{h}mm\" viewBox=\"0 0 {w} {h}\""
    )));
    let radii = attribute(&svg, "circle", "MARK", "r");
    assert_eq!(radii.iter().filter(|r| r[0] == 7.5).count(), 99);
    let across = attribute(&svg, "circle", "MARK", "cx");
    assert!((across[0][0] - across[1][0] - 50.0).abs() < 1e-9);
    assert!(svg.contains("wc &lt;50&gt; &amp; co"));
}

#[test]
fn every_sheet_has_its_100_mm_and_dimensions_that_tell_the_truth() {
    let patterns = [
        BoardPattern::Lines { line_m: 0.002 },
        BoardPattern::Dots { diameter_m: 0.015 },
        BoardPattern::Chessboard,
    ];
    let sway = Target {
        name: "sway".into(),
        slabs: vec![Slab {
            name: "board".into(),
            outline: SlabOutline::Rectangle {
                x0_m: 0.1,
                x1_m: 1.2,
                width_m: 0.2,
            },
            top_m: 0.02,
            albedo: 1.0,
        }],
        origin: [0.0; 3],
    };
    let sheets = patterns
        .map(|p| board_sheet(&board(p)))
        .into_iter()
        .chain([target_sheet(&hexagons()), target_sheet(&sway)]);
    for sheet in sheets {
        let dxf = read_dxf(&dxf::write(&sheet));
        let lengths: Vec<f64> = dxf
            .iter()
            .filter(|e| e.0 == "LINE")
            .map(|e| (e.2[1][0] - e.2[0][0]).hypot(e.2[1][1] - e.2[0][1]))
            .collect();
        assert!(
            lengths.iter().any(|l| (l - 100.0).abs() < 1e-4),
            "{}",
            sheet.title
        );
        // Every number written stands on a line of that length.
        for shape in &sheet.shapes {
            if let Shape::Text(_, _, words) = shape
                && let Ok(mm) = words.parse::<f64>()
            {
                assert!(
                    lengths.iter().any(|l| (l - mm).abs() < 0.006),
                    "{words}: {lengths:?}"
                );
            }
        }
        // Nothing is drawn off the sheet.
        for (_, _, points, _) in &dxf {
            for p in points {
                assert!(
                    (0.0..=sheet.size_mm[0]).contains(&p[0]),
                    "{} {p:?}",
                    sheet.title
                );
                assert!(
                    (0.0..=sheet.size_mm[1]).contains(&p[1]),
                    "{} {p:?}",
                    sheet.title
                );
            }
        }
    }
}

#[test]
fn hexagons_have_their_sides() {
    let dxf = read_dxf(&dxf::write(&target_sheet(&hexagons())));
    let chain = dxf
        .iter()
        .filter(|e| e.0 == "POLYLINE")
        .find(|e| e.2.len() == 26)
        .unwrap();
    // All flanks are sides of a regular hexagon.
    let n = chain.2.len();
    let sides: Vec<f64> = (0..n)
        .map(|k| {
            let (a, b) = (chain.2[k], chain.2[(k + 1) % n]);
            (b[0] - a[0]).hypot(b[1] - a[1])
        })
        .collect();
    assert!(sides.iter().all(|s| (s - 120.0).abs() < 1e-3), "{sides:?}");
    let size = extent(&chain.2);
    assert!((size[0] - 1247.0766).abs() < 1e-3 && (size[1] - 240.0).abs() < 1e-3);
}

#[test]
fn a_chessboard_has_its_squares_where_the_renderer_and_the_detector_put_them() {
    let mut b = board(BoardPattern::Chessboard);
    b.margin_m = b.pitch_m;
    let dxf = read_dxf(&dxf::write(&board_sheet(&b)));
    let squares: Vec<_> = dxf
        .iter()
        .filter(|e| e.0 == "POLYLINE" && e.1 == "MARK")
        .collect();
    assert_eq!(squares.len(), 12 * 10 / 2);
    for s in &squares {
        let size = extent(&s.2);
        assert!((size[0] - 50.0).abs() < 1e-3 && (size[1] - 50.0).abs() < 1e-3);
    }
}

/// Marks and the light left in them, painted in order, against the board's own rule, over all of its face.
#[test]
fn a_charuco_board_is_drawn_as_it_is_read() {
    let (_, dictionary) = hydroline_rigs::Dictionary::ALL[5];
    let mut board = board(BoardPattern::Charuco {
        dictionary,
        marker_m: 0.037,
    });
    (board.columns, board.rows, board.margin_m) = (6, 4, 0.05);
    board.blocks.clear();
    let sheet = board_sheet(&board);
    let half = board::half_size_m(&board).map(|v| 1e3 * v);
    let centre = [ROOM_MM + half[0], ROOM_MM + 20.0 + half[1]];
    let mut light = [0, 0];
    for y in 0..181 {
        for x in 0..181 {
            // Off the rims of squares and bits.
            let at = [x, y].map(|k| 2.0 * (f64::from(k) + 0.37) / 181.0 - 1.0);
            let place = [centre[0] + at[0] * half[0], centre[1] + at[1] * half[1]];
            let mut dark = false;
            for shape in &sheet.shapes {
                if let Shape::Polygon(layer @ (Layer::Mark | Layer::Light), corners) = shape
                    && (0..2).all(|k| corners[0][k] < place[k] && place[k] < corners[2][k])
                {
                    dark = *layer == Layer::Mark;
                }
            }
            // ξ runs to the left of the drawing.
            let on_board = [-at[0] * half[0] / 1e3, at[1] * half[1] / 1e3];
            assert_eq!(
                dark,
                crate::charuco::is_dark(&board, on_board),
                "{on_board:?}"
            );
            light[usize::from(dark)] += 1;
        }
    }
    assert!(light[0].min(light[1]) * 10 > light[0].max(light[1]) * 4);
    assert!(
        sheet
            .title
            .contains("7 x 5 squares, DICT_5X5_100 markers of 37 mm")
    );
}
