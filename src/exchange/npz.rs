//! Draws as NumPy's archive: `values` (rows by columns), `names`, `models`.

use super::draws::Draws;
use super::stored::{Stored, TooLarge};

/// Bytes to which the head of an array is filled up.
const ALIGNED: usize = 64;

/// An array of NumPy's format 1.0: `kind` = its type, `shape` as Python writes it.
fn array(kind: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let mut head =
        format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}").into_bytes();
    // Magic, version and length before it, a line's end behind it.
    let whole = (head.len() + 11).div_ceil(ALIGNED) * ALIGNED;
    head.resize(whole - 11, b' ');
    head.push(b'\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((head.len() as u16).to_le_bytes());
    bytes.extend(head);
    bytes.extend(data);
    bytes
}

/// Texts of one width, as UCS-4.
fn texts(names: &[String]) -> Vec<u8> {
    let width = names
        .iter()
        .map(|n| n.chars().count())
        .max()
        .unwrap_or(0)
        .max(1);
    let mut data = Vec::with_capacity(4 * width * names.len());
    for name in names {
        let letters = name.chars().map(|c| c as u32);
        let filled = letters.chain(std::iter::repeat(0)).take(width);
        data.extend(filled.flat_map(u32::to_le_bytes));
    }
    array(&format!("<U{width}"), &format!("({},)", names.len()), &data)
}

/// The archive; the same draws give the same bytes.
///
/// # Errors
/// [`TooLarge`].
pub fn npz(draws: &Draws) -> Result<Vec<u8>, TooLarge> {
    let rows = draws.rows.len();
    let values: Vec<u8> = draws
        .rows
        .iter()
        .flatten()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let models = draws.models.iter().flat_map(|m| (*m as i64).to_le_bytes());
    let models: Vec<u8> = models.collect();
    let shape = format!("({rows}, {})", draws.names.len());
    let mut archive = Stored::default();
    archive.add("values.npy", &array("<f8", &shape, &values))?;
    archive.add("names.npy", &texts(&draws.names))?;
    archive.add("models.npy", &array("<i8", &format!("({rows},)"), &models))?;
    archive.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stored::tests::files;

    #[test]
    fn the_archive_holds_what_was_drawn() {
        let draws = Draws {
            names: vec!["x_u".into(), "thruster_lag.lag_s".into()],
            models: vec![0, 1],
            rows: vec![vec![-1.5, f64::NAN], vec![-2.5, 0.25]],
        };
        let bytes = npz(&draws).unwrap();
        assert_eq!(bytes, npz(&draws).unwrap());
        let all = files(&bytes);
        let read = |name: &str| {
            let (_, bytes) = all.iter().find(|f| f.0 == name).unwrap();
            let head = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
            assert_eq!((10 + head) % ALIGNED, 0);
            let text = String::from_utf8(bytes[10..10 + head].to_vec()).unwrap();
            (text, bytes[10 + head..].to_vec())
        };
        let (head, values) = read("values.npy");
        assert!(head.contains("'shape': (2, 2)"), "{head}");
        assert_eq!(values[16..24], (-2.5f64).to_le_bytes());
        let (head, names) = read("names.npy");
        assert!(head.contains("'<U18'"), "{head}");
        assert_eq!(names.len(), 2 * 18 * 4);
        assert_eq!(read("models.npy").1[8], 1);
    }
}
