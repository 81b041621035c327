//! Results that are files: whole or not at all, and never in the place of something else.
//!
//! A result is written beside its place under another name, synced, and renamed. What a crash or a full disk cuts off
//! never has the final name. What is there already stays unless `--force` is given; a symbolic link is then replaced
//! itself, the file that it leads to is not touched.

use super::{CliError, inputs};
use hydroline_log::held;
use image::{DynamicImage, ImageFormat};
use std::fs::File;
use std::io::{Cursor, Write};
use std::path::Path;

/// Treatment of result files that are there already.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct Output {
    /// Replaces result files that are there already (logs are never replaced)
    #[arg(long)]
    force: bool,
}

impl Output {
    /// As with --force, or without.
    pub fn replacing(force: bool) -> Self {
        Self { force }
    }

    /// Refuses a place that takes no result, before any work is done; `flag` = how the user named it.
    pub fn file(self, flag: &str, path: &Path) -> Result<(), CliError> {
        self.vacant(flag, path)?;
        inputs::takes_file(flag, path)
    }

    /// The same for results by these names in a folder, which is made when it is not there.
    pub fn folder(self, flag: &str, dir: &Path, names: &[&str]) -> Result<(), CliError> {
        inputs::folder(flag, dir)?;
        names
            .iter()
            .try_for_each(|name| self.vacant(flag, &dir.join(name)))
    }

    fn vacant(self, flag: &str, path: &Path) -> Result<(), CliError> {
        let Ok(there) = path.symlink_metadata() else {
            return Ok(());
        };
        let (kind, path) = (there.file_type(), path.display());
        if !(kind.is_file() || kind.is_symlink()) {
            return Err(CliError::Config(format!(
                "{path} exists and is no file: name another {flag}"
            )));
        }
        if !self.force {
            return Err(CliError::Config(format!(
                "{path} exists: name another {flag}, move it away, or give --force to replace it"
            )));
        }
        Ok(())
    }

    /// Writes a result where [`Self::file`] or [`Self::folder`] has looked before.
    pub fn write(self, path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), CliError> {
        self.whole(path, bytes.as_ref())
            .map_err(|e| CliError::writing(path, &e))
    }

    /// An image as PNG, JPEG by the path's ending.
    pub fn image(self, path: &Path, image: impl Into<DynamicImage>) -> Result<(), CliError> {
        let mut bytes = Cursor::new(Vec::new());
        let format = ImageFormat::from_path(path).unwrap_or(ImageFormat::Png);
        image
            .into()
            .write_to(&mut bytes, format)
            .map_err(|e| CliError::writing(path, &e))?;
        self.write(path, bytes.into_inner())
    }

    fn whole(self, path: &Path, bytes: &[u8]) -> std::io::Result<()> {
        let folder = held::folder_of(path);
        let mut part = held::part_in(folder)?;
        part.write_all(bytes)?;
        part.as_file().sync_all()?;
        if self.force {
            part.persist(path).map_err(|e| e.error)?;
        } else {
            part.persist_noclobber(path).map_err(|e| e.error)?;
        }
        // The name is on the disk when its folder is.
        File::open(folder)?.sync_all()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn results_that_killed_commands_left_are_cleared() {
        let dir = tempfile::tempdir().unwrap();
        let left = dir.path().join(".hydroline-a1b2c3.part");
        std::fs::write(&left, "half").unwrap();
        let new = dir.path().join("new.toml");
        Output::default().write(&new, "new").unwrap();
        assert!(new.exists() && !left.exists());
    }

    #[test]
    fn what_is_there_stays_unless_it_is_forced_and_a_link_is_never_written_through() {
        let dir = tempfile::tempdir().unwrap();
        let (file, link) = (dir.path().join("rig.toml"), dir.path().join("link.toml"));
        std::fs::write(&file, "precious").unwrap();
        symlink(&file, &link).unwrap();
        let (plain, force) = (Output::default(), Output { force: true });
        for path in [&file, &link] {
            let refused = plain.file("--out", path).unwrap_err();
            assert!(matches!(refused, CliError::Config(_)));
            assert!(refused.to_string().contains("--force"), "{refused}");
            // Not even when it came after the check.
            assert!(plain.write(path, "new").is_err());
        }
        assert!(plain.folder("--report", dir.path(), &["rig.toml"]).is_err());
        assert!(plain.folder("--report", dir.path(), &["new.html"]).is_ok());
        assert!(force.file("--out", dir.path()).is_err(), "a folder");

        force.file("--out", &link).unwrap();
        force.write(&link, "new").unwrap();
        assert_eq!(std::fs::read(&link).unwrap(), b"new");
        assert_eq!(std::fs::read(&file).unwrap(), b"precious");
        force.write(&file, "newer").unwrap();
        assert_eq!(std::fs::read(&file).unwrap(), b"newer");
        // Nothing half done is left.
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_link_to_nowhere_is_something_that_is_there() {
        let dir = tempfile::tempdir().unwrap();
        let link = dir.path().join("c.toml");
        symlink(dir.path().join("elsewhere"), &link).unwrap();
        assert!(Output::default().file("--out", &link).is_err());
        assert!(Output::default().write(&link, "x").is_err());
        assert!(!dir.path().join("elsewhere").exists());
    }

    #[test]
    fn a_disk_that_takes_no_more_leaves_nothing_under_the_name() {
        // A write to it fails with ENOSPC, as on a full disk; it is no folder, so the name cannot be made either.
        let error = Output::default()
            .write(Path::new("/dev/full/x.toml"), "x")
            .unwrap_err();
        assert!(matches!(error, CliError::Run(_)), "{error}");
    }
}
