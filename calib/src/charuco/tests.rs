use super::*;

fn board(columns: u32, rows: u32, dictionary: Dictionary) -> Board {
    Board {
        name: "charuco".into(),
        pattern: BoardPattern::Charuco {
            dictionary,
            marker_m: 0.75,
        },
        columns,
        rows,
        pitch_m: 1.0,
        margin_m: 1.0,
        thickness_m: 0.1,
        blocks: Vec::new(),
    }
}

fn dictionary(name: &str) -> Dictionary {
    let named = Dictionary::ALL.iter().find(|(n, _)| *n == name);
    named.unwrap().1
}

#[test]
fn all_dictionaries_are_whole_and_no_marker_is_another_one_turned() {
    for (name, dictionary) in Dictionary::ALL {
        let codes = markers(dictionary);
        assert_eq!(codes.len(), dictionary.markers as usize, "{name}");
        let bits = dictionary.side * dictionary.side;
        assert!(codes.iter().all(|c| c >> bits == 0), "{name}");
        let n = dictionary.side;
        let turned = |code: u64| {
            let bit = |r: u32, c: u32| code >> (bits - 1 - r * n - c) & 1;
            let all = (0..n).flat_map(|r| (0..n).map(move |c| (r, c)));
            all.fold(0, |word, (r, c)| word << 1 | bit(n - 1 - c, r))
        };
        let mut seen = std::collections::HashSet::new();
        for code in codes {
            let mut code = *code;
            for _ in 0..4 {
                assert!(seen.insert(code), "{name}");
                code = turned(code);
            }
        }
    }
}

/// Ids and bits as `cv2.aruco.CharucoBoard((4, 3), 1, 0.75, DICT_4X4_50).generateImage` draws them (OpenCV 5.0.0): its
/// first marker is in the second square of the first row, its bits 1011 0101 0011 0010.
#[test]
fn markers_lie_as_opencv_draws_them() {
    let board = board(3, 2, dictionary("DICT_4X4_50"));
    let markers = Markers::of(&board).unwrap();
    // Upper row of squares: j = 1, from left to right i = 2, 1, 0, −1.
    let row = |j: i32| [2, 1, 0, -1].map(|i| markers.id([i, j]));
    assert_eq!(row(1), [None, Some(0), None, Some(1)]);
    assert_eq!(row(0), [Some(2), None, Some(3), None]);
    assert_eq!(row(-1), [None, Some(4), None, Some(5)]);
    assert_eq!(markers.squares().count(), 6);
    assert_eq!(markers.bits([1, 1]), Some(0b1011_0101_0011_0010));
    assert_eq!(markers.corner_id([2, 1]), Some(0));
    assert_eq!(markers.corner_id([0, 0]), Some(5));
    assert_eq!(markers.corner_id([3, 0]), None);
    // First row of the marker's bits from left to right, which is against ξ: light, dark, light, light.
    let cell = 0.75 / 6.0;
    let first = [0, 1, 2, 3].map(|c| {
        let from_left = 0.125 + (1.5 + f64::from(c)) * cell;
        markers.light([1, 1], [1.0 - from_left, 1.0 - 0.125 - 1.5 * cell])
    });
    assert_eq!(first, [Some(true), Some(false), Some(true), Some(true)]);
    // Border and the gap beside it.
    assert_eq!(
        markers.light([1, 1], [0.5, 0.125 + 0.5 * cell]),
        Some(false)
    );
    assert_eq!(markers.light([1, 1], [0.5, 0.06]), None);
}

#[test]
fn an_odd_number_of_squares_across_numbers_on() {
    let board = board(4, 4, dictionary("DICT_5X5_100"));
    let markers = Markers::of(&board).unwrap();
    let mut ids: Vec<u32> = (markers.squares())
        .map(|k| markers.id(k).unwrap())
        .collect();
    ids.sort_unstable();
    assert_eq!(ids, (0..12).collect::<Vec<_>>());
}
