//! cases.toml, and the inputs that a case needs: simulated by the binary under test, and held against the committed digests.

use crate::support::hydroline;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The sample and a folder for its files.
pub struct Cases {
    table: toml::Table,
    folder: PathBuf,
    /// Committed numbers: `tests/data/sample/expected.json`.
    pub expected: serde_json::Value,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Runs the binary; stdout. 3 = done, with something to say of the data.
pub fn ran(args: &[String]) -> String {
    let output = hydroline().args(args).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(
        matches!(output.status.code(), Some(0 | 3)),
        "{args:?}: {stderr}"
    );
    String::from_utf8(output.stdout).unwrap()
}

fn words(args: &[&str]) -> Vec<String> {
    args.iter().map(|a| (*a).to_owned()).collect()
}

fn entry<'a>(list: &'a toml::Value, key: &str, name: &str) -> &'a toml::Value {
    let found = list.as_array().unwrap().iter();
    let mut found = found.filter(|e| e[key].as_str() == Some(name));
    found
        .next()
        .unwrap_or_else(|| panic!("cases.toml: no {key} = \"{name}\""))
}

fn strings(value: Option<&toml::Value>) -> Vec<String> {
    let list = value.and_then(toml::Value::as_array).into_iter().flatten();
    list.map(|v| v.as_str().unwrap().to_owned()).collect()
}

impl Cases {
    pub fn new(folder: &Path) -> Self {
        let read = |path: &str| std::fs::read_to_string(root().join(path)).unwrap();
        Cases {
            table: read("tests/sample/cases.toml").parse().unwrap(),
            folder: folder.to_owned(),
            expected: serde_json::from_str(&read("tests/data/sample/expected.json")).unwrap(),
        }
    }

    /// Where results go.
    pub fn out(&self, name: &str) -> PathBuf {
        self.folder.join(format!("out-{name}"))
    }

    /// Arguments of a case, its files made.
    pub fn arguments(&self, stage: &str, name: &str) -> Vec<String> {
        let key = stage.strip_suffix('s').unwrap();
        let case = entry(&self.table[key], "name", name);
        let args = strings(case.get("args"));
        args.iter().map(|a| self.placed(a)).collect()
    }

    /// `{log:X}`, `{rig:X}` and `{kept:X}` to paths.
    fn placed(&self, argument: &str) -> String {
        let inner = argument.strip_prefix('{').and_then(|a| a.strip_suffix('}'));
        let Some((kind, name)) = inner.and_then(|a| a.split_once(':')) else {
            return argument.to_owned();
        };
        let path = match kind {
            "log" => self.log(name),
            "rig" => self.rig(name),
            "kept" => root().join("tests/data/sample").join(name),
            _ => panic!("cases.toml: {argument}"),
        };
        path.to_str().unwrap().to_owned()
    }

    fn written(&self, name: &str, text: &str) -> PathBuf {
        let path = self.folder.join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    fn rig(&self, name: &str) -> PathBuf {
        let entry = &self.table["rig"][name];
        let mut text = std::fs::read_to_string(root().join("tests/sample/rig.toml")).unwrap();
        let replace = entry.get("replace").and_then(toml::Value::as_array);
        for pair in replace.into_iter().flatten() {
            let (old, new) = (pair[0].as_str().unwrap(), pair[1].as_str().unwrap());
            assert_eq!(text.matches(old).count(), 1, "rig {name}: {old}");
            text = text.replace(old, new);
        }
        let physics = entry.get("physics").and_then(toml::Value::as_str);
        text = format!("{text}\n{}", physics.unwrap_or(""));
        self.written(&format!("{name}.rig.toml"), &text)
    }

    /// The simulated log of that name, the same messages as the committed digests say.
    pub fn log(&self, name: &str) -> PathBuf {
        let out = self.folder.join(format!("{name}.mcap"));
        if out.exists() {
            return out;
        }
        let (run, plan, nth) = self.run_of(name);
        let text = self.table["plan"][plan.as_str()].as_str().unwrap();
        let plan = self.written(&format!("{plan}.toml"), text);
        let rig = self.rig(run["rig"].as_str().unwrap());
        let seed = (run["seed"].as_integer().unwrap() + nth).to_string();
        let mut args = words(&["simulate", "--rig", rig.to_str().unwrap()]);
        args.extend(words(&["--plan", plan.to_str().unwrap(), "--seed", &seed]));
        args.extend(strings(run.get("args")));
        args.extend(words(&["--out", out.to_str().unwrap()]));
        ran(&args);
        let expected = &self.expected["inputs"][name];
        let found = serde_json::to_value(digest(&out)).unwrap();
        assert_eq!(
            &found, expected,
            "the simulator's messages of {name} are not those of the committed sample (count and CRC-32 by topic): \
             what is estimated from them cannot be compared"
        );
        out
    }

    /// The `[[runs]]` that a log belongs to, its plan, and its place among the plans.
    fn run_of(&self, log: &str) -> (&toml::Value, String, i64) {
        for run in self.table["runs"].as_array().unwrap() {
            let (own, plans) = (run["log"].as_str().unwrap(), strings(run.get("plans")));
            for (plan, nth) in plans.iter().zip(0..) {
                if log == format!("{own}-{plan}") || (plans.len() == 1 && log == own) {
                    return (run, plan.clone(), nth);
                }
            }
        }
        panic!("cases.toml: no [[runs]] makes {log}");
    }
}

/// By topic: number of messages, and the CRC-32 over their log times and bytes.
fn digest(log: &Path) -> BTreeMap<String, String> {
    let bytes = std::fs::read(log).unwrap();
    let mut sums: BTreeMap<String, (u64, crc32fast::Hasher)> = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let (count, sum) = sums.entry(message.channel.topic.clone()).or_default();
        *count += 1;
        sum.update(&message.log_time.to_le_bytes());
        sum.update(&message.data);
    }
    let line = |(count, sum): (u64, crc32fast::Hasher)| format!("{count} {:08x}", sum.finalize());
    sums.into_iter().map(|(t, s)| (t, line(s))).collect()
}
