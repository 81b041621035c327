use super::*;
use proptest::prelude::*;

fn what(head: &[u8]) -> String {
    match Content::of(head) {
        Content::Other(own) => own.what,
        other => format!("{other:?}"),
    }
}

/// A format record of DataFlash.
fn format(kind: u8, name: &str, letters: &str) -> Vec<u8> {
    let mut record = vec![0xa3, 0x95, 0x80, kind, 20];
    record.extend_from_slice(name.as_bytes());
    record.resize(9, 0);
    record.extend_from_slice(letters.as_bytes());
    record.resize(89, 0);
    record
}

/// A MAVLink packet behind its stamp; nothing here looks at its checksum.
fn packet(time_us: u64, sequence: u8) -> Vec<u8> {
    let mut bytes = time_us.to_be_bytes().to_vec();
    bytes.extend_from_slice(&[0xfd, 4, 0, 0, sequence, 1, 1, 30, 0, 0, 1, 2, 3, 4, 5, 6]);
    bytes
}

fn packets(from_us: u64) -> Vec<u8> {
    (0..50_u8)
        .flat_map(|k| packet(from_us + 20_000 * u64::from(k), k))
        .collect()
}

/// Numbers as a generator has them that is no format's.
fn noise(bytes: usize) -> Vec<u8> {
    let mut state = 88_172_645_463_325_252_u64;
    (0..bytes)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 32) as u8
        })
        .collect()
}

#[test]
fn every_foreign_format_is_named_with_the_way_on() {
    let mut hdf5 = vec![0; 1024];
    hdf5[512..520].copy_from_slice(b"\x89HDF\r\n\x1a\n");
    let mut tar = hdf5.clone();
    tar[257..262].copy_from_slice(b"ustar");
    let mut c3d = vec![0; 1024];
    c3d[..2].copy_from_slice(&[2, 0x50]);
    c3d[515] = 84;
    let utf16: Vec<u8> = "{\"t\": [0.1, 0.2]}"
        .encode_utf16()
        .flat_map(u16::to_le_bytes)
        .collect();
    for (head, named, way) in [
        (
            &b"#ROSBAG V2.0\nE\0\0\0"[..],
            "a bag of ROS 1",
            "rosbags-convert --src",
        ),
        (b"RRF2\0\x18\0\0", "Rerun", "Export the dataframe"),
        (b"ULogEnc\x01\x02", "encrypted", "decrypt"),
        (
            b"MATLAB 5.0 MAT-file, Platform: GLNXA64",
            ".mat",
            "writetable",
        ),
        (&hdf5, "HDF5", "h5py"),
        (b"PK\x03\x04\x14\0xl/workbook.xml", "spreadsheet", "CSV"),
        (b"PK\x03\x04\x14\0arr_0.npy", ".npz", "savetxt"),
        (b"PK\x03\x04\x14\0run.bin", ".zip", "unpack"),
        (b"PAR1\x15\x04", "Parquet", "to_csv"),
        (b"TDSm\x0e\0\0\0", "TDMS", "npTDMS"),
        (b"MDF     4.10", "MDF", "asammdf"),
        (&c3d, ".c3d", "export"),
        (&tar, ".tar", "unpack"),
        (b"\x1f\x8b\x08\0\0\0", "gzip", "gunzip"),
        (b"BZh91AY&SY\x9a\x2c", "bzip2", "bunzip2"),
        (b"ARROW1\0\0\xff\xff\xff\xff", "Arrow", "to_csv"),
        (b"FEA1\0\0\0\0", "Feather", "to_csv"),
        (b"\0\0\0\x18ftypmp42", "video", "ffmpeg"),
        (b"{\"t\": [0.1, 0.2]}", "JSON", "to_csv"),
        (b"[{\"t\": 0.1}]", "JSON", "to_csv"),
        (b"[[0.1, 0.2], [0.2, 0.3]]", "JSON", "to_csv"),
        (&utf16, "JSON", "to_csv"),
        (b"\xef\xbb\xbf\n<!DOCTYPE html><p>404", "HTML", "download"),
        (
            b"version https://git-lfs.github.com/spec/v1\noid sha256:4d\n",
            "Git LFS",
            "git lfs pull",
        ),
        (
            b"PARM, 1, 2\nFMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\n",
            "DataFlash log as text",
            "mavlogdump.py",
        ),
    ] {
        let Content::Other(own) = Content::of(head) else {
            panic!("{named}: {}", what(head));
        };
        assert!(own.what.contains(named), "{named}: {own:?}");
        assert!(own.next.contains(way), "{way}: {own:?}");
        for part in [own.what, own.next] {
            assert!(
                part.is_ascii() && !part.contains(|c: char| c.is_control()),
                "{part}"
            );
        }
    }
}

#[test]
fn tables_are_text_whatever_their_first_cell_is() {
    let utf16: Vec<u8> = "t;Winkel [°]\n1;2\n"
        .encode_utf16()
        .flat_map(u16::to_be_bytes)
        .collect();
    let mut zeros = b"t,x\n0.00,1.0\n0.02,1.1\n0.04,1.2\n".repeat(40);
    zeros.extend_from_slice(&[0; 4096]);
    for head in [
        &b""[..],
        b"t,x\n0,1\n",
        b"<DATE>,<TIME>,<x>\n",
        b"[s],[m]\n0,1\n",
        b"[1] 0.5 0.6\n",
        b"{t},{x}\n",
        b"RRFt,x\n",
        b"#ROSBAG, t, x\n",
        b"FMT, t, x\n1,2,3\n",
        b"MDF,x\n",
        b"PAR1,x\n0,1\n",
        b"TDSm_t;x\n0;1\n",
        b"FEA1\tx\n0\t1\n",
        b"ARROW1 x\n0 1\n",
        b"BZh1,x\n0,1\n",
        b"RRF2,x\n0,1\n",
        b"ULog_v5,x\n0,1\n",
        b"t,x,ftyp\n0,1,2\n",
        b"PAR1\x1fx\n0\x1f1\n",
        b"Zeit;H\xf6he\n1;2\n",
        b"t\tx\r\n\x1b[2J\t1\r\n",
        &utf16,
        &zeros,
    ] {
        assert_eq!(Content::of(head), Content::Text, "{}", what(head));
    }
}

#[test]
fn a_table_separated_by_control_characters_was_refused_as_binary() {
    for separator in CONTROL_SEPARATORS {
        let between = char::from(separator).to_string();
        let between = between.as_str();
        let row = |k: usize| {
            [k, k + 1, k + 2, k + 3]
                .map(|n| n.to_string())
                .join(between)
                + "\n"
        };
        let text =
            ["t", "x", "y", "z"].join(between) + "\n" + &(0..50).map(row).collect::<String>();
        for head in [&text[..], &text[..40], &format!("# notes\n{text}")] {
            assert_eq!(
                Content::of(head.as_bytes()),
                Content::Text,
                "{separator:#x}"
            );
        }
        // What is no line is no table.
        let bare = text.replace('\n', between);
        assert!(what(bare.as_bytes()).contains("no kind that is known"));
    }
}

#[test]
fn autopilots_logs_are_known_behind_other_bytes() {
    let first = [format(0x81, "ATT", "QccC"), format(0x80, "FMT", "BBnNZ")].concat();
    let other = [&[0xa3, 0x95, 0x81][..], &noise(40)].concat();
    for lead in [Vec::new(), vec![0; 512], other, noise(60_000)] {
        let bin = [&lead[..], &first].concat();
        assert_eq!(dataflash_at(&bin), Some(lead.len()));
        assert_eq!(Content::of(&bin), Content::DataFlash, "{}", what(&bin));
        // A companion computer without a clock begins in 1970.
        for from_us in [45_000_000, 1_700_000_000_000_000] {
            let telemetry = [&lead[..], &packets(from_us)].concat();
            assert_eq!(
                Content::of(&telemetry),
                Content::Telemetry,
                "{}",
                what(&telemetry)
            );
        }
    }
    let headless = [0xa3, 0x95, 0x81, 1, 2, 3, 4].repeat(100);
    assert!(what(&headless).contains("without the formats"));
}

#[test]
fn a_log_behind_other_bytes_or_with_damaged_ones_says_how_to_mend_it() {
    let log = b"\x89MCAP0\r\n\x01rest of a log".repeat(4);
    let behind = [&noise(300)[..], &log].concat();
    let Content::Other(own) = Content::of(&behind) else {
        panic!("{}", what(&behind));
    };
    assert!(
        own.what.contains("behind 300 bytes") && own.next.contains("tail -c +301"),
        "{own:?}"
    );
    for (magic, place) in [
        (&b"\x89MCAP0\r\n"[..], 3),
        (b"SQLite format 3\0", 0),
        (b"ULog\x01\x12\x35", 6),
    ] {
        let mut flipped = [magic, &noise(100)].concat();
        assert!(Content::of(&flipped) != Content::Text);
        flipped[place] ^= 0x10;
        let said = what(&flipped);
        assert!(said.contains("1 are damaged"), "{said}");
    }
}

#[test]
fn bytes_of_no_known_kind_are_no_text() {
    for head in [noise(200), noise(65_536), vec![0; 4096], vec![0, 1, 2, 3]] {
        assert!(
            what(&head).contains("no kind that is known"),
            "{}",
            what(&head)
        );
    }
    let floats: Vec<u8> = (0..5000)
        .flat_map(|k| (f64::from(k) * 0.01).sin().to_le_bytes())
        .collect();
    assert!(
        what(&floats).contains("no kind that is known"),
        "{}",
        what(&floats)
    );
    let counts: Vec<u8> = (0..5000_u16).flat_map(u16::to_le_bytes).collect();
    assert!(
        what(&counts).contains("no kind that is known"),
        "{}",
        what(&counts)
    );
}

proptest! {
    /// Whatever a file holds, it has a kind, and the words that name it hold nothing of it.
    #[test]
    fn any_bytes_have_a_kind_whose_words_are_ours(lead in 0..40_usize, bytes in prop::collection::vec(any::<u8>(), 0..600)) {
        let first: [&[u8]; 4] = [b"", b"PK\x03\x04", b"\x02\x50", b"[{"];
        let head = [first[lead % 4], &bytes[..]].concat();
        if let Some(own) = Content::of(&head).foreign() {
            prop_assert!(own.what.is_ascii() && own.next.is_ascii(), "{:?}", own);
        }
    }
}
