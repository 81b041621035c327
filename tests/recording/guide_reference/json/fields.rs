//! The fields of a type as its JSON Schema says them.

use serde_json::{Map, Value};

/// A field of what is printed.
pub(super) struct Field {
    /// Names from the outside, `[]` = an element of a list, NAME = any name.
    pub path: String,
    /// Type, in words.
    pub kind: String,
    /// Unit; "" = none.
    pub unit: String,
    /// Description for the reader; "" = none.
    pub meaning: String,
    /// Whether it is omitted where it says nothing.
    pub optional: bool,
    /// Whether it says more than the map that it is an entry of.
    pub shown: bool,
}

/// Path of the name in a map.
const NAME: &str = "NAME";

/// All fields of a type as it is printed, by its schema.
pub(super) fn of(schema: &Value) -> Vec<Field> {
    let mut fields = Vec::new();
    within("", schema, "", &mut fields);
    fields
}

/// Fields of what a schema says, below `path`; `about` = what is known of it from above.
fn within(path: &str, schema: &Value, about: &str, fields: &mut Vec<Field>) {
    let below = |name: &str| match path {
        "" => name.to_owned(),
        _ => format!("{path}.{name}"),
    };
    for (name, of, always) in properties(schema) {
        add(below(name), of, "", !always, fields);
    }
    if schema["additionalProperties"].is_object() {
        // A map's description holds for its entries.
        let about = schema["description"].as_str().unwrap_or(about);
        add(
            below(NAME),
            &schema["additionalProperties"],
            about,
            false,
            fields,
        );
    }
    let items = [&schema["items"]].into_iter().filter(|i| i.is_object());
    for element in items.chain(list(schema, "prefixItems")) {
        within(&format!("{path}[]"), element, about, fields);
    }
    for part in parts(schema).chain(list(schema, "allOf")) {
        // A variant that is one field by its name: what the variant is, the field is.
        match (one(properties(part)), part["description"].as_str()) {
            (Some((name, of, _)), Some(about)) => add(below(name), of, about, true, fields),
            _ => within(path, part, about, fields),
        }
    }
}

/// The fields of an object in the order of the type, each with whether it is always there; those that are not come last.
fn properties(schema: &Value) -> Vec<(&str, &Value, bool)> {
    let always: Vec<&str> = list(schema, "required").filter_map(Value::as_str).collect();
    let place = |name: &str| always.iter().position(|a| *a == name);
    let all = schema["properties"].as_object().into_iter().flatten();
    let mut all: Vec<_> = all
        .map(|(name, of)| (name.as_str(), of, place(name).is_some()))
        .collect();
    all.sort_by_key(|(name, _, _)| place(name).unwrap_or(usize::MAX));
    all
}

/// The only one.
fn one<T>(all: Vec<T>) -> Option<T> {
    let mut all = all.into_iter();
    all.next().filter(|_| all.next().is_none())
}

/// Marks a field whose own fields stand elsewhere in the chapter.
const ELSEWHERE: &str = "--json` prints";

fn add(path: String, schema: &Value, about: &str, optional: bool, fields: &mut Vec<Field>) {
    let mut kind = kind(schema);
    if optional && let Some(there) = kind.strip_suffix(" or null") {
        // Left out instead.
        kind = there.to_owned();
    }
    // A variant of an enum after the first repeats what they have in common, such as its tag.
    if let Some(known) = fields.iter_mut().find(|f| f.path == path) {
        if known.kind != kind {
            known.kind = format!("{} or {kind}", known.kind);
        }
        return;
    }
    let own = schema["description"].as_str();
    let about = own.filter(|_| about.is_empty()).unwrap_or(about);
    let (mut meaning, unit) = described(about);
    for (word, about) in variants(schema) {
        let about = about.trim_end_matches('.');
        meaning.push_str(&format!(" `\"{word}\"`: {about}."));
    }
    if meaning.is_empty() && schema["const"].is_string() {
        meaning = "Which of its forms the object has.".to_owned();
    }
    let unit = match unit.is_empty() && kind.contains("number") {
        true => unit_of_name(&path).to_owned(),
        false => unit,
    };
    let elsewhere = meaning.contains(ELSEWHERE);
    let entry = path.ends_with(NAME) && path != NAME && own.is_none();
    fields.push(Field {
        path: path.clone(),
        kind,
        unit,
        meaning,
        optional,
        shown: !entry,
    });
    if !elsewhere {
        within(&path, schema, about, fields);
    }
}

/// Alternatives of a schema: its `anyOf` and `oneOf`.
fn parts(schema: &Value) -> impl Iterator<Item = &Value> {
    list(schema, "anyOf").chain(list(schema, "oneOf"))
}

/// Elements of a list within a schema.
fn list<'a>(schema: &'a Value, key: &str) -> impl Iterator<Item = &'a Value> {
    schema[key].as_array().into_iter().flatten()
}

/// The type in words.
fn kind(schema: &Value) -> String {
    let Some(of) = schema.as_object() else {
        return "anything".to_owned();
    };
    let words: Vec<String> = words(of);
    if !words.is_empty() {
        let null = allows_null(of);
        let words = words.join(", ");
        return if null {
            format!("{words} or null")
        } else {
            words
        };
    }
    let parts: Vec<&Value> = parts(schema).collect();
    if !parts.is_empty() {
        let mut kinds: Vec<String> = Vec::new();
        for kind in parts.into_iter().map(kind) {
            if !kinds.contains(&kind) {
                kinds.push(kind);
            }
        }
        return kinds.join(" or ");
    }
    let kinds: Vec<String> = match &schema["type"] {
        Value::String(name) => vec![simple(name, schema)],
        Value::Array(names) => {
            let names = names.iter().filter_map(Value::as_str);
            names.map(|name| simple(name, schema)).collect()
        }
        _ => vec!["anything".to_owned()],
    };
    kinds.join(" or ")
}

fn simple(name: &str, schema: &Value) -> String {
    match name {
        "integer" => "whole number".to_owned(),
        "boolean" => "true or false".to_owned(),
        "string" => "text".to_owned(),
        "array" => elements(schema),
        "object" if schema["additionalProperties"].is_object() => {
            format!("{} by name", plural(&kind(&schema["additionalProperties"])))
        }
        other => other.to_owned(),
    }
}

/// A list by its elements: "list of numbers", "list of 6 numbers", "list of number, text".
fn elements(schema: &Value) -> String {
    let parts: Vec<String> = list(schema, "prefixItems").map(kind).collect();
    if let Some(first) = parts.first() {
        return match parts.iter().all(|p| p == first) {
            true => format!("list of {} {}", parts.len(), plural(first)),
            false => format!("list of {}", parts.join(", ")),
        };
    }
    let of = plural(&kind(&schema["items"]));
    match (schema["minItems"].as_u64(), schema["maxItems"].as_u64()) {
        (Some(least), Some(most)) if least == most => format!("list of {least} {of}"),
        _ => format!("list of {of}"),
    }
}

fn plural(kind: &str) -> String {
    match kind {
        "number" | "whole number" | "text" | "object" => format!("{kind}s"),
        _ => match kind.strip_prefix("list of ") {
            Some(of) => format!("lists of {of}"),
            None => format!("({kind})"),
        },
    }
}

/// Words that a text may be, quoted.
fn words(schema: &Map<String, Value>) -> Vec<String> {
    let quoted = |word: &Value| word.as_str().map(|word| format!("`\"{word}\"`"));
    if let Some(word) = schema.get("const") {
        return quoted(word).into_iter().collect();
    }
    let listed = schema.get("enum").and_then(Value::as_array);
    if let Some(listed) = listed {
        return listed.iter().filter_map(quoted).collect();
    }
    let variants = schema.get("oneOf").and_then(Value::as_array);
    let variants = variants.into_iter().flatten();
    let each: Vec<Vec<String>> = variants
        .map(|v| v.as_object().map(words).unwrap_or_default())
        .collect();
    match each.iter().any(Vec::is_empty) {
        true => Vec::new(),
        false => each.concat(),
    }
}

/// Words that a text may be, with what each means.
fn variants(schema: &Value) -> Vec<(String, String)> {
    let each = parts(schema).flat_map(|v| match (v["const"].as_str(), v["description"].as_str()) {
        (Some(word), Some(about)) => vec![(word.to_owned(), described(about).0)],
        _ => variants(v),
    });
    each.collect()
}

fn allows_null(schema: &Map<String, Value>) -> bool {
    let listed = schema.get("enum").and_then(Value::as_array);
    listed.is_some_and(|l| l.contains(&Value::Null))
}

/// Meaning and unit of a doc comment: the unit stands in `\[ \]`; what is `None` there is null here.
fn described(doc: &str) -> (String, String) {
    let doc = doc
        .replace("`None`", "`null`")
        .replace("[`", "`")
        .replace("`]", "`");
    let units = doc.split_once("\\[").and_then(|(before, rest)| {
        let (unit, after) = rest.split_once("\\]")?;
        Some((
            before.trim_end().to_owned(),
            unit.to_owned(),
            after.to_owned(),
        ))
    });
    match units {
        Some((before, unit, after)) => (tidy(&format!("{before}{after}")), unit),
        None => (tidy(&doc), String::new()),
    }
}

fn tidy(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    words.join(" ").replace("\\[", "[").replace("\\]", "]")
}

/// Unit by the ending of a name.
fn unit_of_name(path: &str) -> &'static str {
    const ENDINGS: [(&str, &str); 20] = [
        ("_ns", "ns"),
        ("_us", "us"),
        ("_s", "s"),
        ("_min", "min"),
        ("_m", "m"),
        ("_mm", "mm"),
        ("_px", "px"),
        ("_rad", "rad"),
        ("_deg", "deg"),
        ("_n", "N"),
        ("_v", "V"),
        ("_hz", "1/s"),
        ("_fps", "1/s"),
        ("_mps", "m/s"),
        ("_radps", "rad/s"),
        ("_bytes", "bytes"),
        ("_levels", "grey levels"),
        ("_nats", "nats"),
        ("_ppm", "1e-6"),
        ("_sds", "standard deviations"),
    ];
    let found = ENDINGS.iter().find(|(ending, _)| path.ends_with(ending));
    found.map_or("", |(_, unit)| unit)
}
