//! Logs of an analysis: folders opened up, and the rig that they carry where none is named.

use super::print::errln;
use super::{CliError, inputs, many};
use hydroline_diagnose::Part;
use hydroline_identify::data::differences;
use hydroline_log::LogReader;
use hydroline_rigs::Rig;
use std::path::{Path, PathBuf};

/// The logs named, in a folder's place all logs in it and below it, and in that of a name with `*` or `?`, which a shell had no part
/// in, all that are like it.
///
/// # Errors
/// A folder that cannot be read or holds no log; a name that nothing is like; one of either of which a window is asked.
pub(super) fn opened(named: &[Part]) -> Result<Vec<Part>, CliError> {
    let mut logs = Vec::new();
    for part in named {
        let like = matching(&part.path);
        match like.as_deref() {
            None => open(part, &mut logs)?,
            Some([]) => {
                return Err(CliError::Config(format!(
                    "{part}: nothing is called like that; name logs, or a folder of logs"
                )));
            }
            Some([one]) => {
                let one = Part {
                    path: one.clone(),
                    window_s: part.window_s,
                };
                open(&one, &mut logs)?;
            }
            Some(all) if part.window_s.is_some() => {
                return Err(CliError::Config(format!(
                    "{part}: a window is of one log, and {} are called like that; name the log: LOG@FROM..TO",
                    all.len()
                )));
            }
            Some(all) => {
                for path in all {
                    open(&Part::from(path), &mut logs)?;
                }
            }
        }
    }
    Ok(logs)
}

/// Adds a log, or the logs of a folder.
fn open(part: &Part, logs: &mut Vec<Part>) -> Result<(), CliError> {
    if !part.path.is_dir() {
        logs.push(part.clone());
        return Ok(());
    }
    if part.window_s.is_some() {
        return Err(CliError::Config(format!(
            "{part}: a window is of one log, and {} is a folder; name the log: LOG@FROM..TO",
            part.path.display()
        )));
    }
    let found = many::below(&part.path, many::LOG)?;
    logs.extend(found.iter().map(Part::from));
    Ok(())
}

/// Files and folders that a name with `*` or `?` stands for, by their names; hidden ones only where it names them. `None` = it is no
/// such name, or there is a file of that very name.
fn matching(pattern: &Path) -> Option<Vec<PathBuf>> {
    let is_pattern = |name: &str| name.contains(['*', '?']);
    if pattern.exists() || !is_pattern(&pattern.to_string_lossy()) {
        return None;
    }
    let mut found = vec![PathBuf::new()];
    for part in pattern.components() {
        let name = part.as_os_str().to_string_lossy();
        let mut next = Vec::new();
        for folder in &found {
            if !is_pattern(&name) {
                next.extend(Some(folder.join(part)).filter(|path| path.exists()));
                continue;
            }
            let here: &Path = match folder.as_os_str().is_empty() {
                true => Path::new("."),
                false => folder,
            };
            // A name before it may be one of a file: nothing is in it.
            let entries = std::fs::read_dir(here).into_iter().flatten().flatten();
            for own in entries.map(|entry| entry.file_name()) {
                let words = own.to_string_lossy();
                let is_hidden = words.starts_with('.') && !name.starts_with('.');
                if !is_hidden && is_like(&words, &name) {
                    next.push(folder.join(&own));
                }
            }
        }
        found = next;
    }
    found.sort();
    Some(found)
}

/// Whether a name is like a pattern, in which `*` stands for any letters and `?` for one.
fn is_like(name: &str, pattern: &str) -> bool {
    let name: Vec<char> = name.chars().collect();
    // Whether the pattern so far takes so many of the name's first letters.
    let mut takes = vec![false; name.len() + 1];
    takes[0] = true;
    for letter in pattern.chars() {
        let mut more: Vec<bool> = Vec::with_capacity(takes.len());
        for (k, here) in takes.iter().enumerate() {
            let before = k.checked_sub(1);
            more.push(match letter {
                '*' => *here || before.is_some_and(|b| more[b]),
                '?' => before.is_some_and(|b| takes[b]),
                _ => before.is_some_and(|b| takes[b] && name[b] == letter),
            });
        }
        takes = more;
    }
    takes[name.len()]
}

/// The rig named, else the one that all logs carry, which is said.
///
/// # Errors
/// A rig that cannot be read; logs of which one carries none, or another one.
pub(super) fn rig<'a>(
    named: Option<&str>,
    logs: impl Iterator<Item = &'a Path>,
) -> Result<Rig, CliError> {
    if let Some(named) = named {
        return inputs::rig(named);
    }
    let mut found: Option<(&Path, Rig)> = None;
    for log in logs {
        let own = carried(log)?;
        match &found {
            None => found = Some((log, own)),
            Some((first, rig)) if !is_same(rig, &own) => {
                return Err(CliError::Config(format!(
                    "{} and {} carry different rigs ({}); say which: --rig RIG",
                    first.display(),
                    log.display(),
                    difference(rig, &own)
                )));
            }
            Some(_) => {}
        }
    }
    let Some((_, rig)) = found else {
        return Err(CliError::Config(
            "no rig is named, and no log that carries one; give --rig RIG".to_owned(),
        ));
    };
    errln!(
        "hydroline: rig {}, as the logs carry it (--rig names another)",
        rig.name
    );
    Ok(rig)
}

/// The rig that a log carries.
fn carried(log: &Path) -> Result<Rig, CliError> {
    inputs::readable_file(log, "name a log (.mcap) that can be read")?;
    let reader = LogReader::open(log)?;
    let Some(text) = reader.rig_toml() else {
        return Err(CliError::Config(format!(
            "{}: it carries no rig; give --rig RIG",
            log.display()
        )));
    };
    Rig::from_toml(text, "the log's rig", None).map_err(|e| {
        CliError::Config(format!(
            "{}: the rig that it carries cannot be read ({e}); give --rig RIG",
            log.display()
        ))
    })
}

/// Whether two rigs are one for an analysis of motion: camera, calibration and settings of the log do not count.
fn is_same(a: &Rig, b: &Rig) -> bool {
    a.name == b.name
        && a.vehicle == b.vehicle
        && a.thrusters == b.thrusters
        && a.physics == b.physics
        && a.bollard == b.bollard
        && a.identified == b.identified
        && a.tolerance == b.tolerance
        && a.tank == b.tank
}

/// Difference of two rigs, in words.
fn difference(a: &Rig, b: &Rig) -> String {
    let found = differences(a, b);
    if !found.is_empty() {
        return found.join("; ");
    }
    let parts = [
        ("[vehicle]", a.vehicle != b.vehicle),
        ("thrusters", a.thrusters != b.thrusters),
        ("[[physics]]", a.physics != b.physics),
        ("[bollard]", a.bollard != b.bollard),
        ("[identified]", a.identified != b.identified),
        ("[tolerance]", a.tolerance != b.tolerance),
        ("[tank]", a.tank != b.tank),
    ];
    let parts: Vec<&str> = parts.into_iter().filter(|p| p.1).map(|p| p.0).collect();
    format!("{} differ", parts.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_in_quotes_stands_for_the_logs_that_are_like_it() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["day1/run-10.mcap", "day1/run-2.mcap", "day2/run-3.mcap"] {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        for name in ["day1/.run-4.mcap", "day1/notes.txt"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        let named = |pattern: &str| -> Vec<Part> {
            let text = dir.path().join(pattern).display().to_string();
            vec![text.parse().unwrap()]
        };
        let found = |pattern: &str| -> Vec<String> {
            let all = opened(&named(pattern)).unwrap();
            let within = |p: &Part| {
                let path = p.path.strip_prefix(dir.path()).unwrap();
                path.display().to_string()
            };
            all.iter().map(within).collect()
        };
        let (ten, two, three) = ("day1/run-10.mcap", "day1/run-2.mcap", "day2/run-3.mcap");
        assert_eq!(found("day1/*.mcap"), [ten, two]);
        assert_eq!(found("day1/run-?.mcap"), [two]);
        assert_eq!(found("day?/run-*"), [ten, two, three]);
        assert_eq!(found("d*2"), [three], "a folder that is like it");
        assert_eq!(found("day2"), [three]);
        assert_eq!(found("day1/run-2.mcap"), [two]);
        let one = opened(&named("day2/*.mcap@3..9")).unwrap();
        assert_eq!(one[0].window_s, Some((3.0, 9.0)));
        for (pattern, words) in [
            ("day1/*.mcap@3..9", "a window is of one log"),
            ("day?/none*", "nothing is called like that"),
        ] {
            let said = opened(&named(pattern)).unwrap_err().to_string();
            assert!(said.contains(words), "{said}");
        }
    }
}
