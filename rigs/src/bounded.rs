//! Files to read: never more than there is reason for, and never what may not come. A pipe that nobody writes, a terminal and
//! a device have no end and are not waited for; `-` is standard input, which whoever gives it means to be read.

use std::fs::{File, FileType};
use std::io::{self, Error, ErrorKind, IsTerminal, Read, Result};
use std::os::unix::fs::FileTypeExt;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Configuration, written by people: rigs, plans, boards, targets, maps of tables.
pub const CONFIG_BYTES: u64 = 1 << 20;
/// Files that hydroline writes to read again (calibrations with their maps, results), and small tables of readings.
pub const RESULT_BYTES: u64 = 64 << 20;
/// A table from something that has no size of its own: a pipe.
pub const STREAM_BYTES: u64 = 1 << 30;

/// Name of standard input as an argument.
const STDIN: &str = "-";
/// Names of descriptors that the caller handed over: `/dev/stdin`, and `<(...)` of a shell.
const DESCRIPTORS: [&str; 4] = [
    "/dev/stdin",
    "/dev/fd/",
    "/proc/self/fd/",
    "/proc/thread-self/fd/",
];

/// Whether this names standard input; a file of that name is `./-`.
pub fn is_stdin(path: &Path) -> bool {
    path == Path::new(STDIN)
}

/// Whether this is read once, from its beginning to its end: standard input, or a pipe that the caller handed over.
pub fn is_stream(path: &Path) -> bool {
    let handed = DESCRIPTORS.iter().any(|name| {
        path.as_os_str()
            .as_encoded_bytes()
            .starts_with(name.as_bytes())
    });
    is_stdin(path) || handed && std::fs::metadata(path).is_ok_and(|m| m.file_type().is_fifo())
}

/// Kind of something that is no file, and for which nobody should wait.
fn no_file(kind: FileType) -> Option<&'static str> {
    if kind.is_fifo() {
        Some("a pipe (FIFO)")
    } else if kind.is_char_device() || kind.is_block_device() {
        Some("a device (a terminal, a port, a disk)")
    } else if kind.is_socket() {
        Some("a socket")
    } else {
        None
    }
}

fn refused(words: String) -> Error {
    // The kind of what has no beginning to go back to.
    Error::new(ErrorKind::NotSeekable, words)
}

/// Refuses what is no file, without opening it; a folder is left to who reads it.
///
/// # Errors
/// [`ErrorKind::NotSeekable`] for a pipe, a terminal, a device, a socket or standard input; those of the system.
pub fn check_file(path: &Path) -> Result<()> {
    if is_stdin(path) {
        return Err(refused(
            "standard input cannot be read here, where a file is read more than once; write it to a file and name that \
             (a file whose name is - is ./-)"
                .to_owned(),
        ));
    }
    match no_file(std::fs::metadata(path)?.file_type()) {
        Some(what) => Err(refused(format!(
            "is {what}, and not a file: nothing is read from it, since it may never end; write what comes out of it to a file and name that"
        ))),
        None => Ok(()),
    }
}

/// Opens a file, as it is read more than once.
///
/// # Errors
/// As [`check_file`].
pub fn open(path: &Path) -> Result<File> {
    check_file(path)?;
    File::open(path)
}

/// Opens what is read once: a file, standard input as `-`, a pipe that the caller handed over.
///
/// # Errors
/// As [`check_file`]; standard input that is a terminal or was read before.
pub fn open_once(path: &Path) -> Result<Box<dyn Read + Send>> {
    static TAKEN: AtomicBool = AtomicBool::new(false);
    if is_stdin(path) {
        if io::stdin().is_terminal() {
            return Err(refused(
                "standard input is a terminal, which has no end: give `<FILE` or `COMMAND |`, or name a file".to_owned(),
            ));
        }
        if TAKEN.swap(true, Ordering::SeqCst) {
            return Err(refused(
                "standard input was read before, for another argument: name a file for one of them"
                    .to_owned(),
            ));
        }
        return Ok(Box::new(io::stdin()));
    }
    if is_stream(path) {
        return Ok(Box::new(File::open(path)?));
    }
    check_file(path).map_err(|e| match e.kind() {
        ErrorKind::NotSeekable => refused(format!("{e}, or give it as standard input, `-`")),
        _ => e,
    })?;
    Ok(Box::new(File::open(path)?))
}

/// The bytes of a file, of standard input (`-`) or of a pipe that the caller handed over.
///
/// # Errors
/// Those of the file, as [`open_once`]; [`ErrorKind::FileTooLarge`] beyond `largest_bytes`.
pub fn read_bytes(path: &Path, largest_bytes: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let read = open_once(path)?
        .take(largest_bytes.saturating_add(1))
        .read_to_end(&mut bytes)?;
    if read as u64 > largest_bytes {
        let words = format!(
            "larger than {largest_bytes} bytes, which no file of this kind is: it is another one"
        );
        return Err(Error::new(ErrorKind::FileTooLarge, words));
    }
    Ok(bytes)
}

/// The bytes of a table: all of a regular file, at most [`STREAM_BYTES`] of a stream.
///
/// # Errors
/// As [`read_bytes`].
pub fn read_table(path: &Path) -> Result<Vec<u8>> {
    let largest_bytes = match is_stream(path) {
        true => STREAM_BYTES,
        false => std::fs::metadata(path)?.len(),
    };
    read_bytes(path, largest_bytes)
}

/// The text of a file.
///
/// # Errors
/// As [`read_bytes`]; [`ErrorKind::InvalidData`] when it is not UTF-8.
pub fn read_text(path: &Path, largest_bytes: u64) -> Result<String> {
    String::from_utf8(read_bytes(path, largest_bytes)?).map_err(|e| {
        let words = format!("byte {} is not UTF-8 text", e.utf8_error().valid_up_to());
        Error::new(ErrorKind::InvalidData, words)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_beyond_the_bound_is_refused_and_one_at_the_bound_is_read() {
        let this = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/bounded.rs");
        let length = std::fs::metadata(&this).unwrap().len();
        assert_eq!(read_bytes(&this, length).unwrap().len() as u64, length);
        let larger = read_bytes(&this, length - 1).unwrap_err();
        assert_eq!(larger.kind(), ErrorKind::FileTooLarge);
        assert_eq!(read_table(&this).unwrap().len() as u64, length);
    }

    #[test]
    fn what_may_never_end_is_refused_before_it_is_opened() {
        // A device, a socket and a pipe of the file system stand for their kinds; chains make the pipe (mkfifo).
        let socket = std::env::temp_dir().join(format!("hydroline-rigs-{}", std::process::id()));
        std::fs::remove_file(&socket).ok();
        let listening = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        for (path, words) in [
            (Path::new("/dev/zero"), "a device"),
            (Path::new("/dev/tty"), "a device"),
            (socket.as_path(), "a socket"),
        ] {
            for error in [
                open(path).unwrap_err(),
                open_once(path).err().unwrap(),
                read_text(path, CONFIG_BYTES).unwrap_err(),
            ] {
                assert_eq!(error.kind(), ErrorKind::NotSeekable, "{error}");
                assert!(error.to_string().contains(words), "{error}");
            }
        }
        drop(listening);
        std::fs::remove_file(&socket).ok();
        let error = open(Path::new("-")).unwrap_err().to_string();
        assert!(error.contains("more than once"), "{error}");
    }

    #[test]
    fn a_pipe_that_the_caller_handed_over_is_read() {
        use std::io::Write;
        use std::os::fd::AsRawFd;
        let (reader, mut writer) = io::pipe().unwrap();
        writer.write_all(b"a = 1").unwrap();
        drop(writer);
        let name = format!("/dev/fd/{}", reader.as_raw_fd());
        assert!(is_stream(Path::new(&name)));
        assert_eq!(read_text(Path::new(&name), CONFIG_BYTES).unwrap(), "a = 1");
        assert!(!is_stream(Path::new("/dev/zero")));
    }
}
