use super::*;
use crate::drawing::{board_sheet, pdf};
use hydroline_rigs::Board;
use proptest::prelude::*;

fn tiling(paper: Paper) -> Tiling {
    Tiling {
        paper,
        margin_mm: 10.0,
        overlap_mm: 0.0,
    }
}

/// A plate by itself.
fn plate(size_mm: [f64; 2]) -> Sheet {
    let mut sheet = Sheet::new("plate".to_owned(), size_mm);
    sheet.rectangle(
        Layer::Cut,
        [40.0, 60.0],
        [40.0 + size_mm[0], 60.0 + size_mm[1]],
    );
    sheet
}

/// Ends of the lines of a layer among a page's marks.
fn lines(page: &Page, layer: Layer) -> Vec<[[f64; 2]; 2]> {
    let of = |shape: &Shape| match shape {
        Shape::Line(l, a, b) if *l == layer => Some([*a, *b]),
        _ => None,
    };
    page.marks.iter().filter_map(of).collect()
}

proptest! {
    #[test]
    fn cells_part_the_plate_and_marks_lie_on_the_cuts(
        width in 20.0..1500.0f64,
        height in 20.0..1500.0f64,
        a3 in any::<bool>(),
        margin_mm in 5.0..30.0f64,
        overlap_mm in prop_oneof![Just(0.0), 1.0..30.0f64],
        at in (0.0..1.0f64, 0.0..1.0f64),
    ) {
        let paper = if a3 { Paper::A3 } else { Paper::A4 };
        let tiling = Tiling { paper, margin_mm, overlap_mm };
        let pages = pages(&plate([width, height]), &tiling).unwrap();
        // Areas add up to the plate's, and a point of it lies in one cell: covered exactly.
        let area = |w: &Window| w.size_mm()[0] * w.size_mm()[1];
        let sum: f64 = pages.iter().map(|p| area(&p.cell)).sum();
        prop_assert!((sum - width * height).abs() < 1e-6);
        let point = [40.0 + at.0 * width, 60.0 + at.1 * height];
        let holds = |w: &Window| (0..2).all(|k| w.low_mm[k] <= point[k] && point[k] < w.high_mm[k]);
        prop_assert_eq!(pages.iter().filter(|p| holds(&p.cell)).count(), 1);
        let [rows, columns] = pages.last().unwrap().place;
        prop_assert_eq!(rows * columns, pages.len());
        for page in &pages {
            for k in 0..2 {
                // The drawing and its marks stay on the paper, and nothing of the cell is missing.
                prop_assert!(page.drawn.low_mm[k] <= page.cell.low_mm[k]);
                prop_assert!(page.drawn.high_mm[k] >= page.cell.high_mm[k]);
                let [low, high] = [page.drawn.low_mm, page.drawn.high_mm].map(|p| p[k] + page.shift_mm[k]);
                prop_assert!(low >= margin_mm - 1e-9 && high <= page.size_mm[k] - margin_mm + 1e-9);
            }
            let cuts = lines(page, Layer::Cut);
            prop_assert_eq!(cuts.len(), 8);
            for [a, b] in cuts {
                let across = usize::from((a[0] - b[0]).abs() > 1e-9);
                let on_sheet = a[across] - page.shift_mm[across];
                prop_assert!([page.cell.low_mm, page.cell.high_mm].iter().any(|c| (c[across] - on_sheet).abs() < 1e-9));
                for p in [a, b] {
                    prop_assert!((0..2).all(|k| (0.0..=page.size_mm[k]).contains(&p[k])));
                    let along = 1 - across;
                    let place = p[along] - page.shift_mm[along];
                    prop_assert!(place < page.drawn.low_mm[along] || place > page.drawn.high_mm[along]);
                }
            }
            let scale = lines(page, Layer::Note);
            prop_assert!(scale.iter().any(|[a, b]| (b[0] - a[0] - 100.0).abs() < 1e-9 && a[1] == b[1]));
            // The neighbour to the right begins at this page's cut and shows again what lies beyond it.
            let right = pages.iter().find(|p| p.place == [page.place[0], page.place[1] + 1]);
            if let Some(right) = right {
                prop_assert!((right.drawn.low_mm[0] - page.cell.high_mm[0]).abs() < 1e-9);
                prop_assert!((page.drawn.high_mm[0] - right.drawn.low_mm[0] - overlap_mm).abs() < 1e-9);
                prop_assert!(right.cell.size_mm()[0] > overlap_mm - 1e-9);
            }
        }
    }
}

#[test]
fn the_paper_lies_as_it_takes_fewer_pages() {
    // 265 mm across and 170 high fit an A4 page that lies on its side.
    let one = pages(&plate([265.0, 165.0]), &tiling(Paper::A4)).unwrap();
    assert_eq!((one.len(), one[0].size_mm), (1, [297.0, 210.0]));
    let upright = pages(&plate([165.0, 250.0]), &tiling(Paper::A4)).unwrap();
    assert_eq!((upright.len(), upright[0].size_mm), (1, [210.0, 297.0]));
}

#[test]
fn what_cannot_be_tiled_is_refused_with_the_range() {
    let sheet = plate([300.0, 300.0]);
    let with = |margin_mm, overlap_mm| Tiling {
        margin_mm,
        overlap_mm,
        ..tiling(Paper::A4)
    };
    for bad in [0.0, 51.0, f64::NAN] {
        let words = pages(&sheet, &with(bad, 0.0)).unwrap_err().to_string();
        assert!(words.contains("5 to 50 mm"), "{words}");
    }
    for bad in [-1.0, 31.0, f64::NAN] {
        let words = pages(&sheet, &with(10.0, bad)).unwrap_err().to_string();
        assert!(words.contains("0 to 30 mm"), "{words}");
    }
    let huge = pages(&plate([9e3, 9e3]), &tiling(Paper::A4)).unwrap_err();
    assert!(huge.to_string().contains("at most 200"), "{huge}");
    // Also the narrowest page has room with the widest margin and overlap.
    assert!(pages(&sheet, &with(50.0, 30.0)).is_ok());
}

/// Numbers before each operator of a page's content.
fn operators(bytes: &[u8]) -> Vec<(String, Vec<f64>)> {
    let text = String::from_utf8_lossy(bytes);
    let (mut found, mut numbers) = (Vec::new(), Vec::new());
    for word in text.split_whitespace() {
        match word.parse::<f64>() {
            Ok(number) => numbers.push(number),
            Err(_) => found.push((word.to_owned(), std::mem::take(&mut numbers))),
        }
    }
    found
}

#[test]
fn a_pdf_has_its_sizes_in_millimetres() {
    let board = Board::load_or_builtin("dots-50").unwrap();
    let sheet = board_sheet(&board);
    let tiles = pages(&sheet, &tiling(Paper::A4)).unwrap();
    let bytes = pdf::write(&sheet, &tiles);
    assert!(bytes.starts_with(b"%PDF-"));
    let text = String::from_utf8_lossy(&bytes);
    assert_eq!(text.matches("/Type /Page\n").count(), tiles.len());
    assert!(text.contains("/PrintScaling /None"));
    let pt = |mm: f64| mm * 72.0 / 25.4;
    let boxes: Vec<Vec<f64>> = text
        .split("/MediaBox [")
        .skip(1)
        .map(|rest| {
            let inner = rest.split(']').next().unwrap();
            inner.split(' ').map(|v| v.parse().unwrap()).collect()
        })
        .collect();
    for (found, page) in boxes.iter().zip(&tiles) {
        assert!((found[2] - pt(page.size_mm[0])).abs() < 1e-3);
        assert!((found[3] - pt(page.size_mm[1])).abs() < 1e-3);
    }
    // Each page draws in millimetres.
    let all = operators(&bytes);
    let scales: Vec<_> = all.iter().filter(|(name, _)| name == "cm").collect();
    assert_eq!(scales.len(), tiles.len());
    for (_, numbers) in scales {
        assert!((numbers[0] - pt(1.0)).abs() < 1e-5 && numbers[0] == numbers[3]);
    }
    // Every dot is drawn on the page that its middle is on, at its place: 50 mm from its neighbour.
    let dots = sheet
        .shapes
        .iter()
        .filter(|s| matches!(s, Shape::Circle(..)))
        .count();
    let circles = all.iter().filter(|(name, _)| name == "c").count() / 4;
    assert!(circles >= dots, "{circles} of {dots}");
}

#[test]
fn a_whole_sheet_is_one_page_of_its_size() {
    let sheet = plate([300.0, 200.0]);
    let bytes = pdf::write(&sheet, &[Page::whole(&sheet)]);
    let text = String::from_utf8_lossy(&bytes);
    assert_eq!(text.matches("/Type /Page\n").count(), 1);
    assert!(text.contains("100 mm: measure before use"));
}
