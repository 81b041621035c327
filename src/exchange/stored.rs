//! A ZIP archive whose files are stored as they are (PKWARE's APPNOTE 6.3, without extensions): what NumPy and FMI read.
//!
//! Why no library: `zip` 9 brings six crates along for ciphers and packing that nothing here uses, one of them a second `nix`.

/// Version of the format that is needed to read it: 1.0, stored files only; 2.0 knows folders.
const VERSION: u16 = 20;
/// Flag of names in UTF-8.
const UTF8: u16 = 1 << 11;
/// Date of all files, the first that the format has: the same contents give the same bytes.
const FIRST_DAY: u16 = (1 << 5) | 1;
/// Permissions of a file on Unix, in the upper half of the attributes: a program's library may be loaded.
const PERMISSIONS: u32 = 0o100_755 << 16;
/// Made on Unix.
const ON_UNIX: u16 = 3 << 8;

/// More than an archive without extensions holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "{bytes} bytes or {files} files: an archive of this kind ends at 4 GiB and 65535 files; ask for less"
)]
pub struct TooLarge {
    /// Bytes so far.
    pub bytes: usize,
    /// Files so far.
    pub files: usize,
}

/// An archive that is being made.
#[derive(Debug, Clone, Default)]
pub struct Stored {
    bytes: Vec<u8>,
    /// Entries of the directory at its end.
    directory: Vec<u8>,
    files: usize,
}

fn u16s(values: &[u16]) -> impl Iterator<Item = u8> + '_ {
    values.iter().flat_map(|v| v.to_le_bytes())
}

fn u32s(values: &[u32]) -> impl Iterator<Item = u8> + '_ {
    values.iter().flat_map(|v| v.to_le_bytes())
}

impl Stored {
    fn size(&self, bytes: usize) -> Result<u32, TooLarge> {
        u32::try_from(bytes).map_err(|_| TooLarge {
            bytes,
            files: self.files,
        })
    }

    /// Adds a file; folders in its name are separated by `/`.
    ///
    /// # Errors
    /// [`TooLarge`].
    pub fn add(&mut self, name: &str, contents: &[u8]) -> Result<(), TooLarge> {
        let at = self.size(self.bytes.len())?;
        let size = self.size(contents.len())?;
        let length = u16::try_from(name.len()).map_err(|_| TooLarge {
            bytes: name.len(),
            files: self.files,
        })?;
        let checksum = crc32fast::hash(contents);
        // Flags, method (stored), time, day; checksum, packed and plain size; lengths of name and extra field.
        let common: Vec<u8> = u16s(&[VERSION, UTF8, 0, 0, FIRST_DAY])
            .chain(u32s(&[checksum, size, size]))
            .chain(u16s(&[length, 0]))
            .collect();
        self.bytes.extend(b"PK\x03\x04");
        self.bytes.extend(&common);
        self.bytes.extend(name.as_bytes());
        self.bytes.extend(contents);
        self.directory.extend(b"PK\x01\x02");
        self.directory.extend(u16s(&[ON_UNIX | VERSION]));
        self.directory.extend(&common);
        // No comment, the first disk, no internal attributes.
        self.directory.extend(u16s(&[0, 0, 0]));
        self.directory.extend(u32s(&[PERMISSIONS, at]));
        self.directory.extend(name.as_bytes());
        self.files += 1;
        Ok(())
    }

    /// The whole archive.
    ///
    /// # Errors
    /// [`TooLarge`].
    pub fn finish(mut self) -> Result<Vec<u8>, TooLarge> {
        let at = self.size(self.bytes.len())?;
        let size = self.size(self.directory.len())?;
        let files = u16::try_from(self.files).map_err(|_| TooLarge {
            bytes: self.bytes.len(),
            files: self.files,
        })?;
        self.bytes.append(&mut self.directory);
        self.bytes.extend(b"PK\x05\x06");
        self.bytes.extend(u16s(&[0, 0, files, files]));
        self.bytes.extend(u32s(&[size, at]));
        self.bytes.extend(u16s(&[0]));
        Ok(self.bytes)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    fn u32_at(bytes: &[u8], at: usize) -> usize {
        u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
    }

    fn u16_at(bytes: &[u8], at: usize) -> usize {
        usize::from(u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap()))
    }

    /// Names and contents by the archive's directory, checksums compared.
    pub(crate) fn files(bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
        let end = bytes.len() - 22;
        assert_eq!(&bytes[end..end + 4], b"PK\x05\x06");
        let mut at = u32_at(bytes, end + 16);
        let mut files = Vec::new();
        for _ in 0..u16_at(bytes, end + 10) {
            assert_eq!(&bytes[at..at + 4], b"PK\x01\x02");
            let (size, length) = (u32_at(bytes, at + 24), u16_at(bytes, at + 28));
            let local = u32_at(bytes, at + 42);
            let name = String::from_utf8(bytes[at + 46..at + 46 + length].to_vec()).unwrap();
            assert_eq!(&bytes[local..local + 4], b"PK\x03\x04");
            assert_eq!(&bytes[local + 30..local + 30 + length], name.as_bytes());
            let from = local + 30 + length;
            let contents = bytes[from..from + size].to_vec();
            assert_eq!(u32_at(bytes, at + 16), crc32fast::hash(&contents) as usize);
            files.push((name, contents));
            at += 46 + length;
        }
        assert_eq!(at, end);
        files
    }

    #[test]
    fn files_are_found_by_the_directory_with_their_checksums() {
        let mut archive = Stored::default();
        archive.add("a.txt", b"first").unwrap();
        archive.add("folder/b", &[0, 1, 2, 255]).unwrap();
        let read = files(&archive.finish().unwrap());
        assert_eq!(read[0], ("a.txt".to_owned(), b"first".to_vec()));
        assert_eq!(read[1].0, "folder/b");
        assert_eq!(read[1].1, [0, 1, 2, 255]);
    }

    #[test]
    fn an_empty_archive_is_its_end_alone() {
        assert_eq!(Stored::default().finish().unwrap().len(), 22);
    }
}
