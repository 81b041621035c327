//! Numbers in units of their sd, as tests/sample/lib/judge.py judges them; what has no sd is left to that.

use serde_json::Value;

/// Largest difference \[sd\].
const LIMIT_SD: f64 = 0.01;

/// Largest difference of an rms, as a share of it.
const LIMIT_RMS_SHARE: f64 = 1e-3;

/// Result of a comparison.
#[derive(Default)]
pub struct Judged {
    pub numbers: usize,
    pub identical: usize,
    pub worst_sd: f64,
    pub worst: String,
    /// Failures, in words.
    pub wrong: Vec<String>,
}

impl Judged {
    /// Every number of `expected` that has an sd, and every flag, in `found`.
    pub fn tree(&mut self, place: &str, expected: &Value, found: &Value) {
        match (expected, found) {
            (Value::Object(a), Value::Object(_)) => {
                let [value, sd] = ["value", "sd"].map(|k| a.get(k).and_then(Value::as_f64));
                if let (Some(_), Some(sd)) = (value, sd.filter(|sd| *sd > 0.0)) {
                    for key in ["value", "low", "high", "sd"] {
                        if let Some(was) = a.get(key).and_then(Value::as_f64) {
                            self.number(&format!("{place} {key}"), was, &found[key], sd);
                        }
                    }
                }
                for (key, was) in a {
                    self.tree(&format!("{place} {key}"), was, &found[key]);
                }
            }
            // Lists of another length are judged where their length matters: see `same_verdict`.
            (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
                for (k, (was, is)) in a.iter().zip(b).enumerate() {
                    self.tree(&format!("{place} {k}"), was, is);
                }
            }
            (Value::Object(_), _) => {
                self.wrong.push(format!("{place}: is no longer there"));
            }
            (Value::Bool(_), _) if expected != found => {
                self.wrong
                    .push(format!("{place}: was {expected}, is {found}"));
            }
            _ => {}
        }
    }

    fn number(&mut self, place: &str, was: f64, is: &Value, sd: f64) {
        self.numbers += 1;
        let Some(is) = is.as_f64() else {
            self.wrong.push(format!("{place}: was {was}, is {is}"));
            return;
        };
        self.identical += usize::from(was.to_bits() == is.to_bits());
        let off_sd = (is - was).abs() / sd;
        if off_sd > self.worst_sd {
            (self.worst_sd, self.worst) = (off_sd, place.to_owned());
        }
        if off_sd > LIMIT_SD {
            let text = format!("{place}: was {was}, is {is}: {off_sd:.3} sd, allowed {LIMIT_SD}");
            self.wrong.push(text);
        }
    }
}

/// The word, what matters, what cannot be distinguished, and what is wrong with the data.
pub fn same_verdict(name: &str, expected: &Value, found: &Value, into: &mut Judged) {
    let matters = |v: &Value| -> Vec<Value> {
        let effects = v["effects"].as_array().into_iter().flatten();
        let matter = effects.filter(|e| e["matters"] == true);
        matter.map(|e| e["effect"].clone()).collect()
    };
    let of = |v: &Value| (v["verdict"].clone(), matters(v), v["equivalent"].clone());
    let (was, is) = (of(expected), of(found));
    if was != is {
        into.wrong.push(format!("{name}: was {was:?}, is {is:?}"));
    }
    let faults = |v: &Value| v["data_faults"].as_array().map_or(0, Vec::len);
    if faults(expected) != faults(found) {
        into.wrong.push(format!("{name}: other faults of the data"));
    }
    // Each channel's rms under leave-one-run-out: to a thousandth of itself, which is far below what any verdict rests on.
    let [was, is] = [expected, found].map(|v| &v["leave_one_run_out"]["rms"]);
    for by in ["before", "after"] {
        for (channel, was) in was[by].as_object().into_iter().flatten() {
            let place = format!("{name} leave_one_run_out {by} {channel}");
            let rms = was.as_f64().unwrap();
            into.number(
                &place,
                rms,
                &is[by][channel],
                LIMIT_RMS_SHARE * rms / LIMIT_SD,
            );
        }
    }
}

#[test]
fn what_is_off_is_found_wrong() {
    use serde_json::json;
    let was = json!({ "x": { "value": 1.0, "sd": 0.1 }, "accepted": true });
    let wrong = |is: &Value| {
        let mut judged = Judged::default();
        judged.tree("case", &was, is);
        judged.wrong.len()
    };
    assert_eq!(wrong(&was), 0);
    assert_eq!(
        wrong(&json!({ "x": { "value": 1.0009, "sd": 0.1 }, "accepted": true })),
        0
    );
    for off in [
        json!({ "x": { "value": 1.0011, "sd": 0.1 }, "accepted": true }),
        json!({ "x": { "value": 1.0, "sd": 0.102 }, "accepted": true }),
        json!({ "x": { "value": null, "sd": 0.1 }, "accepted": true }),
        json!({ "x": { "value": 1.0, "sd": 0.1 }, "accepted": false }),
        json!({ "accepted": true }),
    ] {
        assert_eq!(wrong(&off), 1, "{off}");
    }
}
