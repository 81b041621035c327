//! Formats that begin with fixed bytes, in the order in which they are asked.

use super::Foreign;
use super::text::CONTROL_SEPARATORS;

/// Ways to a table that several formats share.
const SHEET: &str =
    "save the sheet with the samples as text (CSV, UTF-8) and `hydroline import` that";
const UNPACK: &str = "unpack it and name what is in it";
const PANDAS: &str = "write it as a table: in Python (pandas, pyarrow) `pandas.read_parquet(\"FILE\").to_csv(\"TABLE.csv\", index=False)`, and `hydroline import` that";
const ARROW: &str = "write it as a table: in Python (pandas, pyarrow) `pandas.read_feather(\"FILE\").to_csv(\"TABLE.csv\", index=False)`, and `hydroline import` that";
const NUMPY: &str = "write its arrays as columns of a table: `numpy.savetxt(\"TABLE.csv\", numpy.column_stack([..]), delimiter=\",\", header=\"t,x\", comments=\"\")`, and `hydroline import` that";
const MATLAB: &str = "write time and signals as a table: in MATLAB `writetable(table(t, x), \"TABLE.csv\")`, in Python `scipy.io.loadmat(\"FILE\")`, and `hydroline import` that";
const HDF5: &str = "write its data sets as columns of a table: in Python (h5py, pandas) `pandas.DataFrame({\"t\": f[\"t\"], \"x\": f[\"x\"]}).to_csv(\"TABLE.csv\", index=False)`, and `hydroline import` that";
const TDMS: &str = "write its channels as a table: in Python (npTDMS) `TdmsFile.read(\"FILE\").as_dataframe().to_csv(\"TABLE.csv\")`, and `hydroline import` that";
const MDF: &str = "write its channels as a table: in Python (asammdf) `MDF(\"FILE\").export(\"csv\", \"TABLE.csv\")`, and `hydroline import` that";
const VIDEO: &str = "a video has no numbers of motion: take its frames apart (`ffmpeg -i FILE FRAMES/%06d.png`), and `hydroline extract` reads the folder";
const IMAGE: &str = "`hydroline extract` reads images";
const POINTS: &str = "a cloud of points is no motion: export the vehicle's places over time as a table (CSV), and `hydroline import` that";
const WRITTEN: &str =
    "export a table (CSV) from the program that wrote it, and `hydroline import` that";

/// Bytes at the beginning, what the file is, and the way on.
const FIRST: &[(&[u8], &str, &str)] = &[
    // Logs of robots.
    (
        b"#ROSBAG V",
        "a bag of ROS 1",
        "make one of ROS 2 of it (`pip install rosbags`, then `rosbags-convert --src FILE.bag --dst FOLDER`) and import that folder",
    ),
    (
        b"ULogEnc",
        "an encrypted PX4 ULog (.ulge)",
        "decrypt it with the key of the vehicle's maker (`Tools/decrypt_ulog.py` of PX4) and `hydroline import` the .ulg that comes out",
    ),
    (
        b"H Product:Blackbox",
        "a Blackbox flight log",
        "write it as a table (`blackbox_decode FILE`) and `hydroline import` the CSV",
    ),
    (
        b"\xed\xa1\xda\x01",
        "a log of LCM",
        "write its messages as a table (CSV) with LCM's Python reader, and `hydroline import` that",
    ),
    // Tables of other programs.
    (b"MATLAB 5.0 MAT-file", "a MATLAB file (.mat)", MATLAB),
    (
        b"MATLAB 7.3 MAT-file",
        "a MATLAB file (.mat, version 7.3)",
        MATLAB,
    ),
    (b"PAR1", "a Parquet file (.parquet)", PANDAS),
    (
        b"ARROW1",
        "an Arrow or Feather file (.arrow, .feather)",
        ARROW,
    ),
    (b"FEA1", "a Feather file (.feather)", ARROW),
    (b"\x93NUMPY", "an array of NumPy (.npy)", NUMPY),
    (b"TDSm", "a LabVIEW TDMS file (.tdms)", TDMS),
    (
        b"TDSh",
        "the index of a LabVIEW TDMS file (.tdms_index)",
        TDMS,
    ),
    (
        b"MDF     ",
        "a measurement file of ASAM MDF (.mf4, .mdf)",
        MDF,
    ),
    (
        b"UnFinMF ",
        "an unfinished measurement file of ASAM MDF (.mf4)",
        MDF,
    ),
    (b"CDF\x01", "a NetCDF file (.nc)", HDF5),
    (b"CDF\x02", "a NetCDF file (.nc)", HDF5),
    (b"CDF\x05", "a NetCDF file (.nc)", HDF5),
    (b"Obj\x01", "an Avro file (.avro)", WRITTEN),
    (
        b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1",
        "a spreadsheet or document of old Office programs (.xls)",
        SHEET,
    ),
    // Points, pictures, documents.
    (b"# .PCD v", "a cloud of points (.pcd)", POINTS),
    (b"ply\n", "a cloud of points (.ply)", POINTS),
    (b"ply\r\n", "a cloud of points (.ply)", POINTS),
    (b"\x89PNG\r\n\x1a\n", "an image (.png)", IMAGE),
    (b"\xff\xd8\xff", "an image (.jpg)", IMAGE),
    (b"II*\0", "an image (.tif)", IMAGE),
    (b"MM\0*", "an image (.tif)", IMAGE),
    (b"\x1aE\xdf\xa3", "a video (.mkv, .webm)", VIDEO),
    (b"%PDF-", "a document (.pdf)", WRITTEN),
    (b"\x7fELF", "a program", "name a log or a table"),
    // Packed files.
    (
        b"\x1f\x8b\x08",
        "packed with gzip (.gz)",
        "unpack it: `gunzip -k FILE`",
    ),
    (
        b"\x28\xb5\x2f\xfd",
        "packed with zstd (.zst)",
        "unpack it: `unzstd FILE`",
    ),
    (
        b"\xfd7zXZ\0",
        "packed with xz (.xz)",
        "unpack it: `unxz -k FILE`",
    ),
    (
        b"\x04\x22\x4d\x18",
        "packed with lz4 (.lz4)",
        "unpack it: `unlz4 FILE`",
    ),
    (b"7z\xbc\xaf\x27\x1c", "an archive of 7-Zip (.7z)", UNPACK),
    (b"Rar!\x1a\x07", "an archive of RAR (.rar)", UNPACK),
];

/// Bytes behind a signature of which one is no text's in every format that is short enough to pass for text as a whole.
const BEHIND_BYTES: usize = 8;

/// Whether a file begins with a signature. One of letters and digits may be the name of a table's first column: then the file is no
/// text as a whole, or a byte that no table has stands soon behind it.
fn begins(head: &[u8], is_text: bool, signature: &[u8]) -> bool {
    let is_name = signature.iter().all(u8::is_ascii_alphanumeric);
    let in_no_table = |b: &u8| {
        b.is_ascii_control() && !matches!(b, b'\t'..=b'\r') && !CONTROL_SEPARATORS.contains(b)
    };
    let behind = |rest: &[u8]| rest.iter().take(BEHIND_BYTES).any(in_no_table);
    head.strip_prefix(signature)
        .is_some_and(|rest| !is_name || !is_text || behind(rest))
}

/// Kind of a file that begins with fixed bytes; `is_text` = as a whole it may be text.
pub(super) fn find(head: &[u8], is_text: bool) -> Option<Foreign> {
    let first = FIRST.iter().find(|f| begins(head, is_text, f.0));
    let (what, next) = first
        .map(|f| (f.1, f.2))
        .or_else(|| bzip2(head))
        .or_else(|| rerun(head, is_text))
        .or_else(|| zip(head))
        .or_else(|| riff(head))
        .or_else(|| further_in(head))
        .or_else(|| pickle(head))
        .or_else(|| c3d(head))?;
    Some(Foreign::new(what, next))
}

type Known = (&'static str, &'static str);

/// Bzip2: behind the size of its blocks stand the digits of pi, in an empty file those of its square root.
fn bzip2(head: &[u8]) -> Option<Known> {
    let (size, rest) = head.strip_prefix(b"BZh")?.split_first()?;
    let is_one = (b'1'..=b'9').contains(size)
        && (rest.starts_with(b"1AY&SY") || rest.starts_with(b"\x17\x72\x45\x38\x50\x90"));
    is_one.then_some(("packed with bzip2 (.bz2)", "unpack it: `bunzip2 -k FILE`"))
}

fn rerun(head: &[u8], is_text: bool) -> Option<Known> {
    let signature = head.get(..4)?;
    let is_one = signature.starts_with(b"RRF")
        && signature[3].is_ascii_digit()
        && begins(head, is_text, signature);
    is_one.then_some((
        "a recording of Rerun (.rrd)",
        "write the entities that you need as a table (Rerun's guide \"Export the dataframe\", then pandas' to_csv) and import that, or import what Rerun was given: MCAP is read",
    ))
}

fn holds(head: &[u8], word: &[u8]) -> bool {
    head.windows(word.len()).any(|w| w == word)
}

/// ZIP, by the names of what is in it: spreadsheets, NumPy's arrays, or an archive.
fn zip(head: &[u8]) -> Option<Known> {
    if !(head.starts_with(b"PK\x03\x04") || head.starts_with(b"PK\x05\x06")) {
        return None;
    }
    Some(if holds(head, b"xl/") {
        ("a spreadsheet (.xlsx)", SHEET)
    } else if holds(head, b"opendocument.spreadsheet") {
        ("a spreadsheet (.ods)", SHEET)
    } else if holds(head, b".npy") {
        ("arrays of NumPy (.npz)", NUMPY)
    } else if holds(head, b"word/") || holds(head, b"opendocument.text") {
        ("a document of text (.docx, .odt)", WRITTEN)
    } else {
        ("an archive (.zip)", UNPACK)
    })
}

fn riff(head: &[u8]) -> Option<Known> {
    let kind = head.starts_with(b"RIFF").then(|| head.get(8..12))??;
    match kind {
        b"AVI " => Some(("a video (.avi)", VIDEO)),
        b"WAVE" => Some((
            "a record of sound (.wav)",
            "write its samples as a table (CSV), and `hydroline import` that",
        )),
        _ => None,
    }
}

/// Formats whose fixed bytes stand behind others.
fn further_in(head: &[u8]) -> Option<Known> {
    let at = |offset: usize, bytes: &[u8]| {
        head.get(offset..)
            .is_some_and(|rest| rest.starts_with(bytes))
    };
    if at(257, b"ustar") {
        return Some(("an archive (.tar)", UNPACK));
    }
    // HDF5 may stand behind a block of the user's, 512 bytes or a power of two more.
    let places = [0, 512, 1024, 2048, 4096, 8192];
    if places.iter().any(|p| at(*p, b"\x89HDF\r\n\x1a\n")) {
        return Some(("an HDF5 file (.h5, .hdf5, .nc)", HDF5));
    }
    // Before it stands the size of the first box, of 4 bytes: the first of them is 0.
    (at(0, b"\0") && at(4, b"ftyp")).then_some(("a video (.mp4, .mov)", VIDEO))
}

/// Python's pickle of protocol 2 to 5.
fn pickle(head: &[u8]) -> Option<Known> {
    let is_one = match head {
        [0x80, 4 | 5, 0x95, ..] => true,
        [0x80, 2 | 3, next, ..] => b"c}](Xq".contains(next),
        _ => false,
    };
    is_one.then_some((
        "a pickle of Python (.pkl)",
        "write it as a table where it was made: `DATAFRAME.to_csv(\"TABLE.csv\", index=False)`, and `hydroline import` that",
    ))
}

/// Motion capture's C3D: the first byte names the block of the parameters, which names the kind of processor (83 to 86).
fn c3d(head: &[u8]) -> Option<Known> {
    let &[block @ 1..=32, 0x50, ..] = head else {
        return None;
    };
    let processor = head.get((usize::from(block) - 1) * 512 + 3)?;
    (83..=86).contains(processor).then_some((
        "a file of motion capture (.c3d)",
        "export the body's place and attitude as a table (CSV) from the program of the cameras, and `hydroline import` that",
    ))
}
