//! Messages in JSON.

use serde_json::Value;

use super::message::{ELEMENTS_MAX, Leaves, Number};

const NAN: &str = "\"\\u0000nan\"";
const PLUS: &str = "\"\\u0000inf\"";
const MINUS: &str = "\"\\u0000-inf\"";
/// Words for numbers that JSON has not and writers put there nevertheless (Python's `json.dumps`, C's `printf`), with what stands in
/// their place while the rest is parsed: texts that no message holds.
const NOT_FINITE: [(&str, &str); 8] = [
    ("-Infinity", MINUS),
    ("Infinity", PLUS),
    ("-inf", MINUS),
    ("inf", PLUS),
    ("-NaN", NAN),
    ("NaN", NAN),
    ("-nan", NAN),
    ("nan", NAN),
];

pub(super) fn decode(data: &[u8], leaves: &mut Leaves) -> Result<(), String> {
    let value: Value = match serde_json::from_slice(data) {
        Ok(value) => value,
        Err(error) => with_words(data)
            .and_then(|text| serde_json::from_slice(&text).ok())
            .ok_or_else(|| format!("no JSON: {error}"))?,
    };
    fields(&value, leaves);
    Ok(())
}

/// The same text with texts in place of [`NOT_FINITE`] numbers; `None` = it holds none.
fn with_words(data: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(data.len());
    let (mut at, mut in_text, mut found) = (0, false, false);
    while let Some(byte) = data.get(at) {
        let word = NOT_FINITE
            .iter()
            .find(|(word, _)| !in_text && data[at..].starts_with(word.as_bytes()));
        if let Some((word, stand_in)) = word {
            out.extend(stand_in.as_bytes());
            at += word.len();
            found = true;
            continue;
        }
        if in_text && *byte == b'\\' {
            // What is escaped ends no text.
            out.push(*byte);
            at += 1;
            out.extend(data.get(at));
            at += 1;
            continue;
        }
        in_text ^= *byte == b'"';
        out.push(*byte);
        at += 1;
    }
    found.then_some(out)
}

/// The number that a text stands for since [`with_words`].
fn not_finite(text: &str) -> Option<f64> {
    match text.strip_prefix('\0')? {
        "nan" => Some(f64::NAN),
        "inf" => Some(f64::INFINITY),
        "-inf" => Some(f64::NEG_INFINITY),
        _ => None,
    }
}

/// Depth is bounded by the parser.
fn fields(value: &Value, leaves: &mut Leaves) {
    match value {
        Value::Bool(v) => leaves.number(Number::UInt((*v).into())),
        Value::Number(n) => {
            let own = n
                .as_i64()
                .map(Number::Int)
                .or_else(|| n.as_u64().map(Number::UInt))
                .or_else(|| n.as_f64().map(Number::Float));
            if let Some(own) = own {
                leaves.number(own);
            }
        }
        Value::String(text) => match not_finite(text) {
            Some(value) => leaves.number(Number::Float(value)),
            None => leaves.text(text),
        },
        Value::Array(list) => {
            for (index, item) in list.iter().take(ELEMENTS_MAX).enumerate() {
                let before = leaves.enter_element(index);
                fields(item, leaves);
                leaves.leave(before);
            }
        }
        Value::Object(map) => {
            for (name, item) in map {
                let before = leaves.enter(name);
                fields(item, leaves);
                leaves.leave(before);
            }
        }
        Value::Null => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_json_has_not_cost_the_whole_message() {
        let text =
            br#"{"x": NaN, "y": 1.5, "l": [-Infinity, 2, Infinity], "s": "NaN \" NaN", "z": nan}"#;
        let mut leaves = Leaves::default();
        decode(text, &mut leaves).unwrap();
        let own: Vec<(String, String)> = leaves
            .numbers()
            .map(|(path, n)| (path.to_owned(), n.to_string()))
            .collect();
        let expected = [
            ("l[0]", "-inf"),
            ("l[1]", "2"),
            ("l[2]", "inf"),
            ("x", "NaN"),
            ("y", "1.5"),
            ("z", "NaN"),
        ];
        assert_eq!(own.len(), expected.len(), "{own:?}");
        for (path, text) in expected {
            assert!(own.contains(&(path.to_owned(), text.to_owned())), "{own:?}");
        }
        assert_eq!(leaves.get_text("s"), Some("NaN \" NaN"));
        for wrong in ["{\"x\": NaNa}", "{\"x\": Na}", "NaN,", "{\"x\": 1.0"] {
            let error = decode(wrong.as_bytes(), &mut Leaves::default()).unwrap_err();
            assert!(error.starts_with("no JSON"), "{wrong}: {error}");
        }
    }
}
