//! Dictionaries of square markers, by OpenCV's names.

/// One of OpenCV's predefined dictionaries of square markers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dictionary {
    /// Bits along a marker's side, without its border of one.
    pub side: u32,
    /// Markers in it; a smaller dictionary of that side is the beginning of a larger one.
    pub markers: u32,
}

impl Dictionary {
    /// All, by name.
    pub const ALL: [(&'static str, Dictionary); 16] = [
        ("DICT_4X4_50", Dictionary::new(4, 50)),
        ("DICT_4X4_100", Dictionary::new(4, 100)),
        ("DICT_4X4_250", Dictionary::new(4, 250)),
        ("DICT_4X4_1000", Dictionary::new(4, 1000)),
        ("DICT_5X5_50", Dictionary::new(5, 50)),
        ("DICT_5X5_100", Dictionary::new(5, 100)),
        ("DICT_5X5_250", Dictionary::new(5, 250)),
        ("DICT_5X5_1000", Dictionary::new(5, 1000)),
        ("DICT_6X6_50", Dictionary::new(6, 50)),
        ("DICT_6X6_100", Dictionary::new(6, 100)),
        ("DICT_6X6_250", Dictionary::new(6, 250)),
        ("DICT_6X6_1000", Dictionary::new(6, 1000)),
        ("DICT_7X7_50", Dictionary::new(7, 50)),
        ("DICT_7X7_100", Dictionary::new(7, 100)),
        ("DICT_7X7_250", Dictionary::new(7, 250)),
        ("DICT_7X7_1000", Dictionary::new(7, 1000)),
    ];

    const fn new(side: u32, markers: u32) -> Self {
        Dictionary { side, markers }
    }

    /// OpenCV's name.
    pub fn name(self) -> &'static str {
        let known = Self::ALL.iter().find(|(_, d)| *d == self);
        known.map_or("a dictionary of its own", |(name, _)| name)
    }
}
