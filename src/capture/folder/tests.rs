use super::*;
use proptest::prelude::*;

fn names(list: &[&str]) -> Vec<String> {
    list.iter().map(|s| (*s).to_owned()).collect()
}

#[test]
fn names_are_ordered_as_people_count() {
    let mut list = [
        "img10", "img2", "img02", "a", "img1b", "img1", "7", "10", "é9",
    ];
    list.sort_by(|a, b| natural(a, b));
    assert_eq!(
        list,
        [
            "7", "10", "a", "img1", "img1b", "img02", "img2", "img10", "é9"
        ]
    );
}

#[test]
fn the_last_number_of_a_name_counts() {
    for (name, wanted) in [
        (
            "frame_00000012_1760000000040000000",
            Some(1_760_000_000_040_000_000),
        ),
        ("0007", Some(7)),
        ("img12left", Some(12)),
        ("é3é", Some(3)),
        ("none", None),
        ("99999999999999999999999", None),
    ] {
        assert_eq!(number(name), wanted, "{name}");
    }
}

#[test]
fn a_rate_counts_by_the_names_and_a_number_left_out_is_a_missing_frame() {
    let at = |list: &[&str], rate| {
        let places = places(&names(list), rate).unwrap();
        let seen = places
            .iter()
            .map(|p| (p.sequence, p.stamp_ns - START_NS, p.missing));
        seen.collect::<Vec<_>>()
    };
    let ms = 1_000_000;
    assert_eq!(
        at(&["f5", "f6", "f9"], Some(25.0)),
        [(0, 0, 0), (1, 40 * ms, 0), (4, 160 * ms, 2)]
    );
    // Times of day do not count frames, nor do names without numbers: one after the other.
    for list in [["101502", "101637", "102000"], ["a", "b", "c"]] {
        assert_eq!(
            at(&list, Some(10.0)),
            [(0, 0, 0), (1, 100 * ms, 0), (2, 200 * ms, 0)]
        );
    }
    let times = ["f_0_1760000000000000000", "f_1_1760000000040000000"];
    let stamped = places(&names(&times), None).unwrap();
    assert_eq!(stamped[1].stamp_ns, 1_760_000_000_040_000_000);
    // With a rate the times of the names do not matter.
    assert_eq!(at(&times, Some(10.0))[1], (1, 100 * ms, 0));
    assert_eq!(places(&names(&["1", "2"]), None), Err(Untimed::NoTimes));
    let back = ["1760000000040000000", "x1760000000000000000"];
    assert_eq!(places(&names(&back), None), Err(Untimed::Order(1)));
}

#[test]
fn a_folder_tells_its_images_from_what_else_is_there() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["2.PNG", "10.jpg", "1.png", "notes.txt", ".hidden"] {
        std::fs::write(dir.path().join(name), name).unwrap();
    }
    std::fs::create_dir(dir.path().join("3.png")).unwrap();
    let folder = ImageFolder::open(dir.path()).unwrap();
    let images: Vec<_> = folder
        .images
        .iter()
        .map(|p| p.file_name().unwrap().to_str().unwrap())
        .collect();
    assert_eq!(images, ["1.png", "2.PNG", "10.jpg"]);
    let words = folder.skipped().unwrap();
    assert!(
        words.contains("2 of 5 entries") && words.contains("3.png, notes.txt"),
        "{words}"
    );
    let words = folder.clone().frames(None).err().unwrap().to_string();
    assert!(
        words.contains("1.png") && words.contains("--rate-hz"),
        "{words}"
    );
    // A file that is no image is a frame that does not decode.
    let frames: Vec<Frame> = folder
        .frames(Some(5.0))
        .unwrap()
        .map(Result::unwrap)
        .collect();
    assert_eq!(frames.len(), 3);
    assert_eq!(frames[2].meta.lost_before.sequence_gap, 0);
    assert!(
        frames
            .iter()
            .all(|f| f.to_grey(&Default::default()).is_err())
    );
    let empty = tempfile::tempdir().unwrap();
    let words = ImageFolder::open(empty.path()).unwrap_err().to_string();
    assert!(
        words.contains("no images") && words.contains("name a folder"),
        "{words}"
    );
    assert!(ImageFolder::open(&dir.path().join("none")).is_err());
}

proptest! {
    #[test]
    fn the_order_is_one(a in "[a0-9é]{0,6}", b in "[a0-9é]{0,6}", c in "[a0-9é]{0,6}") {
        prop_assert_eq!(natural(&a, &b), natural(&b, &a).reverse());
        prop_assert_eq!(natural(&a, &b) == Ordering::Equal, a == b);
        if natural(&a, &b).is_le() && natural(&b, &c).is_le() {
            prop_assert!(natural(&a, &c).is_le());
        }
        let _ = number(&a);
    }
}
