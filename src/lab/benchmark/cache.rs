//! Judged cases in a folder: a proof of hours can be broken off and gone on with, and done by several machines.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::{Serialize, de::DeserializeOwned};

use super::case::Category;
use super::error::ProveError;
use super::judge::Judged;

/// The rules by which cases are judged: a new number where the same verdict would be judged otherwise.
pub const JUDGE: u32 = 1;

/// A folder of cases of one seed, `ID.json` each: `{"id", "seed", "build", "judge", "observed", "judged"}`.
#[derive(Debug)]
pub struct Kept {
    folder: PathBuf,
    seed: u64,
    build: String,
    /// Builds other than this one whose cases were taken.
    others: Mutex<BTreeSet<String>>,
}

/// File of one case.
#[derive(serde::Serialize, serde::Deserialize)]
struct Sheet<T> {
    id: String,
    seed: u64,
    /// The program that diagnosed it: version and commit; empty = it did not say.
    #[serde(default)]
    build: String,
    /// See [`JUDGE`].
    #[serde(default = "first")]
    judge: u32,
    /// Whether the ideal observer was asked; `prove --only` always asks it.
    #[serde(default = "yes")]
    observed: bool,
    judged: T,
}

fn yes() -> bool {
    true
}

fn first() -> u32 {
    1
}

impl Kept {
    /// The folder, made where there is none.
    ///
    /// # Errors
    /// [`ProveError::Kept`].
    pub fn new(folder: &Path, seed: u64, build: &str) -> Result<Self, ProveError> {
        std::fs::create_dir_all(folder).map_err(|e| broken(folder, &e))?;
        Ok(Kept {
            folder: folder.to_owned(),
            seed,
            build: build.to_owned(),
            others: Mutex::default(),
        })
    }

    /// Builds other than this one that diagnosed cases which were read: what is scored is not one program.
    pub fn other_builds(&self) -> Vec<String> {
        let others = self.others.lock().unwrap_or_else(PoisonError::into_inner);
        others.iter().cloned().collect()
    }

    fn path(&self, id: &str) -> PathBuf {
        self.folder.join(format!("{id}.json"))
    }

    /// The case as it was judged; `None` where it was not, or without the observer who is now asked for.
    ///
    /// # Errors
    /// [`ProveError::Kept`]: not a case, or of another seed.
    pub fn read(&self, id: &str, observe: bool) -> Result<Option<Judged>, ProveError> {
        let Some(sheet) = self.sheet::<Judged>(id)? else {
            return Ok(None);
        };
        // Of these the observer says nothing anyway.
        let silent = matches!(sheet.judged.category, Category::Fault | Category::Paper);
        Ok((sheet.observed || silent || !observe).then_some(sheet.judged))
    }

    /// A case of another kind as it was judged, else run now and laid down.
    ///
    /// # Errors
    /// [`ProveError`].
    pub fn or_run<T: Serialize + DeserializeOwned>(
        kept: Option<&Self>,
        id: &str,
        run: impl FnOnce() -> Result<T, ProveError>,
    ) -> Result<T, ProveError> {
        let Some(kept) = kept else { return run() };
        if let Some(judged) = kept.read_other(id)? {
            return Ok(judged);
        }
        let judged = run()?;
        kept.write_other(id, &judged)?;
        Ok(judged)
    }

    /// The same of cases of another kind, which have no observer.
    ///
    /// # Errors
    /// [`ProveError::Kept`].
    pub fn read_other<T: DeserializeOwned>(&self, id: &str) -> Result<Option<T>, ProveError> {
        Ok(self.sheet(id)?.map(|sheet| sheet.judged))
    }

    fn sheet<T: DeserializeOwned>(&self, id: &str) -> Result<Option<Sheet<T>>, ProveError> {
        let path = self.path(id);
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(broken(&path, &e)),
        };
        let sheet: Sheet<T> = serde_json::from_str(&text).map_err(|e| ProveError::Kept {
            path: path.display().to_string(),
            reason: format!("is no judged case ({e}); remove it, and the case is run again"),
        })?;
        if sheet.seed != self.seed || sheet.id != id {
            return Err(ProveError::Kept {
                path: path.display().to_string(),
                reason: format!(
                    "holds {} of seed {}, not {id} of seed {}; name another folder with --keep",
                    sheet.id, sheet.seed, self.seed
                ),
            });
        }
        if sheet.judge != JUDGE {
            return Err(ProveError::Kept {
                path: path.display().to_string(),
                reason: format!(
                    "was judged by the rules of version {}, this build has {JUDGE}; name another folder with --keep",
                    sheet.judge
                ),
            });
        }
        if sheet.build != self.build {
            let name = match sheet.build.as_str() {
                "" => "a build that did not say which",
                named => named,
            };
            let mut others = self.others.lock().unwrap_or_else(PoisonError::into_inner);
            others.insert(name.to_owned());
        }
        Ok(Some(sheet))
    }

    /// Lays a case down, whole or not at all.
    ///
    /// # Errors
    /// [`ProveError::NotKept`].
    pub fn write(&self, judged: &Judged, observed: bool) -> Result<(), ProveError> {
        self.lay(&judged.id, judged, observed)
    }

    /// The same of a case of another kind.
    ///
    /// # Errors
    /// [`ProveError::NotKept`].
    pub fn write_other<T: Serialize>(&self, id: &str, judged: &T) -> Result<(), ProveError> {
        self.lay(id, judged, false)
    }

    fn lay<T: Serialize>(&self, id: &str, judged: &T, observed: bool) -> Result<(), ProveError> {
        let path = self.path(id);
        let sheet = Sheet {
            id: id.to_owned(),
            seed: self.seed,
            build: self.build.clone(),
            judge: JUDGE,
            observed,
            judged,
        };
        let failed = |reason: String| ProveError::NotKept {
            path: path.display().to_string(),
            reason,
        };
        let text = serde_json::to_string(&sheet).map_err(|e| failed(e.to_string()))?;
        // Another process may be at the same case.
        let part = path.with_extension(format!("{}.part", std::process::id()));
        std::fs::write(&part, text)
            .and_then(|()| std::fs::rename(&part, &path))
            .map_err(|e| failed(e.to_string()))
    }
}

fn broken(path: &Path, error: &std::io::Error) -> ProveError {
    ProveError::Kept {
        path: path.display().to_string(),
        reason: format!("{error}; name a folder that can be written with --keep"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::benchmark::{How, judge, make};

    #[test]
    fn a_kept_case_is_read_back_as_it_was_judged_and_only_for_its_own_seed() {
        let dir = tempfile::tempdir().unwrap();
        let kept = Kept::new(&dir.path().join("new"), 5, "1 (a)").unwrap();
        assert!(kept.read("fault-0", true).unwrap().is_none());
        let judged = judge(&make(5, Category::Fault, 0).unwrap(), How::default()).unwrap();
        kept.write(&judged, false).unwrap();
        let back = kept.read("fault-0", true).unwrap().unwrap();
        let text = |j: &Judged| serde_json::to_string(j).unwrap();
        assert_eq!(text(&back), text(&judged));
        assert!(kept.other_builds().is_empty());

        // Of another build it is taken, and that is known; judged by other rules it is not.
        let later = Kept::new(&dir.path().join("new"), 5, "1 (b)").unwrap();
        assert!(later.read("fault-0", true).unwrap().is_some());
        assert_eq!(later.other_builds(), ["1 (a)"]);
        let path = dir.path().join("new/fault-0.json");
        let sheet = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, sheet.replacen("\"judge\":1", "\"judge\":9", 1)).unwrap();
        let said = later.read("fault-0", true).unwrap_err().to_string();
        assert!(said.contains("rules of version 9"), "{said}");
        std::fs::write(&path, sheet).unwrap();

        let other = Kept::new(&dir.path().join("new"), 6, "1 (a)").unwrap();
        let said = other.read("fault-0", true).unwrap_err().to_string();
        assert!(said.contains("seed 5") && said.contains("--keep"), "{said}");
        std::fs::write(dir.path().join("new/fault-1.json"), "{}").unwrap();
        assert!(kept.read("fault-1", true).is_err());
    }
}
